"""`pmcl bench`: times the stages, against their plain forms run beside them."""

import json
from dataclasses import asdict
from importlib import import_module

import click

from pmcl_ros.dlv.settings import BackEnd

_MODULES = {'chain': 'chain', 'decode': 'decode', 'dlv': 'dlv', 'driver': 'driver',
            'graph': 'ros_programs', 'pmcl': 'pmcl', 'transport': 'ros_programs',
            'views': 'views'}


@click.command()
@click.argument('name', type=click.Choice(sorted(_MODULES)))
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
@click.option('--back-end', type=click.Choice(['auto', 'numba', 'gl']), default='numba',
              show_default=True, help='For dlv: what computes the volume.')
def bench(name: str, as_json: bool, back_end: BackEnd) -> None:
    """Time a stage against its plain form, run beside it.

    chain: a raw picture's bytes to views, evidence and pose, of a shipped bag.
    dlv: from uint8 views to likelihoods, stage by stage; with gl the time on the GPU alone, too.
    driver: takes and downloads 200 pictures from a simulated camera, over a link that drops.
    graph: from shutter to pose through the nodes, beside the same without ROS (needs ROS).
    pmcl: poses drawn and scored, on both back ends, and a whole localisation.
    transport: sends 200 volumes to another process (needs ROS), beside the copies that this takes.
    views: the pose in one to nine posed views, searched anew and from the last pose.
    """
    if back_end != 'numba' and name != 'dlv':
        raise click.UsageError(f'--back-end is of dlv alone, not of {name}')
    module = import_module(f'pmcl_ros.evaluation.bench.{_MODULES[name]}')
    options = {'wanted': back_end} if name == 'dlv' else {}
    result = getattr(module, f'bench_{name}')(**options)
    if as_json:
        click.echo(json.dumps(asdict(result)))
        return
    for line in result.lines():
        click.echo(line)
