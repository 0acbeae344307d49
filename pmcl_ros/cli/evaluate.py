"""`pmcl evaluate`: measures errors over a folder of captures with truth."""

import contextlib
import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import click

from pmcl_ros.camera.files import list_pictures
from pmcl_ros.cli.base import (
    FILE,
    FOLDER,
    FORCE,
    STDERR,
    WHITE,
    Needed,
    calibration_type,
    counter,
    results_in,
)
from pmcl_ros.cli.cameras.calibrate import run_calibration
from pmcl_ros.cli.sources import GivenReading, Search, reading_options
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.evaluation.bop_captures import (
    BopCapture,
    BopChoice,
    bop_captures,
    bop_scenes,
)
from pmcl_ros.evaluation.captures import Capture, find_captures, select
from pmcl_ros.evaluation.pool import run_jobs
from pmcl_ros.evaluation.records import TrialsFile, settings, write_bop
from pmcl_ros.evaluation.result_charts import pictures
from pmcl_ros.evaluation.results import by_row, markdown
from pmcl_ros.evaluation.trial_plan import TrialPlan
from pmcl_ros.evaluation.trials import Camera, Job, Trial
from pmcl_ros.evaluation.variants import Variant, sweep
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.messages.bags import is_bag
from pmcl_ros.runtime.errors import CameraError, SettingsError
from pmcl_ros.runtime.outputs import Results, write_file

_INTERRUPTED = 130  # exit status, as of a shell's command
_RESULTS = ('results.csv', 'results.md', 'settings.json', 'success.png', 'errors.png',
            'coverage.png', 'time.png')


@click.command()
@click.argument('captures', type=Needed('pmcl scenes render makes captures with truth: '
                                        'docs/howto/evaluation.md', folder=True))
@click.option('--calibration', type=calibration_type, metavar='FILE|NAME',
              help='For raw pictures: calibration of the camera, a YAML file or the name given to '
              'pmcl calibrate --camera.')
@click.option('--white', type=WHITE, help='White image, or a folder of white images; default: '
              'CAPTURES/white.')
@click.option('--corners', default='10x7', show_default=True, metavar='COLUMNSxROWS',
              help='Without --calibration: inner corners of the checkerboard in CAPTURES.')
@click.option('--square', default=0.011, show_default=True, type=float,
              help='Without --calibration: side of the squares of the checkerboard [m].')
@click.option('--modes', default='default', show_default=True, help='Rows of the tables, '
              'separated by commas: default; faithful, the filter of the paper; edges, map, by '
              'this evidence alone; centre, map-centre, by edges or map of the centre view alone; '
              'map-no-sides, map-no-directions, map-one-depth, by the map without this part; '
              'map-inside, by the map with the inside of solids.')
@click.option('--set', 'changes', multiple=True, metavar='KEY=VALUE,...', help='One more row, the '
              "default with other values of the search's or the volume's parameters; with "
              'row=faithful, that row with other values.')
@click.option('--sweep', 'sweeps', multiple=True, metavar='KEY=VALUE,VALUE,...', help='One more '
              'row for each value, and a drawing of accuracy over time.')
@click.option('--trials', type=click.IntRange(1), default=10, show_default=True, help='Seeds.')
@click.option('--only', multiple=True, metavar='NAME', help='Only this capture.')
@click.option('--wrong-objects', is_flag=True, help='Search each capture also for an object '
              'of another capture, with each seed for a different one: it should be lost.')
@click.option('--object-id', 'object_ids', multiple=True, type=click.IntRange(0), metavar='N',
              help='For a BOP data set: only this object.')
@click.option('--views', type=click.IntRange(1), help='For a BOP data set whose cameras have '
              'poses: number of pictures that are localised together.  [default: 5]')
@click.option('--targets', type=FILE, help='For a BOP data set: only the pictures and objects '
              'of this list, as test_targets_bop19.json.')
