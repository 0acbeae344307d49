"""`pmcl handeye`: where cameras are on or beside an arm, or by a board that all of them see."""

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import TypeVar

import click
import numpy as np
import yaml
from click.core import ParameterSource
from numpy.typing import NDArray
from rich.progress import track
from scipy.spatial.transform import Rotation

from pmcl_ros.cli.base import FORCE, STDERR, Needed
from pmcl_ros.cli.cameras.board_pictures import (
    ASK_LENS,
    RING,
    RestingCameras,
    board_of,
    boards_in,
    check_one,
    lying,
)
from pmcl_ros.evaluation.studies.hand_eye_errors import hand_eye_errors
from pmcl_ros.geometry.se3 import local
from pmcl_ros.lightfield.calibration.fixed_cameras import CameraAtBoard, camera_at_board
from pmcl_ros.lightfield.calibration.hand_eye import BoardPicture, HandEye, hand_eye
from pmcl_ros.lightfield.calibration.printed_board import Board, another_lens
from pmcl_ros.lightfield.fixed_cameras import FixedCameraSettings
from pmcl_ros.lightfield.readers import posed_views
from pmcl_ros.lightfield.readers.pictures import Reduction
from pmcl_ros.runtime.errors import LightFieldError, told_as
from pmcl_ros.runtime.outputs import refuse_existing, write_file

_File = TypeVar('_File', bound=posed_views.ViewsFile)
_SQUARE = 0.011  # m: of a checkerboard, by default
_FIXED, _GRASPS = '/**/fixed_cameras', '/**/grasp_node'  # in any namespace


@click.command('handeye')
@click.argument('source', required=False, type=Needed(
    'SOURCE is a views.yaml with mount_to_base: docs/howto/hand_eye.md', folder=True))
@click.option('--corners', default='10x7', show_default=True, metavar='COLUMNSxROWS',
              help='Inner corners of the checkerboard; one number odd, the other even.')
@RING
@click.option('--square', type=float, help='Side of its squares [m]; of a checkerboard 0.011 by '
              'default.')
@click.option('--fixed-camera', is_flag=True, help='The camera stands beside the arm, and the '
              'board is on the arm. There may be several cameras.')
@click.option('--no-robot', is_flag=True, help='Two or more cameras stand fixed and see one board '
              'at rest, in whose frame they are given; SOURCE has no mount_to_base.')
@click.option('--parent', default='wrist_roll_link', show_default=True,
              help='Name of the link whose poses are given.')
@click.option('--shrink', type=click.IntRange(1), default=1, metavar='N',
              help='Of large pictures: make NxN pixels one.')
@click.option('--simulate', type=click.IntRange(1), metavar='ARMS', help='In place of SOURCE: '
              'so many simulated arms, with the errors and the bound.')
@click.option('-o', '--out', type=click.Path(dir_okay=False, path_type=Path),
              help='Write a parameter file for sweep_driver and grasp_node: mount_parent, '
              'mount_position and mount_rpy, and the errors of the camera poses, with the '
              'covariance in a comment; of fixed cameras one for fixed_cameras, and of a single '
              'one for grasp_node too.')
