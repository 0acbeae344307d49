"""Reports a calibration: a picture, tables, and numbers for JSON."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.table import Table

from pmcl_ros.drawing import charts
from pmcl_ros.lightfield.calibration.lytro.calibrate import CalibrationResult
from pmcl_ros.lightfield.calibration.lytro.camera_model import PARAMETERS, bok_parameters

_LENGTH = 6  # px: about how long residuals are drawn
_COLUMNS = 4  # boards side by side
_TILE, _PLOTS = 5.0, 4.0  # inches: width of a board, height of the plots
_LINE, _DOT = '#d55e00', '#0072b2'


def standard_deviations(result: CalibrationResult) -> dict[str, float]:
    """Standard deviations of the parameters by name, in their units; 0: held fixed."""
    values = dict(zip(PARAMETERS, result.uncertainty.camera.tolist(), strict=True))
    values['focus_distance'] = values.pop('focus') * result.calibration.focus_distance ** 2
    return values


def residual_rms(result: CalibrationResult) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(boards,) position [px] and disparity [px per view step]; one number for both axes."""
    squares = np.nanmean(np.square(result.residuals), axis=1)
    return np.sqrt(squares[:, :2].mean(axis=1)), np.sqrt(squares[:, 2:].mean(axis=1))


def summary(result: CalibrationResult) -> str:
    """Some lines for the head of the calibration's file."""
    sigma, calibration = standard_deviations(result), result.calibration
    position, disparity = residual_rms(result)
    return '\n'.join([
        f'From {len(result.boards)} boards (pmcl calibrate): corners within '
        f'{np.sqrt(np.mean(position ** 2)):.4f} px, their disparities within '
        f'{np.sqrt(np.mean(disparity ** 2)):.4f} px per step (rms).',
        f'The corners of the board are up to {1e3 * np.abs(result.board[:, 2]).max():.2f} mm off '
        'a plane.',
        'Standard deviations: ' + ', '.join(
            f'{name} {value:.2g}' for name, value in sigma.items() if value) + '.',
        'Bok et al.: K1 {:.4f}, K2 {:.4f} m.'.format(*bok_parameters(
            calibration.fx, calibration.baseline, calibration.focus_distance))])


def tables(result: CalibrationResult) -> tuple[Table, Table]:
    """The estimates with their standard deviations; the boards with their residuals."""
    estimates = Table(title='calibration', title_justify='left')
    for name in ('', 'estimate', 'standard deviation', ''):
        estimates.add_column(name, justify='right')
    for name, value, sigma, unit in _rows(result):
        estimates.add_row(name, value, sigma, unit)
    boards = Table(title='boards', title_justify='left')
    for name in ('picture', 'corners', 'rms [px]', 'rms [px/step]', 'distance [m]', 'tilt'):
        boards.add_column(name, justify='right')
    for view, used, pose, position, disparity in zip(
            result.boards, result.fit.observations.valid.sum(axis=1), result.poses,
            *residual_rms(result), strict=True):
        boards.add_row(view.name, str(used), f'{position:.4f}',
                       f'{disparity:.4f}', f'{pose[2, 3]:.3f}',
                       f'{np.degrees(np.arccos(min(1, abs(pose[2, 2])))):.0f}°')
    return estimates, boards


def numbers(result: CalibrationResult) -> dict[str, Any]:
    """All of it, for JSON; lengths in metres, angles in radians."""
    position, disparity = residual_rms(result)
    calibration, sure = result.calibration, result.uncertainty
    k1, k2 = bok_parameters(calibration.fx, calibration.baseline, calibration.focus_distance)
    return {
        'calibration': calibration.model_dump(mode='json'),
        'standard_deviation': standard_deviations(result),
        'standard_deviation_of': {
            'covariance': dict(zip(PARAMETERS, sure.expected.tolist(), strict=True)),
            'corner_bootstrap': dict(zip(PARAMETERS, sure.of_corners.tolist(), strict=True)),
            'board_bootstrap': {name: None if np.isnan(value) else float(value) for name, value
                                in zip(PARAMETERS, sure.of_boards, strict=True)}},
        'bok': {'K1': k1, 'K2': k2},
        'models': [{'focal_lengths': model.focals, 'distortion_terms': model.distortions,
                    'gain': gain} for model, gain in result.gains.items()],
        'boards': [{'picture': view.name, 'corners': used,
                    'rms_px': rms, 'rms_px_per_step': rms_disparity,
                    'board_to_camera': pose.tolist(),
                    'rotation_standard_deviation': sigma[:3].tolist(),
                    'translation_standard_deviation': sigma[3:].tolist()}
                   for view, used, pose, sigma, rms, rms_disparity in zip(
                       result.boards, result.fit.observations.valid.sum(axis=1).tolist(),
                       result.poses, sure.poses, position.tolist(),
                       disparity.tolist(), strict=True)],
        'board_as_it_lies': result.board.tolist(),
        'left_out': [each._asdict() for each in result.left_out]}


