"""`pmcl feasibility`: will it work for this object and this camera?"""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click

from pmcl_ros.cli.base import FOLDER, check_scheduler, process_options, results_in
from pmcl_ros.cli.simulations.estimate import Work
from pmcl_ros.cli.simulations.options import (
    Simulated,
    aim_options,
    minutes,
    processed,
    shown,
    simulation_options,
)
from pmcl_ros.cli.sources import Search
from pmcl_ros.evaluation.feasibility.findings import Aim
from pmcl_ros.evaluation.feasibility.page import Feasibility
from pmcl_ros.evaluation.feasibility.page import page as page_of
from pmcl_ros.evaluation.feasibility.scene_trials import missing, scene_trials
from pmcl_ros.evaluation.feasibility.view_sets import ViewSet, view_sets
from pmcl_ros.evaluation.results import table
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.outputs import write_file
from pmcl_ros.simulation.lytro.calibration_pictures import write_calibration
from pmcl_ros.simulation.lytro.camera import F01, F01_RAW, LytroCamera
from pmcl_ros.simulation.simulated_captures import Simulation, place_of, simulate

_PLAN = 'arc:3:30'
NAME = 'feasibility.html'


@click.command()
@simulation_options
@click.option('--cameras', 'plan', metavar='PLAN', show_default=_PLAN,
              help='Poses of an ordinary camera: arc:COUNT:DEGREES about the object, '
              'grid:ROWSxCOLUMNS:METRES, or a YAML file with these or poses, and the errors of '
              'the arm that tells them.')
@click.option('--scenes', 'count', type=click.IntRange(1), default=20, show_default=True,
              help='More make intervals narrower; those that are there are kept.')
@aim_options
@click.option('--share', type=click.FloatRange(0, 1, min_open=True), default=Aim().share,
              show_default=True, help='Share of the scenes that has to be good enough.')
@process_options
@click.option('-o', '--out', required=True, type=FOLDER, help=f'Folder for {NAME} and the scenes.')
def feasibility(count: int, millimetres: float, degrees: float, share: float, jobs: int,
                backend: str, scheduler: str | None, out: Path, seed: int, plan: str | None,
                camera: str, object_file: Path, force: bool, **options: Any) -> None:
    """Simulate scenes with OBJECT, localise it in each, and write one page.

    The page says how often and how exactly it is found, by number of views and how far they are
    apart, by distance and surroundings, and what to mount.
    """
    check_scheduler(backend, scheduler)
    is_lytro = camera in (F01, F01_RAW)
    if is_lytro and plan is not None:
        raise click.UsageError(f'--cameras {plan}: several poses are of an ordinary camera')
    wanted = None if is_lytro else plan or _PLAN
    simulated = Simulated.from_options(wanted, object_file=object_file, camera=camera, seed=seed,
                                       **options)
    of = simulated.simulation
    written = results_in(out, force).path(NAME)
    model, sets = ObjectModel.load(object_file), view_sets(of.plan)
    scenes = out / 'scenes'
    seeds = range(seed, seed + count)
    to_make = simulated.to_make(seeds, scenes, force)
    simulated.claim(scenes, seed)
    to_search = [each for each in seeds
                 if each not in to_make and missing(place_of(each, scenes), sets)]
    click.echo(f'{len(to_make)} of {count} scenes to make, {len(to_search)} more to search in',
               err=True)
    Work(len(to_make), len(sets) * (len(to_make) + len(to_search))).print_time(of, jobs, backend)
    Search().compile_kernels(raw=is_lytro, pictures=not is_lytro, also=simulated.stages)
    if isinstance(of.camera, LytroCamera) and (to_make or to_search):
        _calibrated(scenes, of.camera, force)
    one = partial(_studied, folder=scenes.resolve(), of=of, model=model, sets=sets, force=force)
    begun = time.perf_counter()
    for number, done in enumerate(processed('scenes', one, to_make + to_search, jobs, backend,
                                            scheduler)):
        taken = time.perf_counter() - begun
        searching = sum(each.seconds for each in done) if to_make else taken
        left = (len(to_make) * taken + len(to_search) * searching) / jobs - taken
        if number == 0 and left > 0 and backend == 'loky':  # a cluster's workers are not known
            click.echo(f'about {minutes(left)} more: the first scene took {minutes(taken)}',
                       err=True)
    trials: dict[str, list[Trial]] = {each.name: [] for each in sets}
    for each in seeds:
        for trial in scene_trials(place_of(each, scenes), model, sets):
            trials[trial.mode].append(trial)
    about = simulated.about | {'seeds': f'{seed} to {seed + count - 1}'}
    study = Feasibility(model, about, sets, trials, Aim(millimetres, degrees, share), scenes)
    write_file(written, page_of(study))
    click.echo(table(*study.table()))
    click.echo(f'\n{study.recommendation}')
    click.echo(written)


def _calibrated(scenes: Path, camera: LytroCamera, force: bool) -> None:
    """Write what raw pictures are decoded by."""
    def work(progress: Callable[[float], None]) -> Iterator[Path]:
        write_calibration(scenes, camera, force, progress)
        yield scenes
    list(shown('white image', 1, work))


def _studied(seed: int, folder: Path, of: Simulation, model: ObjectModel,
             sets: Sequence[ViewSet], force: bool,
             progress: Callable[[float], None] = lambda _: None) -> list[Trial]:
    return scene_trials(simulate(seed, folder, of, progress, force), model, sets, force)