@FORCE
def handeye(source: Path | None, corners: str, ring: str | None, square: float | None,
            fixed_camera: bool, no_robot: bool, parent: str, shrink: int, simulate: int | None,
            out: Path | None, force: bool) -> None:
    """Fit the pose of a camera on an arm's link, from SOURCE: pictures of a printed board.

    SOURCE is a views.yaml, or the folder with it, whose views have `mount_to_base` in place of
    `camera_to_reference`: the pose of the link, 16 numbers; with --no-robot neither. With sigma_mm
    and sigma_deg the arm's errors are those, else they are estimated. Prints the transform, its
    standard deviations and what is left for each picture; pictures that do not fit are left out
    and named.
    """
    if simulate is not None:
        _refuse('--simulate is in place of SOURCE and all that is said of it, and writes nothing',
                'source', 'corners', 'ring', 'square', 'no_robot', 'parent', 'shrink', 'out',
                'force')
        _simulate(simulate, fixed_camera)
        return
    if source is None:
        raise click.UsageError('say SOURCE, a views.yaml with mount_to_base '
                               '(docs/howto/hand_eye.md), or --simulate')
    if fixed_camera:
        _refuse('with --fixed-camera the result is the camera in the base', 'parent')
    if no_robot:
        _refuse('with --no-robot there is no arm', 'fixed_camera', 'parent')
    refuse_existing([] if out is None else [out], force)
    if ring is not None:
        _refuse('--ring is in place of --corners', 'corners')
        if square is None:
            raise click.UsageError('say --square, the side of the squares of the ring [m]')
    board = board_of(corners if ring is None else None, ring,
                     _SQUARE if square is None else square)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)  # first: the rest may take a minute
    sections, comment = {}, ''
    if no_robot:
        sections[_FIXED] = _at_board(source, board, shrink)
    elif fixed_camera and len(cameras := each_camera(source)) > 1:
        sections[_FIXED] = _beside_arm(cameras, board, shrink)
    else:
        found = calibrated(source, board, fixed_camera, shrink)
        _print(found, fixed_camera, parent)
        sections = _beside(next(iter(cameras)), found) if fixed_camera else _carried(parent, found)
        comment = f'# covariance: {[float(f"{x:.3g}") for x in found.covariance.ravel()]}\n'
    if out is not None:
        write_file(out, f'# pmcl handeye {source}\n' + yaml.safe_dump(
            {node: {'ros__parameters': each} for node, each in sections.items()},
            default_flow_style=None, sort_keys=False) + comment)


def _carried(parent: str, found: HandEye) -> dict[str, dict[str, object]]:
    """Parameters of the nodes that use a camera on the arm; errors of its poses are printed."""
    mount = {'mount_parent': parent} | _mount(found)
    errors = camera_errors(found)
    click.echo("errors of the camera's poses on each axis: "
               f'{1e3 * errors["sigma_position"]:.2f} mm, '
               f'{np.rad2deg(errors["sigma_rotation"]):.3f} degrees; '
               f'{100 * errors["common"]:.0f} % of their variance is in common')
    # Copied, as ROS reads no aliases of YAML.
    return {'/**/sweep_driver': mount | errors, _GRASPS: deepcopy(mount)}


def _beside(camera: str, found: HandEye) -> dict[str, dict[str, object]]:
    """Parameters of the nodes that use one camera at rest; sweep_driver takes moved ones.

    camera: its name; empty: of light fields, which fixed_cameras does not take.
    """
    of_views = {_FIXED: _mounts({camera: found})} if camera else {}
    return of_views | {_GRASPS: {'arm': 'fixed', **_mount(found)}}


def camera_errors(found: HandEye) -> dict[str, float]:
    """Errors of the poses of a camera on the arm, as parameters of sweep_driver.

    Errors of the arm differ from picture to picture; that of the hand-eye transform is in common.
    The link's rotation moves the camera, too. common: the larger of the shares of position and
    rotation, as what views have in common does not average out.
    """
    place, turn = np.square(found.sigma)
    reach = np.square(found.camera[:3, 3]).sum()
    # A rotation about one axis in three does not move the camera along its direction.
    arm = np.array([place + 2 / 3 * reach * turn, turn])
    shared = np.diag(found.covariance).reshape(2, 3).mean(axis=1)
    position, rotation = np.sqrt(arm + shared)
    common = (shared / (arm + shared)).max()
    return {name: float(f'{each:.3g}') for name, each in (
        ('sigma_position', position), ('sigma_rotation', rotation), ('common', common))}


def _at_board(source: Path, board: Board, shrink: int) -> dict[str, object]:
    """Parameters of fixed_cameras in the frame of the board; printed."""
    frame, placed = cameras_at_board(source, board, shrink)
    for name, each in placed.items():
        click.echo(f'{name}:')
        _print_pose(frame, each.camera, each.covariance)
        for file, pixels in zip(each.names, each.pixels, strict=True):
            click.echo(f'{file}: corners {pixels:.2f} px')
    return {'fixed_frame': frame} | _mounts(placed)


def _beside_arm(cameras: Mapping[str, tuple[posed_views.ViewsFile, Path]], board: Board,
                shrink: int) -> dict[str, object]:
    """Parameters of fixed_cameras in the base of the arm; printed."""
    found = {}
    for name, (of, path) in cameras.items():
        with told_as(LightFieldError, name=name):
            found[name] = _calibrated(of, path, board, True, shrink)
        click.echo(f'{name}:')
        _print(found[name], True, '')
    return _mounts(found)


