"""What a calibration rests on, to look at: a picture, a table, and numbers to read on."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.lightfield.calibration.calibrate import CalibrationResult
from pmcl_ros.lightfield.calibration.camera_model import PARAMETERS, bok_parameters

_ZOOM = 2  # of the centre views
_LENGTH = 12  # px: about how long residuals are drawn
_COLUMNS = 4  # boards side by side
_PLOT = (656, 360)  # px, width and height
_MARGIN = 52
_INK, _GREY, _LINE, _DOT = (30, 30, 30), (150, 150, 150), (220, 40, 40), (20, 90, 200)
_LETTERS = 0.42


def standard_deviations(result: CalibrationResult) -> dict[str, float]:
    """Of the calibration's parameters by name, in its units; 0: held fixed."""
    values = dict(zip(PARAMETERS, result.uncertainty.camera.tolist(), strict=True))
    values['focus_distance'] = values.pop('focus') * result.calibration.focus_distance ** 2
    return values


def residual_rms(result: CalibrationResult) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of each board: position [px], disparity [px per view step]; one number for both axes."""
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
        'Standard deviations: ' + ', '.join(
            f'{name} {value:.2g}' for name, value in sigma.items() if value) + '.',
        'Bok et al.: K1 {:.4f}, K2 {:.4f} m.'.format(*bok_parameters(
            calibration.fx, calibration.baseline, calibration.focus_distance))])


def tables(result: CalibrationResult) -> tuple[Table, Table]:
    """The estimates with their standard deviations; the boards with what is left of each."""
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
        'left_out': [each._asdict() for each in result.left_out]}


def write_report(path: Path | str, result: CalibrationResult) -> None:
    """Write the picture of a calibration, PNG; PmclError when that is impossible."""
    write_png(path, picture(result))


def picture(result: CalibrationResult) -> NDArray[np.uint8]:
    """The boards with their residuals, residuals by radius, disparity by distance, the values."""
    position, _ = residual_rms(result)
    times = float(f'{_LENGTH / max(np.sqrt(np.mean(position ** 2)), 1e-6):.0e}')  # a round number
    tiles = [_board(result, index, times) for index in range(len(result.boards))]
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % _COLUMNS)
    rows = [np.concatenate(tiles[k:k + _COLUMNS], axis=1)
            for k in range(0, len(tiles), _COLUMNS)]
    below = np.concatenate([_by_radius(result), _by_distance(result), _values(result)], axis=1)
    width = max(rows[0].shape[1], below.shape[1])
    return np.concatenate([_widened(each, width) for each in (*rows, below)])


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


def _board(result: CalibrationResult, index: int, times: float) -> NDArray[np.uint8]:
    """A centre view with its corners' residuals, many times too long."""
    view = result.boards[index]
    canvas = np.asarray(cv2.resize(view.picture, None, fx=_ZOOM, fy=_ZOOM,
                                   interpolation=cv2.INTER_CUBIC), np.uint8)
    canvas = canvas // 2 + np.uint8(127)  # pale: the residuals are what is to be seen
    left = result.residuals[index, :, :2].reshape(view.corners.positions.shape)
    used = result.fit.observations.valid[index].reshape(view.corners.valid.shape)
    for at in zip(*np.nonzero(used), strict=True):
        corner = (view.corners.positions[at] + 0.5) * _ZOOM - 0.5
        _line(canvas, corner, corner + times * left[at], _LINE)
        cv2.circle(canvas, _pixel(corner), 2, _DOT, -1, cv2.LINE_AA)
    position, disparity = residual_rms(result)
    _write(canvas, f'{view.name}: {position[index]:.4f} px, {disparity[index]:.4f} px/step', 6, 16)
    _write(canvas, f'residuals x {times:.0f}', 6, canvas.shape[0] - 8)
    return canvas


def _by_radius(result: CalibrationResult) -> NDArray[np.uint8]:
    """Radial residuals over the distance from the principal point: distortion would bend them."""
    observations, calibration = result.fit.observations, result.calibration
    valid = observations.valid
    apart = observations.values[valid, :2] - [calibration.cx, calibration.cy]
    radius = np.hypot(*apart.T)
    radial = (result.residuals[valid, :2] * apart).sum(axis=1) / np.maximum(radius, 1e-9)
    return _plot(radius, radial, 'distance from the principal point [px]',
                 'radial residual [px]', flat=True)


