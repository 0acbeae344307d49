"""`pmcl calibrate`: a camera's geometry from pictures of a checkerboard; or from truth files."""

import json
import re
from collections import Counter
from pathlib import Path

import click
from rich.console import Console
from rich.progress import Progress

from pmcl_ros.camera.files import list_pictures, read_metadata, read_raw_frame
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.white_images import choose_white
from pmcl_ros.cli.base import FORCE, STDERR, TRUTH, WHITE, Needed
from pmcl_ros.drawing.calibration_report import numbers, picture, summary, tables
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.lytro.calibrate import CalibrationResult, calibrate_folder
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.runtime.errors import CameraError
from pmcl_ros.runtime.outputs import refuse_existing, write_file
from pmcl_ros.runtime.resources import cameras_folder
from pmcl_ros.warm_up.raw import DECODE
from pmcl_ros.warm_up.stage import compile_ahead

_OUT = click.Path(dir_okay=False, path_type=Path)
_BOARDS = Needed('pmcl camera capture takes raw pictures: docs/howto/camera.md', folder=True)


@click.command()
@click.option('--white', required=True, type=WHITE, help='White image of the camera, or a folder '
              'of white images: the one that fits most pictures is chosen.')
@click.option('--boards', required=True, type=_BOARDS,
              help='Folder with pictures of the board, searched with its subfolders.')
@click.option('--corners', required=True, metavar='COLUMNSxROWS',
              help='Inner corners of the board, as 10x7.')
@click.option('--square', required=True, type=float, help='Side of a square [m].')
@click.option('-o', '--out', type=_OUT,
              help='Calibration to write, YAML; a report goes beside it (.png, .json).')
@click.option('--camera', metavar='NAME', help='In place of --out: where other commands find the '
              'calibration by this name of the camera, as --calibration NAME.')
@FORCE
def calibrate(white: Path, boards: Path, corners: str, square: float, out: Path | None,
              camera: str | None, force: bool) -> None:
    """Calibrate the camera from pictures of a checkerboard at one zoom and focus.

    Pictures without a complete board, or of another camera, are named and left out.
    """
    if (out is None) == (camera is None):
        raise click.UsageError('say where the calibration goes: --out C.yaml, or --camera NAME')
    if camera is not None:
        if not re.fullmatch(r'\w[\w-]*', camera):
            raise click.BadParameter(f'{camera!r} is no name: letters, digits, - and _',
                                     param_hint='--camera')
        out = cameras_folder() / f'{camera}.yaml'
    assert out is not None
    if out.suffix.lower() not in ('.yaml', '.yml'):
        raise click.BadParameter(f'{out} does not end in .yaml', param_hint='--out')
    board = Checkerboard.parse(corners, square)
    refuse_existing([out, out.with_suffix('.png'), out.with_suffix('.json')], force)
    out.parent.mkdir(parents=True, exist_ok=True)  # first: the rest takes minutes
    compile_ahead(STDERR, DECODE)
    result = run_calibration(white, boards, board)
    result.calibration.save(out, summary(result))
    write_png(out.with_suffix('.png'), picture(result))
    write_file(out.with_suffix('.json'), json.dumps(numbers(result), indent=1) + '\n')
    console = Console()
    for table in tables(result):
        console.print(table)
    STDERR.print(f'{out}, report in {out.with_suffix(".png")} and {out.with_suffix(".json")}',
                 markup=False, highlight=False, soft_wrap=True)


def run_calibration(white: Path, boards: Path, board: Checkerboard) -> CalibrationResult:
    """Calibrate from the pictures in a folder, with progress and a line for each left-out one.

    white: a white image, or a folder of white images.
    """
    if white.is_dir():
        choice = choose_white(white, _usual(list_pictures(boards)))
        STDERR.print(f'white image: {choice.why}', markup=False, soft_wrap=True)
        frame = choice.frame
    else:
        frame = read_raw_frame(white)
    with Progress(console=STDERR, transient=True) as bar:
        task = bar.add_task('lattice', total=None)

        def looked(path: Path, count: int, why: str) -> None:
            bar.update(task, description=path.parent.name or path.name, total=count, advance=1)
            if why:
                bar.console.print(f'left out {path}: {why}', markup=False, highlight=False,
                                  soft_wrap=True)

        return calibrate_folder(frame, boards, board, looked)


def _usual(pictures: list[Path]) -> CameraMetadata:
    """The metadata of a picture of the camera, zoom and focus that most have.

    Raises CameraError, that of the last picture, where none can be read.
    """
    found: list[CameraMetadata] = []
    problem = CameraError('there is no picture')
    for path in pictures:
        try:
            found.append(read_metadata(path))
        except CameraError as error:  # it is told, and left out, when the boards are looked for
            problem = error
    if not found:
        raise problem
    kinds = [(each.serial, each.zoom, each.focus) for each in found]
    return found[kinds.index(Counter(kinds).most_common(1)[0][0])]


@click.command('calibration-from-truth')
@click.argument('capture', type=TRUTH)
@click.argument('white', type=TRUTH)
@click.option('--serial', default='', help='Serial number of the camera.')
@click.option('-o', '--out', required=True, type=_OUT)
@FORCE
def calibration_from_truth(capture: Path, white: Path, serial: str, out: Path, force: bool
                           ) -> None:
    """Write the calibration of simulated captures from their truth.json files.

    CAPTURE and WHITE are the truth.json of a capture and of the white image.
    """
    refuse_existing([out], force)
    Calibration.from_truth(capture, white, serial).save(
        out, "Of a simulated camera, from its captures' truth files "
        '(pmcl calibration-from-truth).')
