"""`pmcl evaluate`: errors over a folder of captures with truth."""

from pathlib import Path

import click
from rich.progress import Progress

from pmcl_ros.camera.files import list_pictures, read_raw_frame
from pmcl_ros.cli.base import FILE, FOLDER, STDERR
from pmcl_ros.evaluation.trials import Trial, find_captures, markdown, run_trials, write_csv
from pmcl_ros.lightfield.calibration import Calibration
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.pmcl.settings import PmclSettings


@click.command()
@click.argument('captures', type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option('--calibration', required=True, type=FILE, help='Calibration of the camera, YAML.')
@click.option('--white', type=FILE, help='White image; default: the one in CAPTURES/white.')
@click.option('--modes', default='default', show_default=True, help='Modes, separated by commas.')
@click.option('--trials', type=click.IntRange(1), default=10, show_default=True, help='Seeds.')
@click.option('--only', multiple=True, metavar='NAME', help='Only this capture.')
@click.option('--out', type=FOLDER, help='Folder for results.csv and results.md.')
def evaluate(captures: Path, calibration: Path, white: Path | None, modes: str, trials: int,
             only: tuple[str, ...], out: Path | None) -> None:
    """Localise CAPTURES (subfolders with a picture, model.obj, truth.json), and tell errors."""
    decoder = Decoder(Calibration.load(calibration),
                      read_raw_frame(white or list_pictures(captures / 'white')[0]))
    folders = [each for each in find_captures(captures) if not only or each.name in only]
    results: list[Trial] = []
    with Progress(console=STDERR, transient=True) as bar:
        names = [PmclSettings.make({'mode': mode}, '--modes').mode for mode in modes.split(',')]
        task = bar.add_task('', total=len(folders) * len(names) * trials)
        for mode in names:
            for folder in folders:
                bar.update(task, description=f'{folder.name}, {mode}')
                for trial in run_trials(folder, decoder, mode, range(trials)):
                    results.append(trial)
                    bar.advance(task)
    table = markdown(results)
    click.echo(table)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_csv(out / 'results.csv', results)
        (out / 'results.md').write_text(table + '\n')
