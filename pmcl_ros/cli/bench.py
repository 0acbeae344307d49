"""`pmcl bench`: times the stages, against their plain forms run beside them."""

import json
from collections.abc import Callable
from dataclasses import asdict

import click

from pmcl_ros.dlv.settings import BackEnd
from pmcl_ros.evaluation.bench import (
    Bench,
    ChainBench,
    DriverBench,
    GraphBench,
    PmclBench,
    TransportBench,
    bench_chain,
    bench_decode,
    bench_dlv,
    bench_driver,
    bench_graph,
    bench_pmcl,
    bench_transport,
)

_Result = Bench | ChainBench | DriverBench | GraphBench | PmclBench | TransportBench
_BENCHES: dict[str, Callable[[], _Result]] = {
    'chain': bench_chain, 'decode': bench_decode, 'dlv': bench_dlv, 'driver': bench_driver,
    'graph': bench_graph, 'pmcl': bench_pmcl, 'transport': bench_transport}


@click.command()
@click.argument('name', type=click.Choice(sorted(_BENCHES)))
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
@click.option('--back-end', type=click.Choice(['auto', 'numba', 'gl']), default='numba',
              show_default=True, help='What makes the volume; of dlv alone.')
def bench(name: str, as_json: bool, back_end: BackEnd) -> None:
    """Time a stage against its plain form, run beside it.

    chain: a raw picture's bytes to views, volume and pose, of a shipped bag.
    dlv: from uint8 views to likelihoods, stage by stage; with gl the time on the GPU alone, too.
    driver: takes and downloads 200 pictures from a simulated camera, over a link that drops.
    graph: from shutter to pose through the nodes, beside the same without ROS (needs ROS).
    pmcl: poses drawn and scored, on both back ends, and a whole localisation.
    transport: sends 200 volumes to another process (needs ROS), beside the copies that this takes.
    """
    result = bench_dlv(wanted=back_end) if name == 'dlv' else _BENCHES[name]()
    if as_json:
        click.echo(json.dumps(asdict(result)))
        return
    for line in result.lines():
        click.echo(line)