def _by_distance(result: CalibrationResult) -> NDArray[np.uint8]:
    """Disparities over depth, and the curve that baseline and focus distance make."""
    observations, calibration = result.fit.observations, result.calibration
    valid = observations.valid
    depth = np.einsum('nj,mj->nm', result.poses[:, 2, :3], observations.points)
    depth = (depth + result.poses[:, 2, 3, None])[valid]
    measured = observations.values[valid, 2]
    z = np.linspace(depth.min(), depth.max(), 100)
    curve = calibration.fx * calibration.baseline * (1 / calibration.focus_distance - 1 / z)
    return _plot(depth, measured, 'depth of a corner [m]', 'disparity [px per view step]',
                 (z, curve))


def _plot(x: NDArray[np.float64], y: NDArray[np.float64], across: str, up: str,
          curve: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
          flat: bool = False) -> NDArray[np.uint8]:
    """Dots, with a curve or the line y = 0, on white."""
    width, height = _PLOT
    canvas = np.full((height, width, 3), 255, np.uint8)
    low, high = np.array([x.min(), y.min()]), np.array([x.max(), y.max()])
    if flat:  # as far down as up
        low[1], high[1] = -np.abs(y).max(), np.abs(y).max()
    span = np.maximum(high - low, 1e-12)

    def place(points: NDArray[np.float64]) -> NDArray[np.float64]:
        part = (points - low) / span
        return _MARGIN + np.stack([part[:, 0], 1 - part[:, 1]], axis=1) * [
            width - 1.5 * _MARGIN, height - 2 * _MARGIN]

    line = np.stack(curve or (np.array([low[0], high[0]]), np.zeros(2)), axis=1)
    for start, end in zip(place(line)[:-1], place(line)[1:], strict=True):
        _line(canvas, start, end, _LINE)
    for point in place(np.stack([x, y], axis=1)):
        cv2.circle(canvas, _pixel(point), 2, _DOT, -1, cv2.LINE_AA)
    right, bottom = width - _MARGIN // 2, height - _MARGIN
    cv2.rectangle(canvas, (_MARGIN, _MARGIN), (right, bottom), _GREY)
    _write(canvas, up, _MARGIN, _MARGIN - 10)
    _write(canvas, across, width // 2 - 4 * len(across), height - 12)
    for value, (left, top) in ((low[0], (_MARGIN - 10, bottom + 18)),
                               (high[0], (right - 30, bottom + 18)),
                               (low[1], (4, bottom)), (high[1], (4, _MARGIN + 8))):
        _write(canvas, f'{value:.3g}', left, top)
    return canvas


def _values(result: CalibrationResult) -> NDArray[np.uint8]:
    canvas = np.full((_PLOT[1], _PLOT[0], 3), 255, np.uint8)
    title = f'{len(result.boards)} boards, {int(result.fit.observations.valid.sum())} corners'
    if result.calibration.serial:
        title += f', camera {result.calibration.serial}'
    _write(canvas, title, 20, 30)
    for index, (name, value, sigma, unit) in enumerate(_rows(result)):
        spread = f'+- {sigma}' if sigma[:1].isdigit() else sigma
        for text, x in ((name, 20), (value, 170), (spread, 290), (unit, 420)):
            _write(canvas, text, x, 62 + 22 * index)
    return canvas


def _widened(picture: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    missing = width - picture.shape[1]
    return np.pad(picture, ((0, 0), (0, missing), (0, 0)), constant_values=255)


def _pixel(point: NDArray[np.float64]) -> tuple[int, int]:
    x, y = np.rint(np.clip(point, -9999, 9999)).astype(int).tolist()
    return x, y


def _line(canvas: NDArray[np.uint8], start: NDArray[np.float64], end: NDArray[np.float64],
          colour: tuple[int, int, int]) -> None:
    cv2.line(canvas, _pixel(start), _pixel(end), colour, 1, cv2.LINE_AA)


def _write(canvas: NDArray[np.uint8], text: str, x: int, y: int) -> None:
    cv2.putText(canvas, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, _LETTERS, _INK, 1, cv2.LINE_AA)