def _mounts(found: Mapping[str, HandEye | CameraAtBoard]) -> dict[str, object]:
    """Parameters of fixed_cameras, with the largest errors of all cameras and axes.

    Raises SettingsError where that node would.
    """
    sigmas = np.sqrt([np.diag(each.covariance) for each in found.values()])
    values = {'cameras': [*found],
              'camera_mounts': [number for each in found.values() for number in _six(each.camera)],
              'sigma_position': float(sigmas[:, :3].max()),
              'sigma_rotation': float(sigmas[:, 3:].max())}
    FixedCameraSettings.make(values, 'parameters of fixed_cameras')
    return values


def _mount(found: HandEye) -> dict[str, object]:
    """Where the camera is, as parameters of sweep_driver and grasp_node."""
    six = _six(found.camera)
    return {'mount_position': six[:3], 'mount_rpy': six[3:]}


def _six(pose: NDArray[np.float64]) -> list[float]:
    """x, y, z [m], roll, pitch, yaw [rad]."""
    return [*pose[:3, 3].tolist(), *Rotation.from_matrix(pose[:3, :3]).as_euler('xyz').tolist()]


def _refuse(why: str, *names: str) -> None:
    """Raise UsageError for arguments that were given and have no effect."""
    context = click.get_current_context()
    given = [each.opts[0] if isinstance(each, click.Option) else each.human_readable_name
             for each in context.command.params if each.name in names
             and context.get_parameter_source(each.name) is not ParameterSource.DEFAULT]
    if given:
        raise click.UsageError(f'{why}: leave out {", ".join(given)}')


def _views_path(source: Path) -> Path:
    return source / posed_views.NAME if source.is_dir() else source


def _of_each(of: _File) -> dict[str, _File]:
    """The same with the views of one camera, by its name."""
    names = dict.fromkeys(each.camera for each in of.views)
    return {name: of.model_copy(update={'views': [
        each for each in of.views if each.camera == name]}) for name in names}


def each_camera(source: Path) -> dict[str, tuple[posed_views.ViewsFile, Path]]:
    """What `calibrated` reads of each camera, by its name. Raises SettingsError."""
    path = _views_path(source)
    return {name: (of, path) for name, of in _of_each(posed_views.ViewsFile.load(path)).items()}


def cameras_at_board(source: Path, board: Board, shrink: int = 1
                     ) -> tuple[str, dict[str, CameraAtBoard]]:
    """The name of the board's frame, and of each camera, by its name, where it is.

    Raises LightFieldError, SettingsError.
    """
    path = _views_path(source)
    of, reduction = RestingCameras.load(path), Reduction(1, shrink)
    cameras = _of_each(of)
    if len(cameras) < 2:
        raise LightFieldError(f'{path} has pictures of {", ".join(cameras)} alone; --no-robot '
                              'wants two cameras or more')
    found = {}
    for name, each in cameras.items():
        pinhole = reduction.pinhole(of.cameras[name].pinhole)
        seen = boards_in(each, path, board, reduction, set())
        points, heights, agreeing = lying(board, seen, pinhole)
        files = ', '.join(view.file for view in each.views)
        if not agreeing:
            raise LightFieldError(
                f'{path}: no board of {board.options} in the pictures of {name} ({files}): are '
                'these its numbers, and is it in view?')
        with told_as(LightFieldError, name=f'{path}: {name}'):
            found[name] = camera_at_board(agreeing, points, pinhole, heights)
            lens = another_lens(agreeing, board, pinhole)
        if lens is not None:
            click.echo(f'{name}: the board fits best with {lens}: {ASK_LENS}', err=True)
    return of.reference if 'reference' in of.model_fields_set else 'board', found


def calibrated(source: Path, board: Board, fixed_camera: bool, shrink: int = 1) -> HandEye:
    """Read the pictures and fit. Raises LightFieldError, SettingsError."""
    path = _views_path(source)
    return _calibrated(posed_views.ViewsFile.load(path), path, board, fixed_camera, shrink)


