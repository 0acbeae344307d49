"""`pmcl bench`: times the stages, against their plain forms run beside them."""

import json
from dataclasses import asdict
from importlib import import_module

import click

from pmcl_ros.cli.base import STDERR
from pmcl_ros.dlv.settings import BackEnd
from pmcl_ros.warm_up.stage import Stages, compile_ahead

_MODULES = {'chain': 'chain', 'decode': 'decode', 'dlv': 'dlv', 'driver': 'driver',
            'graph': 'ros_programs', 'map': 'map', 'pmcl': 'pmcl', 'transport': 'ros_programs',
            'views': 'views'}


@click.command()
@click.argument('name', type=click.Choice(sorted(_MODULES)))
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
@click.option('--back-end', type=click.Choice(['auto', 'numba', 'gl']), default='numba',
              show_default=True, help='For dlv: what computes the volume.')
def bench(name: str, as_json: bool, back_end: BackEnd) -> None:
    """Time one stage, and beside it a plain form of the same where there is one.

    \b
    chain      from a raw picture's bytes to the pose, without ROS
    decode     from a raw picture to views: time and memory
    dlv        from views to likelihoods, step by step; --back-end gl: on the
               GPU too
    driver     200 pictures of a simulated camera, over a link that drops
    graph      from shutter to pose by the nodes, and without ROS (needs ROS)
    map        the contour map of pictures and of a light field, and from a
               picture to the pose
    pmcl       poses drawn and scored by each back end; a whole localisation
    transport  200 volumes to another process, and copies of their data alone
               (needs ROS)
    views      the pose in one to nine posed views: by a search of the region,
               and from the last pose
    """
    if back_end != 'numba' and name != 'dlv':
        raise click.UsageError(f'--back-end is of dlv alone, not of {name}')
    module = import_module(f'pmcl_ros.evaluation.bench.{_MODULES[name]}')
    options = {'wanted': back_end} if name == 'dlv' else {}
    compile_ahead(STDERR, _stages(name))
    result = getattr(module, f'bench_{name}')(**options)
    if as_json:
        click.echo(json.dumps(asdict(result)))
        return
    for line in result.lines():
        click.echo(line)


def _stages(name: str) -> Stages:
    """The kernels that are timed; driver and transport have none."""
    from pmcl_ros.simulation.warm_up import RENDER  # here: both import much that --help leaves
    from pmcl_ros.warm_up import chain as of
    from pmcl_ros.warm_up.raw import DECODE
    stages: dict[str, Stages] = {
        'chain': (*of.SEARCH, *DECODE, *of.EDGES), 'decode': DECODE,
        'dlv': (*of.VOLUME, *of.LAYERS, *of.EDGES), 'graph': of.CHAIN,
        'map': (*of.SEARCH, *of.EDGES, *RENDER), 'pmcl': (*of.SEARCH, *of.FILTER),
        'views': (*of.SEARCH, *RENDER)}
    return stages.get(name, ())
