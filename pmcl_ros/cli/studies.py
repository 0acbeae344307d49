"""The studies as commands: `pmcl coverage`, `figures`, `profile-errors`, `together`, ..."""

import multiprocessing
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

import click
import numpy as np
from rich import progress

from pmcl_ros.cli.base import CAMERA as ORDINARY
from pmcl_ros.cli.base import FOLDER, FORCE, STDERR, counter, results_in
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.evaluation.pool import broken_pool
from pmcl_ros.evaluation.recall import median, share, values
from pmcl_ros.evaluation.results import table
from pmcl_ros.evaluation.studies.coverage import run_coverage
from pmcl_ros.evaluation.studies.figures import FIGURES, TABLES
from pmcl_ros.evaluation.studies.profile_errors import ProfileStudy, profile_trial
from pmcl_ros.evaluation.studies.profile_errors import summary as summary_of_profiles
from pmcl_ros.evaluation.studies.together import CAMERA, Together, summary
from pmcl_ros.evaluation.studies.together import together as in_scene
from pmcl_ros.evaluation.studies.tracking import (
    TRACKED,
    picture,
    play,
    recoveries,
    recovery,
    row,
)
from pmcl_ros.evaluation.studies.view_gain import ViewGainSettings
from pmcl_ros.evaluation.studies.view_gain import summary as summary_of_gains
from pmcl_ros.evaluation.studies.view_gain import view_gain as in_one_scene
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.pmcl.multi_view.next_view import CANDIDATES, CAP
from pmcl_ros.pmcl.tracking.settings import TrackingSettings
from pmcl_ros.runtime.outputs import refuse_existing, write_file
from pmcl_ros.simulation.camera_plan import CameraPlan
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera
from pmcl_ros.simulation.scenes.random_scene import KINDS, SceneSettings
from pmcl_ros.simulation.sequence import Sequence, SequenceSettings
from pmcl_ros.simulation.warm_up import RENDER
from pmcl_ros.warm_up.chain import EDGES, LAYERS, SEARCH, VOLUME
from pmcl_ros.warm_up.stage import compile_ahead

_FIELDS = SequenceSettings.model_fields


class OfSeed(Protocol):
    """What a study has of one seed."""

    @property
    def seed(self) -> int:
        """The seed."""


Done = TypeVar('Done', bound=OfSeed)


@click.command()
@click.option('--trials', type=click.IntRange(1), default=200, show_default=True)
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True)
@click.option('--near', is_flag=True, help='Start beside the truth: quicker.')
def coverage(trials: int, seed: int, near: bool) -> None:
    """Print how often the truth lies in the credible regions, on random volumes."""
    compile_ahead(STDERR, SEARCH)
    found = list(progress.track(run_coverage(trials, seed, not near), total=trials,
                                console=STDERR, description='volumes', transient=True))
    levels, lost = values(found, 'credible_level'), values(found, 'lost') > 0
    for wanted in (0.5, 0.9, 0.97):
        inside = levels <= wanted
        kept = f'{100 * share(inside[~lost]):.1f} %' if not lost.all() else 'none'
        click.echo(f'in the {100 * wanted:.0f} % region: {100 * share(inside):.1f} %; of those '
                   f'not lost: {kept}')
    click.echo(f'within 2 cm and 10 degrees: {100 * share([each.near for each in found]):.1f} %; '
               f'lost: {100 * np.mean(lost):.1f} %; median error '
               f'{median(found, "translation_mm"):.2f} mm')


@click.command()
@click.argument('folder', type=FOLDER)
@click.option('--only', type=click.Choice(list(FIGURES)), help='Only this drawing.')
@click.option('--tables', is_flag=True, help='Print their numbers too, as Markdown.')
@FORCE
def figures(folder: Path, only: str | None, tables: bool, force: bool) -> None:
    """Draw the documentation's figures into FOLDER, as PNG."""
    files = {name: folder / f'{name}.png' for name in ([only] if only else FIGURES)}
    refuse_existing(files.values(), force)
    folder.mkdir(parents=True, exist_ok=True)
    compile_ahead(STDERR, (*VOLUME, *LAYERS) if 'layers' in files else ())
    for name, file in files.items():
        write_png(file, FIGURES[name]())
        click.echo(file)
        if tables and name in TABLES:
            click.echo(TABLES[name]())


