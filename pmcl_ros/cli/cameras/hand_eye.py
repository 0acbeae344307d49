"""`pmcl handeye`: where the camera is on the arm, from pictures of a board and the arm's poses."""

from pathlib import Path

import click
import numpy as np
import yaml
from click.core import ParameterSource
from numpy.typing import NDArray
from rich.progress import track
from scipy.spatial.transform import Rotation

from pmcl_ros.cli.base import FORCE, STDERR, Needed
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import local
from pmcl_ros.lightfield.calibration.boards import Checkerboard
from pmcl_ros.lightfield.calibration.hand_eye import BoardPicture, HandEye, hand_eye
from pmcl_ros.lightfield.calibration.simulated_arm import simulated_arm
from pmcl_ros.lightfield.readers import posed_views
from pmcl_ros.lightfield.readers.pictures import Reduction
from pmcl_ros.runtime.errors import LightFieldError, PmclError
from pmcl_ros.runtime.outputs import refuse_existing

_INSIDE = 10.645  # 90 % of the chi-squared distribution of 6 degrees of freedom


@click.command('handeye')
@click.argument('source', required=False, type=Needed(
    'SOURCE is a views.yaml with mount_to_base: docs/howto/hand_eye.md', folder=True))
@click.option('--corners', default='10x7', show_default=True, metavar='COLUMNSxROWS',
              help='Inner corners of the checkerboard; one number odd, the other even.')
@click.option('--square', default=0.011, show_default=True, type=float,
              help='Side of its squares [m].')
@click.option('--fixed-camera', is_flag=True, help='The camera stands beside the arm, and the '
              'board is on the arm.')
@click.option('--parent', default='wrist_roll_link', show_default=True,
              help='Name of the link whose poses are given.')
@click.option('--shrink', type=click.IntRange(1), default=1, metavar='N',
              help='Of large pictures: make NxN pixels one.')
@click.option('--simulate', type=click.IntRange(1), metavar='ARMS', help='In place of SOURCE: '
              'so many simulated arms, with the errors and the bound.')
@click.option('-o', '--out', type=click.Path(dir_okay=False, path_type=Path),
              help='Write mount_parent, mount_position and mount_rpy, a parameter file for '
              'sweep_driver and grasp_node, with the covariance in a comment.')
@FORCE
def handeye(source: Path | None, corners: str, square: float, fixed_camera: bool, parent: str,
            shrink: int, simulate: int | None, out: Path | None, force: bool) -> None:
    """Fit the pose of a camera on an arm's link, from SOURCE: pictures of a checkerboard.

    SOURCE is a views.yaml, or the folder with it, whose views have `mount_to_base` in place of
    `camera_to_reference`: the pose of the link, 16 numbers. With sigma_mm and sigma_deg the arm's
    errors are those, else they are estimated. Prints the transform, its standard deviations and
    what is left for each picture; pictures that do not fit are left out and named.
    """
    if simulate is not None:
        _refuse('--simulate is in place of SOURCE and all that is said of it, and writes nothing',
                'source', 'corners', 'square', 'parent', 'shrink', 'out', 'force')
        _simulate(simulate, fixed_camera)
        return
    if source is None:
        raise click.UsageError('say SOURCE, a views.yaml with mount_to_base '
                               '(docs/howto/hand_eye.md), or --simulate')
    if fixed_camera:
        _refuse('with --fixed-camera the result is the camera in the base', 'parent')
    refuse_existing([] if out is None else [out], force)
    found = calibrated(source, Checkerboard.parse(corners, square), fixed_camera, shrink)
    _print(found, fixed_camera, parent)
    if out is not None:
        x, y, z = Rotation.from_matrix(found.camera[:3, :3]).as_euler('xyz').tolist()
        values: dict[str, object] = {} if fixed_camera else {'mount_parent': parent}
        values |= {'mount_position': found.camera[:3, 3].tolist(), 'mount_rpy': [x, y, z]}
        try:
            out.write_text(f'# pmcl handeye {source}\n' + yaml.safe_dump(
                {'/**': {'ros__parameters': values}}, default_flow_style=None,
                sort_keys=False) + '# covariance: '
                f'{[float(f"{each:.3g}") for each in found.covariance.ravel()]}\n')
        except OSError as error:
            raise PmclError(f'cannot write {out}: {error.strerror or error}') from None


def _refuse(why: str, *names: str) -> None:
    """Raise UsageError for arguments that were given and have no effect."""
    context = click.get_current_context()
    given = [each.opts[0] if isinstance(each, click.Option) else each.human_readable_name
             for each in context.command.params if each.name in names
             and context.get_parameter_source(each.name) is not ParameterSource.DEFAULT]
    if given:
        raise click.UsageError(f'{why}: leave out {", ".join(given)}')


