"""The lattice of a camera's lenslets, estimated from a white image or from an ordinary picture."""

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.lightfield.calibration.lytro.lattice_waves import (
    Tiles,
    beat,
    find_lattice,
    local_contrast,
    measure_tiles,
    wave_frequencies,
)
from pmcl_ros.runtime.errors import LightFieldError

_LOG = logging.getLogger(__name__)

_SMALLEST = 128  # raw px, a side of the frame
_TILE, _LEAST_TILE = 8, 5  # pitches: a tile's side, and the least where the frame is small
_TILES, _LEAST_TILES = 8, 4  # along each side: where there may be fewer, tiles get smaller
_LEAST_USED = 12  # tiles; seven unknowns are fitted to two numbers of each
_ROUNDS = 3  # of measuring tiles anew with the lattice that they gave
_STEPS = 10  # of reweighting
_ROUNDING = 1e-3  # raw px: measured centres are not better
# Of a pitch: tiles with larger errors have random phases, of which 6 % lie nearer by chance.
_NEAR = 0.125
_LEAST_NEAR = 0.25  # share of tiles; four times what chance gives
# rad: tolerance of the sum of the three phases. It is 0 for discs, pi for the dark holes of a
# honeycomb.
_CLOSED = 0.6
_DARKEST, _BRIGHTEST = 0.01, 0.99  # of the sensor's range
# Least relative change of a wave's amplitude that indicates another shape of the discs: noise and
# sampling cause smaller ones.
_LEAST_SHAPE = 0.03


@dataclass(frozen=True)
class LatticeFit:
    """An estimated lattice, and how the measured centres of lenslets lie about it.

    lattice: lenslet (0, 0) is one of those nearest to the sensor's centre.
    median_px, p95_px: of the distances of the measured centres from the model, raw px. A measured
        centre is that of the some 64 lenslets of one tile together; those used for the fit count.
    lenslets: number of lenslets in the tiles used.
    shear: rad by which the angle between rows and columns was measured to be less than a right
        one. A `Lattice` has none; on a real F01 it is 1e-4 (0.1 px at the sensor's edge).
    places: (n, 2) raw px (column, row) of the tiles.
    errors: (n, 2) raw px, measured minus modelled centre.
    used: (n,) bool, the tiles that the fit rests on.
    """

    lattice: Lattice
    median_px: float
    p95_px: float
    lenslets: int
    shear: float
    places: NDArray[np.float64]
    errors: NDArray[np.float64]
    used: NDArray[np.bool_]


def fit_lattice(white: RawFrame) -> LatticeFit:
    """The lattice of a white image, to about 0.001 px.

    Only tiles with discs like those in the middle of the sensor count: towards the corners the
    main lens' rim cuts the discs on one side, which moves their centres of light. The rest of
    this effect grows with the cube of the distance; it is fitted beside the lattice and dropped.
    Raises LightFieldError when the frame shows no lattice or is too dark, saturated or small.
    """
    return _fit(white, of_white=True)


def lattice_from_picture(frame: RawFrame) -> LatticeFit:
    """The lattice of an ordinary picture, from the dark gaps between the discs.

    Raises LightFieldError when the frame shows no lattice or is too dark, saturated or small.
    """
    return _fit(frame, of_white=False)


def _fit(frame: RawFrame, of_white: bool) -> LatticeFit:
    light = _light(frame)
    pitch, rotation = find_lattice(local_contrast(light))
    contrast = local_contrast(light, pitch)
    if not of_white:  # discs show the scene; only the gaps between them are always dark
        contrast = np.minimum(contrast, 0)
    side = _tile_side(pitch, contrast.shape)
    lattice = _first_lattice(contrast, pitch, rotation, side)
    for _ in range(_ROUNDS):
        tiles = measure_tiles(contrast, _frequencies(lattice), side)
        errors = _centre_errors(tiles, lattice)
        weights = _weights(tiles, of_white, contrast.shape)
        lattice, shear, used = _adjusted(lattice, tiles, errors, weights, of_white)
    tiles = measure_tiles(contrast, _frequencies(lattice), side)
    errors = _centre_errors(tiles, lattice)
    distances = np.hypot(*errors.T)
    near = float((distances < _NEAR * pitch).mean())
    if near < _LEAST_NEAR:
        raise LightFieldError(
            f'no lattice of lenslets: only {100 * near:.0f} % of the tiles of the frame have them '
            f'where a lattice of pitch {lattice.pitch_px:.3f} px has; is this a raw picture of a '
            'light-field camera?')
    if used.sum() < _LEAST_USED:
        raise LightFieldError(
            f'only {used.sum()} of {len(used)} tiles of the frame agree about the lattice, '
            f'{_LEAST_USED} are needed; give a white image, or a larger or better exposed picture')
    median, p95 = np.percentile(distances[used], [50, 95])
    lenslets = round(int(used.sum()) * side ** 2 / (lattice.pitch_px * lattice.row_step_px))
    fit = LatticeFit(lattice, float(median), float(p95), lenslets, shear, tiles.centres, errors,
                     used)
    _LOG.info('lattice: %s; %d lenslets, median %.3f px, 95 %% within %.3f px, shear %.1e rad',
              lattice, lenslets, median, p95, shear)
    return fit


