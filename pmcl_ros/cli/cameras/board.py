"""`pmcl board`, `calibrate-camera`, `board-poses`: ordinary cameras by a printed board."""

from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import yaml
from numpy.typing import NDArray
from rich.progress import track

from pmcl_ros.cli.base import CAMERA, FORCE, STDERR, Needed
from pmcl_ros.cli.cameras.board_pictures import (
    ASK_LENS,
    RestingCameras,
    board_of,
    board_options,
    boards_in,
    corners_in,
    lying,
)
from pmcl_ros.cli.cameras.kept_entries import read_earlier, with_kept
from pmcl_ros.cli.sources import PICTURE_SUFFIXES
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.fixed_cameras import CameraAtBoard, camera_at_board
from pmcl_ros.lightfield.calibration.intrinsics import fit_intrinsics
from pmcl_ros.lightfield.calibration.printed_board import (
    Board,
    another_lens,
    reduction_for,
)
from pmcl_ros.lightfield.posed_view import GAMMA, encoded
from pmcl_ros.lightfield.readers import posed_views
from pmcl_ros.lightfield.readers.pictures import picture_size, read_picture
from pmcl_ros.runtime.errors import LightFieldError
from pmcl_ros.runtime.outputs import refuse_existing, write_file
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera

_PICTURES = Needed('It is a folder of PNG, JPEG, TIFF, ...: docs/howto/board.md', folder=True)
_OUT = click.Path(dir_okay=False, path_type=Path)


@click.command()
@board_options
@click.option('-o', '--out', required=True, type=_OUT, help='SVG to write, in its true size.')
@FORCE
def board(corners: str | None, ring: str | None, square: float, out: Path, force: bool) -> None:
    """Draw a checkerboard, or a ring of markers, to print.

    Print it at 100 %, and measure its squares.
    """
    if out.suffix.lower() != '.svg':
        raise click.UsageError(f'-o {out}: give the name of an SVG, as board.svg')
    drawn = board_of(corners, ring, square).svg
    refuse_existing([out], force)
    write_file(out, drawn)


@click.command('calibrate-camera')
@click.argument('pictures', type=_PICTURES)
@board_options
@click.option('-o', '--out', required=True, type=_OUT, help='Camera to write: the YAML that '
              '--camera of other commands reads, and an entry of cameras in views.yaml.')
@FORCE
def calibrate_camera(pictures: Path, corners: str | None, ring: str | None, square: float,
                     out: Path, force: bool) -> None:
    """Calibrate an ordinary camera from a folder of PICTURES of a checkerboard, or of a ring.

    The pictures have one zoom and one focus, and show the board tilted by 20 to 40 degrees,
    another way in each, near the borders too. It may be bent, in all pictures alike. Pictures
    without the board are named and left out.
    """
    if out.suffix.lower() not in ('.yaml', '.yml'):
        raise click.UsageError(f'-o {out}: give the name of a camera YAML, as camera.yaml')
    refuse_existing([out], force)
    printed, files = board_of(corners, ring, square), _files(pictures)
    width, height = _size(files)
    out.parent.mkdir(parents=True, exist_ok=True)  # first: the rest may take a minute
    found = fit_intrinsics(dict(_seen(files, printed, (width, height))), printed.points, width,
                           height)
    pinhole = found.pinhole
    for name, value, sigma in zip(('fx', 'fy', 'cx', 'cy', 'k1', 'k2', 'p1', 'p2'), found.camera,
                                  found.sigma, strict=True):
        click.echo(f'{name}: {value:.5g} (standard deviation {sigma:.2g})')
    for name, pixels in zip(found.names, found.pixels, strict=True):
        click.echo(f'{name}: corners {pixels:.2f} px')
    click.echo('corners of the board are up to '
               f'{1e3 * np.abs(found.board[:, 2]).max():.2f} mm off a plane')
    for name in found.left_out:
        click.echo(f'{name}: left out, it does not fit the others: another zoom or focus?',
                   err=True)
    posed_views.ViewCamera.make({
        'width': width, 'height': height, 'fx': pinhole.fx, 'fy': pinhole.fy, 'cx': pinhole.cx,
        'cy': pinhole.cy, 'distortion': found.distortion}, 'camera').save(
            out, f'pmcl calibrate-camera {pictures} {printed.options}')


@click.command('board-poses')
@click.argument('pictures', type=_PICTURES)
@click.option('--camera', required=True, type=CAMERA, help='Camera of the pictures, a YAML file '
              'as calibrate-camera writes it.')
