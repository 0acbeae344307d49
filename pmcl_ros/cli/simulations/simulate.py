"""`pmcl simulate`: captures of a described object in simulated scenes."""

from functools import partial
from pathlib import Path
from typing import Any

import click

from pmcl_ros.cli.base import FOLDER, STDERR, check_scheduler, process_options
from pmcl_ros.cli.simulations.estimate import Work
from pmcl_ros.cli.simulations.options import Simulated, processed, shown, simulation_options
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.simulation.described.ring_sheet import RingSheet
from pmcl_ros.simulation.lytro.calibration_pictures import (
    COUNT,
    pictures_to_make,
    write_calibration_pictures,
)
from pmcl_ros.simulation.lytro.camera import LytroCamera
from pmcl_ros.simulation.simulated_captures import simulate as simulate_one
from pmcl_ros.warm_up.stage import compile_ahead


@click.command()
@simulation_options
@click.option('--cameras', 'plan', metavar='PLAN', help='Pictures of each scene from several '
              'poses: arc:COUNT:DEGREES about the object, grid:ROWSxCOLUMNS:METRES, or a YAML '
              'file with these or poses, and errors of the reported poses; default: one.')
@click.option('--ring', metavar='COLUMNSxROWS', help='A ring of markers around the object, as '
              '8x11: pmcl board-poses finds it in pictures of --cameras. Truth is in its frame.')
@click.option('--square', type=float, help='Side of its squares [m].')
@click.option('--count', type=click.IntRange(1), default=10, show_default=True, help='Scenes.')
@process_options
@click.option('-o', '--out', required=True, type=FOLDER, help='Folder; a subfolder per scene. '
              'Scenes that it has are kept.')
def simulate(ring: str | None, square: float | None, count: int, jobs: int, backend: str,
             scheduler: str | None, out: Path, seed: int, force: bool, **options: Any) -> None:
    """Simulate scenes with OBJECT (YAML with `appearance`) into --out, with the true poses.

    `pmcl evaluate` and `pmcl localize` read them; `pmcl bag record` makes bags of them.
    """
    check_scheduler(backend, scheduler)
    if (ring is None) != (square is None):
        raise click.UsageError('--ring and --square go together, as --ring 8x11 --square 0.024')
    laid = (None if ring is None or square is None
            else RingSheet.from_ring(CharucoRing.parse(ring, square)))
    simulated = Simulated.from_options(seed=seed, ring=laid, **options)
    simulation = simulated.simulation
    seeds = range(seed, seed + count)
    scenes = simulated.to_make(seeds, out, force)  # first: what cannot be made takes no folder
    simulated.claim(out, seed)
    compile_ahead(STDERR, simulated.stages)
    camera = simulation.camera
    Work(len(scenes), calibration=pictures_to_make(out, force) if isinstance(camera, LytroCamera)
         else 0).print_time(simulation, jobs, backend)
    if isinstance(camera, LytroCamera):
        for place in shown('calibration', COUNT, lambda progress: write_calibration_pictures(
                out, camera, force, progress)):
            click.echo(place)
    one = partial(simulate_one, folder=out.resolve(), of=simulation, force=force)
    for place in processed('scenes', one, seeds, jobs, backend, scheduler):
        click.echo(place)