def _light(frame: RawFrame) -> NDArray[np.float32]:
    """0 at black, 1 at the sensor's white."""
    if min(frame.counts.shape) < _SMALLEST:
        raise LightFieldError(f'raw frame of {frame.counts.shape[1]}x{frame.counts.shape[0]} is '
                              f'too small for a lattice; at least {_SMALLEST} px are needed')
    light = frame.linear()
    dim, bright = np.percentile(light[::5, ::7], [10, 99])
    if bright < _DARKEST:
        raise LightFieldError(f'raw frame is too dark for a lattice: its brightest pixels are at '
                              f"{100 * bright:.1f} % of the sensor's range; expose it longer")
    if dim > _BRIGHTEST:
        raise LightFieldError(f'raw frame is saturated: 90 % of its pixels are above '
                              f"{100 * dim:.0f} % of the sensor's range; expose it less")
    return light


def _tile_side(pitch: float, shape: tuple[int, ...]) -> int:
    """Raw px."""
    side = round(np.clip(min(shape) / _TILES, _LEAST_TILE * pitch, _TILE * pitch))
    if side * _LEAST_TILES > min(shape):
        raise LightFieldError(
            f'raw frame of {shape[1]}x{shape[0]} holds too few lenslets of {pitch:.1f} px for a '
            f'fit; at least {_LEAST_TILES * _LEAST_TILE} along each side are needed')
    return side


def _first_lattice(contrast: NDArray[np.float32], pitch: float, rotation: float,
                   side: int) -> Lattice:
    """Pitch, row step and rotation to about 1e-5, the centre to some tenths of a pixel."""
    found = wave_frequencies(pitch, pitch * 3 ** 0.5 / 2, rotation)
    tiles = measure_tiles(contrast, found, side)
    found = found + [beat(tiles, wave) for wave in range(3)]
    sums = np.array([[1, 0], [1, 1], [0, 1]])
    reciprocal = np.linalg.lstsq(sums, found, rcond=None)[0]
    mismatch = np.abs(sums @ reciprocal - found).max() * side
    if mismatch > 0.1:
        raise LightFieldError(
            'no lattice of lenslets: the three strongest waves do not form a lattice, they run '
            f'{mismatch:.2f} cycles apart within {side} px; is this a raw picture of a '
            'light-field camera?')
    first, second = np.linalg.inv(reciprocal.T)  # to the next lenslet of the row, of the next row
    down = second - first / 2
    values = {'pitch_px': np.hypot(*first), 'row_step_px': np.hypot(*down),
              'rotation': np.arctan2(first[1], first[0]), 'centre_px': (0, 0)}
    lattice = Lattice.make({name: np.asarray(value).tolist() for name, value in values.items()},
                           'lattice')
    frequencies = _frequencies(lattice)
    phasors = measure_tiles(contrast, frequencies, side).phasors
    sizes = np.abs(phasors)
    sizes = sizes + np.median(sizes, axis=1, keepdims=True) + np.finfo(np.float32).tiny
    phases = np.angle((phasors / sizes).sum(axis=1))
    open_by = float(np.angle(np.exp(1j * (phases[0] + phases[2] - phases[1]))))
    if abs(open_by) > _CLOSED:
        raise LightFieldError(
            f'no lattice of bright discs: the phases of its waves sum to {open_by:.2f} rad, not '
            '0; is this a raw picture of a light-field camera?')
    centre = np.linalg.solve(-2 * np.pi * frequencies[[0, 2]], phases[[0, 2]])
    lattice = lattice.model_copy(update={'centre_px': tuple(centre.tolist())})
    return _recentred(lattice, contrast.shape)


