"""`pmcl evaluate`: errors over a folder of captures with truth."""

from pathlib import Path

import click
from rich.progress import Progress

from pmcl_ros.camera.files import is_picture, list_pictures
from pmcl_ros.cli.base import FILE, FOLDER, PATH, STDERR, open_decoders
from pmcl_ros.cli.calibrate import run_calibration
from pmcl_ros.evaluation.trials import Trial, find_captures, markdown, run_trials, write_csv
from pmcl_ros.lightfield.boards import Checkerboard
from pmcl_ros.lightfield.calibration import Calibration
from pmcl_ros.pmcl.settings import PmclSettings


@click.command()
@click.argument('captures', type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option('--calibration', type=FILE, help='Calibration of the camera of raw pictures, YAML.')
@click.option('--white', type=PATH, help='White image, or a folder of such; default: the one in '
              'CAPTURES/white.')
@click.option('--corners', default='10x7', show_default=True, metavar='COLUMNSxROWS',
              help='Without --calibration: inner corners of the checkerboard in CAPTURES.')
@click.option('--square', default=0.011, show_default=True, type=float,
              help='Without --calibration: side of its squares [m].')
@click.option('--modes', default='default', show_default=True, help='Modes, separated by commas.')
@click.option('--trials', type=click.IntRange(1), default=10, show_default=True, help='Seeds.')
@click.option('--only', multiple=True, metavar='NAME', help='Only this capture.')
@click.option('--out', type=FOLDER, help='Folder for results.csv and results.md.')
def evaluate(captures: Path, calibration: Path | None, white: Path | None, corners: str,
             square: float, modes: str, trials: int, only: tuple[str, ...],
             out: Path | None) -> None:
    """Localise CAPTURES (subfolders with a picture, model.obj, truth.json), and tell errors.

    Without --calibration the camera is calibrated first, from the pictures of a checkerboard that
    lie there too. A picture may be a light field, as `pmcl localize` takes: it needs none.
    """
    folders = [each for each in find_captures(captures) if not only or each.name in only]
    decoders = None
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)  # first: the rest takes minutes
    if any(is_picture(file) for folder in folders for file in folder.iterdir()):
        white = white or list_pictures(captures / 'white')[0]
        if calibration is None:
            board = Checkerboard.parse(corners, square)
            found = run_calibration(white, captures, board).calibration
        else:
            found = Calibration.load(calibration)
        decoders = open_decoders(found, white)
    results: list[Trial] = []
    with Progress(console=STDERR, transient=True) as bar:
        names = [PmclSettings.make({'mode': mode}, '--modes').mode for mode in modes.split(',')]
        task = bar.add_task('', total=len(folders) * len(names) * trials)
        for mode in names:
            for folder in folders:
                bar.update(task, description=f'{folder.name}, {mode}')
                for trial in run_trials(folder, decoders, mode, range(trials)):
                    results.append(trial)
                    bar.advance(task)
    table = markdown(results)
    click.echo(table)
    if out is not None:
        write_csv(out / 'results.csv', results)
        (out / 'results.md').write_text(table + '\n')