@click.command('profile-errors')
@click.option('--count', type=click.IntRange(1), default=20, show_default=True, help='Vessels.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='Vessel k is that of seed + k.')
@click.option('--camera', type=ORDINARY, help='As for `pmcl scenes render`; default: 640x480 px, '
              'fx 600.')
@click.option('--samples', type=click.IntRange(1), default=3, show_default=True,
              help='Rays per pixel.')
@click.option('--cad', is_flag=True, help='Find the vessels with their true meshes too.')
@click.option('--height', is_flag=True, help='Give the heights of vessels, with errors of 0.5 mm.')
@click.option('--processes', type=click.IntRange(1, 64), default=1, show_default=True)
@click.option('-o', '--out', type=FOLDER, help='Folder for the table (profile_errors.md).')
@FORCE
def profile_errors(count: int, seed: int, camera: Path | None, samples: int, cad: bool,
                   height: bool, processes: int, out: Path | None, force: bool) -> None:
    """Measure generated vessels as `pmcl profile` does, and find them in other scenes.

    Prints a row for each vessel: largest and mean deviation of the profile, and its expected
    standard deviation [mm]; the errors of its pose in three views of another scene, with the
    measured mesh and, with --cad, the true mesh. Errors of a lost vessel are in brackets.
    """
    written = None if out is None else results_in(out, force).path('profile_errors.md')
    ordinary = OrdinaryCamera.make(CAMERA) if camera is None else OrdinaryCamera.load(camera)
    compile_ahead(STDERR, (*SEARCH, *RENDER))
    run = partial(profile_trial, of=ProfileStudy(
        ordinary, samples, with_cad=cad, with_height=height))
    _tabulate(run, range(seed, seed + count), processes, 'vessels', summary_of_profiles, written)


@click.command()
@click.option('--count', type=click.IntRange(1), default=20, show_default=True, help='Scenes.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='Scene k is that of seed + k.')
@click.option('--objects', type=click.IntRange(2, 5), default=3, show_default=True,
              help='Objects in each scene; one more is looked for, which is not there.')
@click.option('--views', type=click.IntRange(3), default=5, show_default=True,
              help='Side of the square of views, odd.')
@click.option('--size', type=click.IntRange(16), default=328, show_default=True,
              help='Side of a view [px].')
@click.option('--samples', type=click.IntRange(1), default=1, show_default=True,
              help='Rays per pixel and view.')
@click.option('--cameras', metavar='PLAN', help='Posed views of an ordinary camera of 640x480 px, '
              'as for `pmcl scenes render`: arc:3:40. Default: a light field.')
@click.option('--processes', type=click.IntRange(1, 64), default=1, show_default=True)
@click.option('-o', '--out', type=FOLDER,
              help='Folder for a picture of each scene, and the table.')
@FORCE
def together(count: int, seed: int, objects: int, views: int, size: int, samples: int,
             cameras: str | None, processes: int, out: Path | None, force: bool) -> None:
    """Localise the objects of scenes in which some hide others: jointly, and each alone.

    Prints a row for each scene: errors of the origins in mm, in brackets where the object is
    reported as lost. At least two of the objects overlap in the image; some are copies.
    """
    settings = SceneSettings.make({'views': views, 'size': size, 'near': 0.5, 'far': 0.8},
                                  'pmcl together')
    results, seeds = None if out is None else results_in(out, force), range(seed, seed + count)
    if results is not None:
        results.reserve('results.md', *(f'{each:06d}.png' for each in seeds))
    compile_ahead(STDERR, (*SEARCH, *RENDER, *(EDGES if cameras is None else ())))
    run = partial(in_scene, count=objects, settings=settings, samples=samples,
                  plan=None if cameras is None else CameraPlan.parse(cameras))

    def draw(scene: Together) -> None:
        if results is not None:
            write_png(results.path(f'{scene.seed:06d}.png'), scene.picture)

    _tabulate(run, seeds, processes, 'scenes', summary,
              None if results is None else results.path('results.md'), draw)


def _tabulate(run: Callable[[int], Done], seeds: range, processes: int, what: str,
              text: Callable[[list[Done]], str], written: Path | None,
              keep: Callable[[Done], None] = lambda _: None) -> None:
    """Run all seeds, which are of `what`, and print the text of all.

    written: gets the text of those that are done. keep: called with each.
    """
    done: list[Done] = []
    for each in progress.track(_all(run, seeds, processes), total=len(seeds), console=STDERR,
                               transient=True, description=what):
        done = sorted([*done, each], key=lambda one: one.seed)
        keep(each)
        if written is not None:
            write_file(written, text(done) + '\n')
    click.echo(text(done))


def _all(run: Callable[[int], Done], seeds: Iterable[int], processes: int) -> Iterator[Done]:
    """Of each seed, as soon as it is done."""
    if processes == 1:
        yield from map(run, seeds)
        return
    # Spawned, not forked: numba's threads do not survive a fork.
    pool = ProcessPoolExecutor(processes, multiprocessing.get_context('spawn'))
    try:
        for job in as_completed([pool.submit(run, each) for each in seeds]):
            yield job.result()
    except BrokenProcessPool:
        raise broken_pool(processes) from None
    finally:  # after an error, or Ctrl-C, what has not begun is not begun
        pool.shutdown(cancel_futures=True)


@click.command('view-gain')
@click.option('--count', type=click.IntRange(1), default=20, show_default=True, help='Scenes.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='Scene k is that of seed + k.')
@click.option('--kind', 'kinds', multiple=True, type=click.Choice(KINDS), default=['glass'],
              show_default=True, help='Kind of the scenes; may be repeated.')
@click.option('--camera', type=ORDINARY, help='As for `pmcl scenes render`; default: 640x480 px, '
              'fx 600.')
@click.option('--samples', type=click.IntRange(1), default=3, show_default=True,
              help='Rays per pixel.')
@click.option('--apart', type=click.FloatRange(0, 180, min_open=True), default=10.0,
              show_default=True, help='Angle between the first two views [deg].')
@click.option('--cap', type=click.FloatRange(1, 360), default=CAP, show_default=True,
              help='As for `pmcl next-view`.')
@click.option('--candidates', type=click.IntRange(1, 10_000), default=CANDIDATES,
              show_default=True, help='Number of candidates on this cap.')
@click.option('--processes', type=click.IntRange(1, 64), default=1, show_default=True)
@click.option('-o', '--out', type=FOLDER, help='Folder for the table (view_gain.md).')
@FORCE
def view_gain(count: int, seed: int, kinds: tuple[str, ...], camera: Path | None, samples: int,
              apart: float, cap: float, candidates: int, processes: int, out: Path | None,
              force: bool) -> None:
    """Compare the next view of `pmcl next-view` with a random one, in generated scenes.

    Prints a row for each scene: the error by two views, by these and the best candidate, and by
    these and a random candidate. Each has the largest standard deviation of the position after ±,
    and the one expected before the view was taken [mm]. Candidates beyond the table or the wall
    are left out.
    """
    written = None if out is None else results_in(out, force).path('view_gain.md')
    ordinary = OrdinaryCamera.make(CAMERA) if camera is None else OrdinaryCamera.load(camera)
    scenes = SceneSettings.make({'kinds': kinds, 'empty': 0.0, 'views': 3,
                                 'field': min(ordinary.field, 1.5)}, 'pmcl view-gain')
    compile_ahead(STDERR, (*SEARCH, *RENDER))
    run = partial(in_one_scene, of=ViewGainSettings(scenes, ordinary, samples, apart, cap,
                                                    candidates))
    _tabulate(run, range(seed, seed + count), processes, 'scenes', summary_of_gains, written)


@click.command()
@click.option('--count', type=click.IntRange(1), default=3, show_default=True, help='Sequences.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='Sequence k is that of seed + k.')
@click.option('--model', type=click.Choice(['constant_pose', 'constant_velocity', 'camera']),
              default='constant_velocity', show_default=True,
              help=TrackingSettings.model_fields['tracking'].description)
@click.option('--every', type=click.IntRange(0), default=4, show_default=True, metavar='N',
              help='Localise each N-th frame by itself too; 0: none.')
@click.option('--frames', type=click.IntRange(1), default=_FIELDS['frames'].default,
              show_default=True, help=_FIELDS['frames'].description)
@click.option('--occluded', type=click.IntRange(0), show_default=True,
              default=_FIELDS['occluded'].default, help=_FIELDS['occluded'].description)
@click.option('--size', type=click.IntRange(32), default=_FIELDS['size'].default,
              show_default=True, help=_FIELDS['size'].description)
@click.option('--object-speed', type=click.FloatRange(0), show_default=True,
              default=_FIELDS['object_speed'].default, help=_FIELDS['object_speed'].description)
@click.option('--camera-speed', type=click.FloatRange(0), show_default=True,
              default=_FIELDS['camera_speed'].default, help=_FIELDS['camera_speed'].description)
@click.option('-o', '--out', type=FOLDER, help='Folder for the table (track.md) and a drawing of '
              'the errors over frames for each sequence.')
@FORCE
def track(count: int, seed: int, model: str, every: int, frames: int, occluded: int,
          size: int, object_speed: float, camera_speed: float, out: Path | None,
          force: bool) -> None:
    """Track an object through generated sequences (`pmcl scenes sequence`); print the errors.

    Errors, shares and times of single shots are of the frames that were localised both ways.
    """
    settings = SequenceSettings.make(
        {'frames': frames, 'occluded': occluded, 'size': size, 'object_speed': object_speed,
         'camera_speed': camera_speed}, 'pmcl track')
    results = None if out is None else results_in(out, force)
    if results is not None:
        results.reserve('track.md', *(f'track_{k:03d}.png' for k in range(seed, seed + count)))
    compile_ahead(STDERR, (*SEARCH, *EDGES))
    rows: list[dict[str, str]] = []
    played: list[list[Trial]] = []
    with counter() as bar:
        task = bar.add_task('', total=count * frames)
        for number in range(seed, seed + count):
            sequence = Sequence(number, settings)
            name = f'{number}: {sequence.kind} {sequence.model.name}'
            bar.update(task, description=name)
            trials: list[Trial] = []
            for each in play(sequence, model, every):  # type: ignore[arg-type]
                trials.append(each)
                bar.update(task, advance=each.mode == TRACKED)
            played.append(trials)
            rows.append(row(name, [trials]))
            shown = [*rows, row('all', played)]
            text = '\n\n'.join([table(list(shown[0]), [list(line.values()) for line in shown]),
                                recoveries([recovery(each) for each in played])])
            if results is not None:  # at once: a sequence takes minutes
                write_png(results.path(f'track_{number:03d}.png'), picture(name, trials))
                write_file(results.path('track.md'), text + '\n')
    click.echo(text)
