"""`pmcl feasibility`: will it work for this object and this camera?"""

from pathlib import Path
from typing import Any

import click
from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

from pmcl_ros.cli.base import FOLDER, STDERR, results_in
from pmcl_ros.cli.simulations.options import (
    Simulated,
    aim_options,
    minutes,
    simulation_options,
)
from pmcl_ros.evaluation.feasibility.findings import Aim
from pmcl_ros.evaluation.feasibility.page import Feasibility
from pmcl_ros.evaluation.feasibility.page import page as page_of
from pmcl_ros.evaluation.feasibility.scene_trials import scene_trials
from pmcl_ros.evaluation.feasibility.view_sets import view_sets
from pmcl_ros.evaluation.results import table
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.simulation.simulated_captures import is_there, place_of, simulate

_SEARCH = 2.5  # s: of one set of views, roughly
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
@click.option('-o', '--out', required=True, type=FOLDER, help=f'Folder for {NAME} and the scenes.')
def feasibility(count: int, millimetres: float, degrees: float, share: float, out: Path, seed: int,
                plan: str | None, camera: str, thing: Path, force: bool, **options: Any) -> None:
    """Simulate scenes with OBJECT, localise it in each, and write one page.

    The page says how often and how exactly it is found, by number of views and how far they are
    apart, by distance and surroundings, and what to mount.
    """
    if camera == 'f01-raw':
        raise click.UsageError('--camera f01-raw: a study takes light fields, f01; pmcl simulate '
                               'and pmcl evaluate take raw pictures')
    if camera == 'f01' and plan is not None:
        raise click.UsageError(f'--cameras {plan}: several poses are of an ordinary camera')
    wanted = None if camera == 'f01' else plan or _PLAN
    simulated = Simulated.from_options(wanted, thing=thing, camera=camera, seed=seed, **options)
    of = simulated.simulation
    written = results_in(out, force).path(NAME)
    model, sets = ObjectModel.load(thing), view_sets(of.plan)
    searches = _SEARCH * len(sets)
    scenes = out / 'scenes'
    simulated.claim(scenes, seed)
    drawn = simulated.seconds_a_scene(seed)
    left = sum(not is_there(place_of(seed + number, scenes)) for number in range(count))
    click.echo(f'{left} of {count} scenes to make: about {minutes(left * (drawn + searches))}, '
               f'{minutes(left * drawn)} of it for pictures', err=True)
    trials: dict[str, list[Trial]] = {each.name: [] for each in sets}
    with Progress(*Progress.get_default_columns()[:-1], MofNCompleteColumn(),
                  TimeRemainingColumn(), console=STDERR, transient=True) as bar:
        task = bar.add_task('scenes', total=count)
        for number in range(count):
            place = simulate(seed + number, scenes, of, force=force)
            for each in scene_trials(place, model, sets, force):
                trials[each.mode].append(each)
            bar.advance(task)
    about = simulated.about | {'seeds': f'{seed} to {seed + count - 1}'}
    study = Feasibility(model, about, sets, trials, Aim(millimetres, degrees, share), scenes)
    written.write_text(page_of(study), encoding='utf-8')
    click.echo(table(*study.table()))
    click.echo(f'\n{study.recommendation}')
    click.echo(written)