@click.option('--processes', type=click.IntRange(1, 256), help='Default: the number of cores. '
              'Times are reliable with 1 only, on a quiet machine.')
@click.option('-o', '--out', type=FOLDER, help='Folder for all trials (results.csv), tables '
              "(results.md), poses in BOP's format (bop_*.csv), charts (PNG) and what they were "
              'made with (settings.json).')
@reading_options
@FORCE
def evaluate(captures: Path, calibration: Path | None, white: Path | None, corners: str,
             square: float, modes: str, changes: tuple[str, ...], sweeps: tuple[str, ...],
             trials: int, only: tuple[str, ...], wrong_objects: bool,
             object_ids: tuple[int, ...], views: int | None, targets: Path | None,
             processes: int | None, out: Path | None, given: GivenReading, force: bool) -> None:
    """Localise CAPTURES (subfolders with a picture, model.obj, truth.json), and report the errors.

    CAPTURES may be of a BOP data set too: a scene with scene_camera.json and scene_gt.json, or a
    folder of scenes. Without camera poses each picture is localised alone.

    A picture may be whatever `pmcl localize` takes. Raw pictures need a calibration: without
    --calibration the camera is calibrated first, from the checkerboards in CAPTURES.

    Ctrl-C ends it with exit status 130, and prints the tables of the finished trials.
    """
    chosen = _read_by(given, select(_find(captures, object_ids, views, targets), only, captures),
                      captures)
    others = _find(captures, (), views, None) if wrong_objects else []
    variants = [*map(Variant.named, modes.split(',')), *map(Variant.parse, changes),
                *(row for each in sweeps for row in sweep(each))]
    rows = {each.name: each for each in variants}  # of a row that is given twice, a sweep's
    results = None if out is None else results_in(out, force)
    if results is not None:  # first: the rest takes minutes
        results.reserve(*_RESULTS, *(_bop_name(each) for each in rows))
    for mode, kind in dict.fromkeys((each.mode, each.evidence) for each in (
            row.search(chosen[0]) for row in rows.values())):
        Search(mode, kind).compile_kernels(any(each.picture is not None for each in chosen),
                                           all(each.has_pictures for each in chosen))
    camera = _camera(captures, chosen, calibration, white, corners, square)
    plan = TrialPlan(tuple(chosen), tuple(rows.values()), tuple(range(trials)),
                     tuple(others))
    jobs = plan.jobs()
    count = min(processes or os.cpu_count() or 1, len(jobs))
    done: list[Trial] = []
    if results is not None:
        results.remove_earlier()  # no chart and no row of another run stays
    started = time.perf_counter()
    try:
        with _interruptible() as stop:
            _run(jobs, camera, count, stop.is_set, done, results)
    finally:
        if done:
            _report(plan, done, results)
            if results is not None:
                files = [each for each in (calibration, given.collect) if each is not None]
                files += [] if camera is None else list_pictures(camera[1])
                used = settings(plan, {each.name: each for each in files} | given.mask_files,
                                count, time.perf_counter() - started)
                write_file(results.path('settings.json'), json.dumps(used, indent=1) + '\n')
    if stop.is_set():
        STDERR.print(f'interrupted after {len(done)} of {len(jobs)} trials')
        raise SystemExit(_INTERRUPTED)


def _find(folder: Path, object_ids: tuple[int, ...], views: int | None, targets: Path | None
          ) -> list[Capture]:
    """The captures of a folder, or of the BOP scenes there. Raises UsageError, PmclError."""
    if scenes := bop_scenes(folder):
        choice = BopChoice(views or BopChoice.views, object_ids, targets)
        found: list[Capture] = [*bop_captures(scenes, choice)]
        if not found:
            raise SettingsError(
                f'{folder}: its {len(scenes)} scenes show no object of --object-id and --targets '
                'by a tenth or more; scene_gt.json and scene_gt_info.json say what they show')
        return found
    if object_ids or views or targets:
        raise click.UsageError(f'{folder} has no BOP scene with scene_camera.json and '
                               'scene_gt.json: --object-id, --views and --targets are of those')
    return find_captures(folder)


