"""`pmcl bench`: times of the stages, against their plain forms run beside them."""

import json
from collections.abc import Callable
from dataclasses import asdict

import click

from pmcl_ros.evaluation.bench import (
    Bench,
    DriverBench,
    bench_decode,
    bench_dlv,
    bench_driver,
)

_BENCHES: dict[str, Callable[[], Bench | DriverBench]] = {
    'decode': bench_decode, 'dlv': bench_dlv, 'driver': bench_driver}


@click.command()
@click.argument('name', type=click.Choice(sorted(_BENCHES)))
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def bench(name: str, as_json: bool) -> None:
    """Time a stage against its plain form, run beside it.

    driver: takes and downloads 200 pictures from a simulated camera, over a link that drops.
    """
    result = _BENCHES[name]()
    if as_json:
        click.echo(json.dumps(asdict(result)))
        return
    for line in result.lines():
        click.echo(line)