def picture(result: CalibrationResult) -> NDArray[np.uint8]:
    """The boards with their residuals, residuals by radius, disparity by distance, the values."""
    boards = -(-len(result.boards) // _COLUMNS)
    height, width = result.boards[0].picture.shape[:2]
    tile = _TILE * height / width
    drawn = Figure((_COLUMNS * _TILE, boards * tile + _PLOTS), layout='constrained')
    halves: Any = drawn.subfigures(2, 1, height_ratios=[boards * tile, _PLOTS])
    above, below = halves
    places = above.subplots(boards, _COLUMNS, squeeze=False).ravel()
    position, _ = residual_rms(result)
    times = float(f'{_LENGTH / max(np.sqrt(np.mean(position ** 2)), 1e-6):.0e}')  # a round number
    for axes in places:
        axes.set_axis_off()
    for index, axes in enumerate(places[:len(result.boards)]):
        _draw_board(axes, result, index, times)
    by_radius, by_distance, values = below.subplots(1, 3)
    _draw_radial(by_radius, result)
    _draw_disparities(by_distance, result)
    title = f'{len(result.boards)} boards, {int(result.fit.observations.valid.sum())} corners'
    if result.calibration.serial:
        title += f', camera {result.calibration.serial}'
    values.set_title(title)
    values.set_axis_off()
    values.table([[name, value, f'± {sigma}' if sigma[:1].isdigit() else sigma, unit]
                  for name, value, sigma, unit in _rows(result)], loc='center', edges='open')
    return charts.picture(drawn)


def _rows(result: CalibrationResult) -> list[tuple[str, str, str, str]]:
    calibration, sigma = result.calibration, standard_deviations(result)

    def row(name: str, label: str, scale: float, unit: str) -> tuple[str, str, str, str]:
        value, deviation = scale * getattr(calibration, name), scale * sigma[name]
        digits = 0 if deviation <= 0 else max(0, int(np.ceil(1 - np.log10(deviation))))
        spread = f'{deviation:.{digits}f}' if deviation else 'held fixed'
        return label, f'{value:.{digits}f}', spread, unit

    one = result.fit.model.focals == 1
    focal = [row('fx', 'fx = fy', 1, 'px')] if one else [row('fx', 'fx', 1, 'px'),
                                                         row('fy', 'fy', 1, 'px')]
    k1, k2 = bok_parameters(calibration.fx, calibration.baseline, calibration.focus_distance)
    return [*focal, row('cx', 'cx', 1, 'px'), row('cy', 'cy', 1, 'px'),
            row('baseline', 'baseline', 1e3, 'mm'),
            row('focus_distance', 'focus distance', 1e3, 'mm'),
            row('k1', 'k1', 1, ''), row('k2', 'k2', 1, ''),
            ('K1 (Bok)', f'{k1:.4f}', '', ''), ('K2 (Bok)', f'{k2:.4f}', '', 'm')]


def _draw_board(axes: Axes, result: CalibrationResult, index: int, times: float) -> None:
    """A centre view with its corners' residuals, `times` as long as they are."""
    view = result.boards[index]
    axes.imshow(view.picture // 2 + np.uint8(127))  # pale: the residuals stand out
    left = result.residuals[index, :, :2].reshape(view.corners.positions.shape)
    used = result.fit.observations.valid[index].reshape(view.corners.valid.shape)
    corners = view.corners.positions[used]
    axes.quiver(*corners.T, *(times * left[used]).T, color=_LINE, angles='xy', scale_units='xy',
                scale=1, width=0.004)
    axes.plot(*corners.T, '.', color=_DOT, markersize=3)
    position, disparity = residual_rms(result)
    axes.set_title(f'{view.name}: {position[index]:.4f} px, {disparity[index]:.4f} px/step; '
                   f'residuals x {times:.0f}', fontsize='small')


def _draw_radial(axes: Axes, result: CalibrationResult) -> None:
    """Radial residuals over the distance from the principal point: distortion would bend them."""
    observations, calibration = result.fit.observations, result.calibration
    valid = observations.valid
    apart = observations.values[valid, :2] - [calibration.cx, calibration.cy]
    radius = np.hypot(*apart.T)
    radial = (result.residuals[valid, :2] * apart).sum(axis=1) / np.maximum(radius, 1e-9)
    axes.plot(radius, radial, '.', color=_DOT)
    axes.axhline(0, color=_LINE)
    most = 1.05 * float(np.abs(radial).max())
    axes.set(xlabel='distance from the principal point [px]', ylabel='radial residual [px]',
             ylim=(-most, most))


def _draw_disparities(axes: Axes, result: CalibrationResult) -> None:
    """Disparities over depth, and the curve that baseline and focus distance make."""
    observations, calibration = result.fit.observations, result.calibration
    valid = observations.valid
    depth = np.einsum('nj,mj->nm', result.poses[:, 2, :3], result.board)
    depth = (depth + result.poses[:, 2, 3, None])[valid]
    axes.plot(depth, observations.values[valid, 2], '.', color=_DOT)
    z = np.linspace(depth.min(), depth.max(), 100)
    axes.plot(z, calibration.fx * calibration.baseline * (1 / calibration.focus_distance - 1 / z),
              color=_LINE)
    axes.set(xlabel='depth of a corner [m]', ylabel='disparity [px per view step]')