@board_options
@FORCE
def board_poses(pictures: Path, camera: Path, corners: str | None, ring: str | None,
                square: float, force: bool) -> None:
    """Write views.yaml into a folder of PICTURES: camera poses by a printed board in view.

    Object and board rest; the board may be bent. The poses are in the frame of the board, with
    their errors: of a checkerboard z points into the table, of a ring out of it. Pictures without
    the complete checkerboard, or with little of the ring, are named and left out. Of a views.yaml
    that is there (--force) what it says beside, as masks, is kept.
    """
    path = pictures / posed_views.NAME
    refuse_existing([path], force, 'say --force to write it anew; what it says beside the camera '
                    'and its poses, as masks, is kept')
    earlier = read_earlier(path)
    printed, of = board_of(corners, ring, square), OrdinaryCamera.load(camera)
    name = camera.stem
    whole = of.model_copy(update={'fy': of.fy or of.fx})  # else the earlier file's is kept
    cameras = {name: whole.model_dump(mode='json',
                                      include=set(posed_views.ViewCamera.model_fields))}
    listed = RestingCameras.make({
        **({} if earlier is None else {'bits': earlier.bits}),
        'cameras': cameras, 'reference': 'board',
        'views': [{'file': each.name, 'camera': name} for each in _files(pictures)
                  if _is_text(each.name)]}, str(path))
    reduction = reduction_for(of.width, of.height)
    pinhole = reduction.pinhole(of.pinhole)
    views, boards = [], boards_in(listed, path, printed, reduction, set())
    points, heights, agreeing = lying(printed, boards, pinhole)
    for file, seen in agreeing.items():
        try:
            found = camera_at_board({file: seen}, points, pinhole, heights)
        except LightFieldError as error:
            click.echo(f'{error}: left out', err=True)
            continue
        views.append(_entry(file, name, found, points))
        click.echo(f'{file}: {1e3 * np.linalg.norm(found.camera[:3, 3]):.0f} mm away, corners '
                   f'{found.pixels[0]:.2f} px, errors {views[-1]["sigma_mm"]:.2f} mm, '
                   f'{views[-1]["sigma_deg"]:.3f} degrees')
    if not views:
        raise LightFieldError(
            f'{pictures}: no camera pose by a board of {printed.options} in {len(listed.views)} '
            'pictures: are these its numbers, and is it in view?')
    click.echo('corners of the board are up to '
               f'{1e3 * np.abs(points[:, 2]).max():.2f} mm above the table')
    used = {str(each['file']): agreeing[str(each['file'])] for each in views}
    if (lens := another_lens(used, printed, pinhole)) is not None:
        click.echo(f'the boards fit best with {lens}: {ASK_LENS}', err=True)
    write_file(path, f'# pmcl board-poses {pictures} --camera {camera} {printed.options}\n'
           + yaml.safe_dump(with_kept(
               {'reference': listed.reference, 'cameras': cameras, 'views': views}, earlier),
               default_flow_style=None, sort_keys=False))
    if isinstance(printed, CharucoRing):
        click.echo('what stands in the ring: --roi '
                   f'{" ".join(f"{each:g}" for each in printed.region)} --up 0 0 1 --tilt 0 20')


def _entry(file: str, camera: str, found: CameraAtBoard, points: NDArray[np.float64]
           ) -> dict[str, object]:
    """A view of views.yaml."""
    position, rotation = found.sigma_beside(points)
    return {'file': file, 'camera': camera, 'camera_to_reference': found.camera.ravel().tolist(),
            'sigma_mm': 1e3 * position, 'sigma_deg': float(np.rad2deg(rotation))}


def _files(folder: Path) -> list[Path]:
    """The pictures of a folder, by name."""
    if not folder.is_dir():
        raise LightFieldError(f'{folder} is a file: give the folder of the pictures')
    # Hidden ones are notes about pictures (`._IMG_0001.jpg` of macOS), not pictures.
    found = sorted(each for each in folder.iterdir() if each.suffix.lower() in PICTURE_SUFFIXES
                   and not each.name.startswith('.'))
    if not found:
        raise LightFieldError(f'{folder} has no pictures ({", ".join(PICTURE_SUFFIXES)})')
    return found


def _is_text(name: str) -> bool:
    """Whether views.yaml can have the name of a picture; one that it cannot is told."""
    try:
        name.encode()
    except UnicodeEncodeError:
        click.echo(f'{name}: its name is no UTF-8, as views.yaml has to be: left out, rename it',
                   err=True)
        return False
    return True


def _size(files: list[Path]) -> tuple[int, int]:
    """(width, height) [px] that all of the pictures have, by their headers."""
    sizes = [picture_size(each) for each in files]
    for file, (width, height) in zip(files, sizes, strict=True):
        if (width, height) != sizes[0]:
            raise LightFieldError(f'{file} has {width}x{height} px, {files[0].name} '
                                  f'{sizes[0][0]}x{sizes[0][1]}: all must have one size')
    return sizes[0]


def _seen(files: list[Path], printed: Board, size: tuple[int, int]
          ) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Names and corners (m, 2) [px] of the pictures that show the board; others are named."""
    reduction = reduction_for(*size)
    for file in track(files, console=STDERR, description='boards', transient=True):
        picture = encoded(read_picture(file), GAMMA)
        grey = np.rint(255 * reduction.shrunk(picture).mean(axis=2)).astype(np.uint8)
        corners = corners_in(grey, file.name, printed)
        if corners is not None:
            yield file.name, (corners + 0.5) * reduction.shrink - 0.5