def _recentred(lattice: Lattice, shape: tuple[int, ...]) -> Lattice:
    """The same lattice, counted from a lenslet near the middle of the sensor."""
    middle = np.array([(shape[1] - 1) / 2, (shape[0] - 1) / 2])
    i, j = lattice.nearest(middle)
    centre = lattice.centres(i, j - j % 2)  # of an even row, as lenslet (0, 0) is
    return lattice.model_copy(update={'centre_px': tuple(centre.tolist())})


def _frequencies(lattice: Lattice) -> NDArray[np.float64]:
    return wave_frequencies(lattice.pitch_px, lattice.row_step_px, lattice.rotation)


def _centre_errors(tiles: Tiles, lattice: Lattice) -> NDArray[np.float64]:
    """(n, 2) raw px from the model's centres to the centres measured by a tile's phases."""
    frequencies = _frequencies(lattice)
    model = np.exp(-2j * np.pi * frequencies @ np.array(lattice.centre_px))
    phases = np.angle(tiles.phasors / model[:, None])
    return (np.linalg.pinv(-2 * np.pi * frequencies) @ phases).T


def _weights(tiles: Tiles, of_white: bool, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """(n,) prior weight of each tile, before its agreement with the others."""
    sizes = np.abs(tiles.phasors)
    if not of_white:
        weakest = sizes.min(axis=0)
        return weakest ** 2 / (weakest ** 2 + (np.median(weakest) / 2) ** 2)
    # Amplitudes do not depend on brightness: they change with the shape of the discs.
    away = np.abs(tiles.centres * 2 / np.array(shape[::-1]) - 1).max(axis=1)
    inner = away <= max(1 / 3, away.min())
    usual = np.median(sizes[:, inner], axis=1, keepdims=True)
    change = np.abs(sizes / usual - 1).max(axis=0)
    tolerance = max(_LEAST_SHAPE, 3 * float(np.median(change[inner])))
    return 1 / (1 + (change / tolerance) ** 4)


def _adjusted(lattice: Lattice, tiles: Tiles, errors: NDArray[np.float64],
              weights: NDArray[np.float64],
              of_white: bool) -> tuple[Lattice, float, NDArray[np.bool_]]:
    """The lattice moved to the errors' robust fit, its shear [rad], and which tiles count."""
    apart = tiles.centres - lattice.centre_px
    cos, sin = np.cos(lattice.rotation), np.sin(lattice.rotation)
    row, normal = np.array([cos, sin]), np.array([-sin, cos])
    along, across = apart @ row, apart @ normal
    size = np.abs(apart).max()
    columns = [np.broadcast_to([1.0, 0.0], apart.shape), np.broadcast_to([0.0, 1.0], apart.shape),
               along[:, None] * row, across[:, None] * normal,
               np.stack([-apart[:, 1], apart[:, 0]], axis=1),
               (across[:, None] * row + along[:, None] * normal) / 2]
    if of_white:
        columns.append(apart * (apart ** 2).sum(axis=1, keepdims=True) / size ** 2)
    scale = np.array([1, 1] + [1 / size] * (len(columns) - 2))
    design = np.stack(columns, axis=-1) * scale
    solution, agreed = _robust(design, errors, weights)
    shift_x, shift_y, stretch, row_stretch, turn, shear = (solution * scale)[:6]
    moved = Lattice.make({
        'pitch_px': lattice.pitch_px * (1 + stretch),
        'row_step_px': lattice.row_step_px * (1 + row_stretch),
        'rotation': lattice.rotation + turn,
        'centre_px': (lattice.centre_px[0] + shift_x, lattice.centre_px[1] + shift_y)}, 'lattice')
    return moved, float(shear), agreed


def _robust(design: NDArray[np.float64], values: NDArray[np.float64],
            weights: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Solution of design (n, 2, k) x = values (n, 2), and which of the n carry it.

    Reweighted least squares with Geman and McClure's weights: outliers lose all influence.
    """
    agreement = np.ones_like(weights)
    trusted = weights > 0.5 * weights.max()
    for _ in range(_STEPS):
        root = np.sqrt(weights * agreement)[:, None]
        solution = np.linalg.lstsq((design * root[..., None]).reshape(-1, design.shape[-1]),
                                   (values * root).ravel(), rcond=None)[0]
        distances = np.hypot(*(values - design @ solution).T)
        # Of a Gaussian in the plane the median distance is 1.18 sigma.
        sigma = float(np.median(distances[trusted])) / 1.18 + _ROUNDING
        agreement = 1 / (1 + (distances / (2 * sigma)) ** 2) ** 2
    return np.asarray(solution, float), trusted & (agreement > 0.1)