def _calibrated(of: posed_views.ViewsFile, path: Path, board: Board, fixed_camera: bool,
                shrink: int) -> HandEye:
    reduction = Reduction(1, shrink)
    without = [each.file for each in of.views if each.mount_to_base is None]
    if without:
        raise LightFieldError(f'{path}: {without[0]} has no mount_to_base, the pose of the link')
    pinholes = {reduction.pinhole(of.cameras[each.camera].pinhole)
                for each in of.views if each.camera}
    check_one(path, pinholes)
    sigmas = {(1e-3 * each.sigma_mm, float(np.deg2rad(each.sigma_deg))) for each in of.views}
    sigma = min(sigmas) if all(min(each) > 0 for each in sigmas) else None
    if sigma is not None and len(sigmas) > 1:
        raise LightFieldError(f'{path}: sigma_mm and sigma_deg must be the same at all views, not '
                              f'{", ".join(map(_told, sorted(sigmas)[:3]))}')
    mounts = {each.file: np.array(each.mount_to_base, float).reshape(4, 4) for each in of.views}
    boards, (pinhole,) = boards_in(of, path, board, reduction, pinholes), pinholes
    with told_as(LightFieldError, name=path):
        points, _, agreeing = lying(board, boards, pinhole)
        pictures = [BoardPicture(name, seen, mounts[name]) for name, seen in agreeing.items()]
        return hand_eye(pictures, points, pinhole, sigma, fixed_camera)


def _told(sigma: tuple[float, float]) -> str:
    return f'{1e3 * sigma[0]:g} mm and {np.rad2deg(sigma[1]):g} degrees'


def _print_pose(frame: str, camera: NDArray[np.float64], covariance: NDArray[np.float64]) -> None:
    x, y, z = 1e3 * camera[:3, 3]
    roll, pitch, yaw = np.rad2deg(Rotation.from_matrix(camera[:3, :3]).as_euler('xyz'))
    sigma = np.sqrt(np.diag(covariance))
    click.echo(f'camera in {frame}: ({x:.2f}, {y:.2f}, {z:.2f}) mm, '
               f'roll pitch yaw ({roll:.3f}, {pitch:.3f}, {yaw:.3f}) degrees')
    click.echo('standard deviations: '
               f'({", ".join(f"{1e3 * each:.2f}" for each in sigma[:3])}) mm, '
               f'({", ".join(f"{np.rad2deg(each):.3f}" for each in sigma[3:])}) degrees')


def _print(found: HandEye, fixed: bool, parent: str) -> None:
    _print_pose('the base' if fixed else parent, found.camera, found.covariance)
    click.echo(f'errors of the arm on each axis: {1e3 * found.sigma[0]:.2f} mm, '
               f'{np.rad2deg(found.sigma[1]):.3f} degrees')
    apart = local(found.closed_form[None], found.camera)[0]
    click.echo(f'the closed form of Park and Martin is {1e3 * np.linalg.norm(apart[:3]):.2f} mm '
               f'and {np.rad2deg(np.linalg.norm(apart[3:])):.3f} degrees off that')
    for each in zip(found.names, found.pixels, found.motions, strict=True):
        click.echo(_residuals(*each))
    for each in zip(found.left_out, found.left_pixels, found.left_motions, strict=True):
        click.echo(f'{_residuals(*each)}: left out, it does not fit the others')


def _residuals(name: str, pixels: float, motion: NDArray[np.float64]) -> str:
    return (f'{name}: corners {pixels:.2f} px, arm off by '
            f'{1e3 * np.linalg.norm(motion[:3]):.2f} mm, '
            f'{np.rad2deg(np.linalg.norm(motion[3:])):.3f} degrees')


def _simulate(arms: int, fixed: bool) -> None:
    """Print the errors over simulated arms, beside their bound."""
    found = [hand_eye_errors(seed, fixed) for seed in track(
        range(arms), console=STDERR, description='arms', transient=True)]
    for name in found[0].errors:
        errors = np.concatenate([each.errors[name] for each in found])
        shift, turn = (np.median(np.linalg.norm(part, axis=1)) for part in (
            errors[:, :3], errors[:, 3:]))
        click.echo(f'{name}: median {1e3 * shift:.3f} mm, {np.rad2deg(turn):.4f} degrees')
    click.echo(f'truth in the 90 % region: {sum(each.inside for each in found)} of {arms}')