def _read_by(given: GivenReading, captures: Sequence[Capture], folder: Path) -> list[Capture]:
    """The captures, read as options say; UsageError for options that are for none of them."""
    reading = given.reading([each.source for each in captures], f'{folder} has')
    if (given.every, given.shrink) != (1, 1) and all(
            each.picture is not None or is_bag(each.source) for each in captures):
        raise click.UsageError(f'{folder} has only raw pictures or bags: --every and --shrink '
                               'are for light fields and ordinary pictures')
    if given.every != 1 and any(isinstance(each, BopCapture) for each in captures):
        raise click.UsageError(f'{folder}: pictures of BOP scenes are chosen by --views and '
                               '--targets; leave out --every')
    if reading.errors is not None and not any(each.may_be_posed for each in captures):
        raise click.UsageError(f'{folder} has no pictures with poses of their cameras: --sigma-mm '
                               'and --sigma-deg are errors of such')
    return [replace(each, reading=reading) for each in captures]


@contextlib.contextmanager
def _interruptible() -> Iterator[threading.Event]:
    """An event that Ctrl-C and SIGTERM set; a second time they interrupt at once."""
    stop = threading.Event()

    def ask(number: int, _: object) -> None:
        stop.set()
        signal.signal(number, signal.default_int_handler)

    before = {each: signal.signal(each, ask) for each in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _camera(captures: Path, chosen: Sequence[Capture], calibration: Path | None,
            white: Path | None, corners: str, square: float) -> Camera | None:
    """The camera of raw pictures, calibrated first if need be; None where there are none."""
    if all(each.picture is None for each in chosen):
        return None
    if white is None:  # one picture, or a folder of which each picture takes what fits it
        white = captures / 'white'
        if not white.exists():
            raise CameraError(f'raw pictures need a white image: there is no {white}; give '
                              'it by --white')
        there = list_pictures(white)
        white = there[0] if len(there) == 1 else white
    if calibration is None:
        board = Checkerboard.parse(corners, square)
        return run_calibration(white, captures, board).calibration, white
    return Calibration.load(calibration), white


def _run(jobs: Sequence[Job], camera: Camera | None, processes: int, stopped: Callable[[], bool],
         done: list[Trial], results: Results | None) -> None:
    """Do all jobs; append each trial to `done`, and to results.csv."""
    with contextlib.ExitStack() as stack:
        bar = stack.enter_context(counter())
        task = bar.add_task('', total=len(jobs))
        file = None if results is None else stack.enter_context(
            TrialsFile(results.path('results.csv')))
        trials = run_jobs(jobs, camera, processes, stopped)
        for trial in stack.enter_context(contextlib.closing(trials)):
            done.append(trial)
            bar.update(task, advance=1, description=f'{trial.capture}, {trial.mode}')
            if file is not None:
                file.add(trial)


def _report(plan: TrialPlan, done: list[Trial], results: Results | None) -> None:
    """Print the tables; write all files, in an order that does not depend on the processes."""
    modes = [each.name for each in plan.variants]
    done.sort(key=lambda each: (each.capture, modes.index(each.mode), each.wrong, each.seed))
    table = markdown(done)
    click.echo(table)
    if results is not None:
        write_file(results.path('results.md'), table + '\n')
        with TrialsFile(results.path('results.csv')) as file:
            for each in done:
                file.add(each)
        for mode, rows in by_row(done).items():
            write_bop(results.path(_bop_name(mode)), rows, plan)
        for name, picture in pictures(done, plan.variants).items():
            write_png(results.path(f'{name}.png'), picture)


def _bop_name(mode: str) -> str:
    return f'bop_{"".join(c if c.isalnum() or c in ".-=" else "_" for c in mode)}.csv'
