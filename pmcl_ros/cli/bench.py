"""`pmcl bench`: times of the stages, against their plain forms run beside them."""

import json
from dataclasses import asdict

import click

from pmcl_ros.evaluation.bench import bench_dlv


@click.command()
@click.argument('name', type=click.Choice(['dlv']))
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def bench(name: str, as_json: bool) -> None:
    """Time a stage against its plain form, run beside it."""
    result = {'dlv': bench_dlv}[name]()
    if as_json:
        click.echo(json.dumps(asdict(result)))
        return
    click.echo(result.geometry)
    for step, milliseconds in result.ms.items():
        click.echo(f'{step:>16}: {milliseconds:9.1f} ms')
    click.echo(f'{result.ratio_to_reference:.0f} times as fast as the plain form')