def calibrated(source: Path, board: Checkerboard, fixed_camera: bool, shrink: int = 1) -> HandEye:
    """Read the pictures and fit. Raises LightFieldError, SettingsError."""
    path = source / posed_views.NAME if source.is_dir() else source
    of, reduction = posed_views.ViewsFile.load(path), Reduction(1, shrink)
    without = [each.file for each in of.views if each.mount_to_base is None]
    if without:
        raise LightFieldError(f'{path}: {without[0]} has no mount_to_base, the pose of the link')
    pinholes = {reduction.pinhole(of.cameras[each.camera].pinhole)
                for each in of.views if each.camera}
    _check_one(path, pinholes)
    sigmas = {(1e-3 * each.sigma_mm, float(np.deg2rad(each.sigma_deg))) for each in of.views}
    sigma = min(sigmas) if all(min(each) > 0 for each in sigmas) else None
    if sigma is not None and len(sigmas) > 1:
        raise LightFieldError(f'{path}: sigma_mm and sigma_deg must be the same at all views, not '
                              f'{", ".join(map(_told, sorted(sigmas)[:3]))}')
    pictures = []
    for entry in track(of.views, console=STDERR, description='boards', transient=True):
        # One at a time: corners are small, all pictures at once need not fit in memory.
        view, = posed_views.views_of(of.model_copy(update={'views': [entry]}), path.parent,
                                     f'{path}: {entry.file}', reduction)
        pinholes.add(view.pinhole)  # a light field has its own
        _check_one(path, pinholes)
        seen = board.seen(view.displayed().mean(axis=2).astype(np.uint8))
        if seen is None:
            click.echo(f'{entry.file}: no complete board', err=True)
            continue
        mount = np.array(entry.mount_to_base, float).reshape(4, 4)
        pictures.append(BoardPicture(entry.file, seen, mount))
    try:
        return hand_eye(pictures, board.points, pinholes.pop(), sigma, fixed_camera)
    except LightFieldError as error:
        raise LightFieldError(f'{path}: {error}') from None


def _check_one(path: Path, pinholes: set[Pinhole]) -> None:
    if len(pinholes) > 1:
        raise LightFieldError(f'{path} has pictures of {len(pinholes)} cameras; give those of one')


def _told(sigma: tuple[float, float]) -> str:
    return f'{1e3 * sigma[0]:g} mm and {np.rad2deg(sigma[1]):g} degrees'


def _print(found: HandEye, fixed: bool, parent: str) -> None:
    x, y, z = 1e3 * found.camera[:3, 3]
    roll, pitch, yaw = np.rad2deg(Rotation.from_matrix(found.camera[:3, :3]).as_euler('xyz'))
    sigma = np.sqrt(np.diag(found.covariance))
    click.echo(f'camera in {"the base" if fixed else parent}: ({x:.2f}, {y:.2f}, {z:.2f}) mm, '
               f'roll pitch yaw ({roll:.3f}, {pitch:.3f}, {yaw:.3f}) degrees')
    click.echo('standard deviations: '
               f'({", ".join(f"{1e3 * each:.2f}" for each in sigma[:3])}) mm, '
               f'({", ".join(f"{np.rad2deg(each):.3f}" for each in sigma[3:])}) degrees')
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
    errors: dict[str, list[NDArray[np.float64]]] = {'fitted': [], 'closed form': []}
    bounds, inside = [], 0
    for seed in track(range(arms), console=STDERR, description='arms', transient=True):
        arm = simulated_arm(np.random.default_rng(seed), fixed_camera=fixed)
        found = hand_eye(arm.pictures, arm.board, arm.pinhole, None, fixed)
        off = local(arm.camera[None], found.camera)[0]
        for name, pose in (('fitted', found.camera), ('closed form', found.closed_form)):
            errors[name].append(local(arm.camera[None], pose)[0])
        bound = hand_eye(arm.pictures, arm.board, arm.pinhole, arm.sigma, fixed).covariance
        bounds.append(np.random.default_rng(seed).multivariate_normal(np.zeros(6), bound, 50))
        inside += bool(off @ np.linalg.solve(found.covariance, off) < _INSIDE)
    rows = {name: np.array(each) for name, each in errors.items()}
    rows['Cramer-Rao bound'] = np.concatenate(bounds)
    for name, each in rows.items():
        shift, turn = (np.median(np.linalg.norm(part, axis=1)) for part in (
            each[:, :3], each[:, 3:]))
        click.echo(f'{name}: median {1e3 * shift:.3f} mm, {np.rad2deg(turn):.4f} degrees')
    click.echo(f'truth in the 90 % region: {inside} of {arms}')
