"""`pmcl simulate`: captures of a described object in simulated scenes."""

from functools import partial
from pathlib import Path
from typing import Any

import click

from pmcl_ros.cli.base import FOLDER, check_scheduler, process_options
from pmcl_ros.cli.simulations.options import Simulated, processed, shown, simulation_options
from pmcl_ros.simulation.lytro.calibration_pictures import COUNT, write_calibration_pictures
from pmcl_ros.simulation.lytro.camera import LytroCamera
from pmcl_ros.simulation.simulated_captures import simulate as simulate_one


@click.command()
@simulation_options
@click.option('--cameras', 'plan', metavar='PLAN', help='Pictures of each scene from several '
              'poses: arc:COUNT:DEGREES about the object, grid:ROWSxCOLUMNS:METRES, or a YAML '
              'file with these or poses, and errors of the reported poses; default: one.')
@click.option('--count', type=click.IntRange(1), default=10, show_default=True, help='Scenes.')
@process_options
@click.option('-o', '--out', required=True, type=FOLDER, help='Folder; a subfolder per scene. '
              'Scenes that it has are kept.')
def simulate(count: int, jobs: int, backend: str, scheduler: str | None, out: Path, seed: int,
             force: bool, **options: Any) -> None:
    """Simulate scenes with OBJECT (YAML with `appearance`) into --out, with the true poses.

    `pmcl evaluate` and `pmcl localize` read them; `pmcl bag record` makes bags of them.
    """
    check_scheduler(backend, scheduler)
    simulated = Simulated.from_options(seed=seed, **options)
    simulation = simulated.simulation
    simulated.claim(out, seed)
    camera = simulation.camera
    if isinstance(camera, LytroCamera):
        for place in shown('calibration', COUNT, lambda progress: write_calibration_pictures(
                out, camera, force, progress)):
            click.echo(place)
    one = partial(simulate_one, folder=out.resolve(), of=simulation, force=force)
    for place in processed('scenes', one, range(seed, seed + count), jobs, backend, scheduler):
        click.echo(place)
