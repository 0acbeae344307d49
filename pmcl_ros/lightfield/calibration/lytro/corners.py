"""Measure a checkerboard's corners in a whole light field at once, on the sensor's own pixels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.lightfield.calibration.lytro.calibration import RAW_PITCH
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.lightfield.white_image import devignette

# Least share of the light at a lenslet's centre. Darker pixels are cut by the rim of the pupil and
# see the scene from nearer to the centre: the baseline would come out too small (by 0.1 % already
# with 0.9). White images have some 1 % of noise.
_WHOLE = 0.95
_LIT = 0.5  # of the brightest: pixels that measure the colour of the light
_LEAST = np.float32(1e-6)  # that is divided by
_MIDDLE = 2  # raw px from a lenslet's centre, where it gets all its light
_WINDOW = 0.45  # of a square, to each side: the next corners' edges stay outside
_LARGEST = 8.0  # view px, a window's half side: there the light is still even enough
_BLUR = 1.0  # view px: radius of the disc that blurs the edges, where the fit starts
_STEPS = 15  # Gauss-Newton steps at most
_DONE = 1e-4  # view px
_FARTHEST = 1.5  # view px: larger moves reach another corner
_SHAPE = 8  # parameters of a corner before those of its light


@dataclass(frozen=True)
class Corners:
    """The inner corners of one board in lattice-aligned views, as (rows, columns) of the board.

    positions: (rows, columns, 2) where the centre view sees them, px.
    disparities: (rows, columns, 2) how far a view a step to +x, to +y sees them displaced to +x,
        to +y, px.
    covariances: (rows, columns, 4, 4) of (position, disparity), from the noise of the pixels.
    contrasts: (rows, columns) linear light; positive where the squares to the upper left and the
        lower right (in the board's own directions) are the lighter ones. NaN: not measured.
    """

    positions: NDArray[np.float64]
    disparities: NDArray[np.float64]
    covariances: NDArray[np.float64]
    contrasts: NDArray[np.float64]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(rows, columns) which corners could be measured."""
        return np.isfinite(self.contrasts)

    def turned(self) -> 'Corners':
        """The same corners of the board turned by 180 degrees."""
        return Corners(*(each[::-1, ::-1] for each in (
            self.positions, self.disparities, self.covariances, self.contrasts)))


class CornerMeter:
    """Measures corners in the raw frames of one camera.

    A raw pixel at `offset` from the centre of its lenslet sees the scene from the place `offset`
    [view steps] of the aperture. Each corner is fitted to all raw pixels around it, of all views,
    without demosaicing or interpolation.
    """

    def __init__(self, lattice: Lattice, light: NDArray[np.float32]) -> None:
        """light: (height, width) that each pixel gets, of `relative_light`."""
        self._light = light
        height, width = light.shape
        i0, i1, j0, j1 = lattice.index_range(width, height)
        self._centres = lattice.centres(
            *np.meshgrid(np.arange(i0, i1), np.arange(j0, j1))).reshape(-1, 2)
        self._places = (self._centres - (RAW_PITCH - 1) / 2) / RAW_PITCH  # view px
        radius = lattice.pitch_px / 2
        span = np.arange(-int(radius), int(radius) + 1)
        around = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
        self._around = around[np.hypot(*around.T) < radius]

    def measure(self, frame: RawFrame, positions: NDArray[np.float64],
                disparities: NDArray[np.float64]) -> Corners:
        """The corners of a board in a frame.

        positions, disparities: (rows, columns, 2) about where they are, as in `Corners`; the
        disparities of one plane.
        """
        linear = self._neutral(devignette(frame, self._light), positions)
        rows, columns = positions.shape[:2]
        # A plane's disparity is an affine function of the pixel.
        affine = np.concatenate([np.ones((rows * columns, 1)), positions.reshape(-1, 2)], axis=1)
        slope = np.linalg.lstsq(affine, disparities.reshape(-1, 2), rcond=None)[0][1:].T
        along, down = np.gradient(positions, axis=1), np.gradient(positions, axis=0)
        place = np.zeros((rows, columns, 4))
        covariances = np.zeros((rows, columns, 4, 4))
        contrasts = np.full((rows, columns), np.nan)
        for at in np.ndindex(rows, columns):
            axes = np.stack([along[at], down[at]], axis=1)
            start = np.concatenate([positions[at], disparities[at]])
            pixels = self._pixels(linear, start, axes)
            place[at], covariances[at], contrasts[at] = _fit(pixels, start, axes, slope)
        return Corners(place[..., :2], place[..., 2:], covariances, contrasts)

    def _neutral(self, linear: NDArray[np.float32],
                 positions: NDArray[np.float64]) -> NDArray[np.float32]:
        """Removes the tint of the light: the four phases get equal means on the grey board."""
        corners = positions.reshape(-1, 2) * RAW_PITCH
        left, top = np.maximum(corners.min(axis=0).astype(int) // 2 * 2, 0)
        right, bottom = corners.max(axis=0).astype(int)
        levels = np.ones((2, 2), np.float32)
        for row, column in np.ndindex(2, 2):
            phase = np.s_[top + row:bottom:2, left + column:right:2]
            levels[row, column] = linear[phase][self._light[phase] > _LIT].mean()
        linear = linear.copy()
        for row, column in np.ndindex(2, 2):
            linear[row::2, column::2] *= levels.mean() / max(levels[row, column], _LEAST)
        return linear

    def _pixels(self, linear: NDArray[np.float32], start: NDArray[np.float64],
                axes: NDArray[np.float64]) -> '_Pixels':
        """The raw pixels that see the window around a corner; axes: its squares' sides (2, 2)."""
        window = axes * min(_WINDOW, _LARGEST / np.abs(axes).max())
        reach = np.abs(window).sum(axis=1) + np.abs(start[2:]) * RAW_PITCH / 2
        near = (np.abs(self._places - start[:2]) < reach).all(axis=1)
        centres = self._centres[near]
        pixels = np.rint(centres).astype(int)[:, None] + self._around
        height, width = linear.shape
        on_sensor = ((pixels >= 0) & (pixels < [width, height])).all(axis=-1)
        lenslet = np.nonzero(on_sensor)[0]
        x, y = pixels[on_sensor].T
        offsets = np.stack([x, y], axis=1) - centres[lenslet]
        light = self._light[y, x]
        middle = np.hypot(*offsets.T) < _MIDDLE
        whole = light > _WHOLE * np.median(light[middle]) if middle.any() else middle
        places = self._places[near][lenslet]
        seen = np.linalg.solve(window, (places - start[:2] - start[2:] * offsets).T)
        used = whole & (np.abs(seen) < 1).all(axis=0)
        return _Pixels(places[used], offsets[used], linear[y, x][used].astype(float))


@dataclass(frozen=True)
class _Pixels:
    """places (n, 2) of lenslets [view px], offsets (n, 2) from their centres, values (n,)."""

    places: NDArray[np.float64]
    offsets: NDArray[np.float64]
    values: NDArray[np.float64]


def _fit(pixels: _Pixels, start: NDArray[np.float64], axes: NDArray[np.float64],
         slope: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """(position, disparity), its covariance and the contrast of one corner; a NaN contrast: none.

    Gauss-Newton on the values of the pixels: two blurred edges through the corner, their
    directions and the blur free, in a light that changes linearly over the window.
    """
    none = start, np.full((4, 4), np.inf), np.nan
    directions = np.arctan2(axes[1], axes[0])
    shape = np.array([*start, *directions, *np.log([_BLUR, _BLUR])])
    first = shape
    if len(pixels.values) < 20 * _SHAPE:
        return none
    for _ in range(_STEPS):
        jacobian, levels, residuals = _linearised(pixels, shape, slope)
        normal = jacobian.T @ jacobian
        try:
            covariance = np.linalg.inv(normal)
        except np.linalg.LinAlgError:
            return none
        step = (covariance @ (jacobian.T @ residuals))[:_SHAPE]
        shape = shape + np.clip(step, -0.5, 0.5)
        if not np.abs(shape - first).max() < 2 * _FARTHEST:
            return none
        if np.abs(step[:4]).max() < _DONE:
            break
    else:
        return none
    if np.abs(shape[:2] - start[:2]).max() > _FARTHEST:
        return none
    noise = residuals @ residuals / (len(residuals) - len(normal))
    return shape[:4], noise * covariance[:4, :4], float(levels[3])


def _linearised(pixels: _Pixels, shape: NDArray[np.float64], slope: NDArray[np.float64],
                ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Jacobian (n, 8 + 6), the six levels of light that fit best, residuals (n,).

    shape: position, disparity, directions and logarithms of the blur's radius of the row's and
        the column's edge.
    slope: (2, 2) of the disparity, per view px.
    """
    corner, disparity, (row, column), blur = shape[:2], shape[2:4], shape[4:6], np.exp(shape[6:])
    seen = pixels.places - corner - disparity * pixels.offsets  # from the corner, centre view
    seen = seen - (seen @ slope.T) * pixels.offsets
    across = np.array([[-np.sin(row), np.cos(row)], [np.sin(column), -np.cos(column)]])
    turning = np.array([[-np.cos(row), -np.sin(row)], [np.cos(column), np.sin(column)]])
    # A lenslet integrates light over its disc: an edge's profile is the share of a disc it cuts.
    distance = np.clip(seen @ across.T / blur, -1, 1)
    chord = np.sqrt(1 - distance ** 2)
    edge = 2 / np.pi * (distance * chord + np.arcsin(distance))
    rise = 4 / np.pi * chord
    light = np.concatenate([np.ones((len(seen), 1)), seen], axis=1)
    basis = np.concatenate([light, light * edge.prod(axis=1, keepdims=True)], axis=1)
    levels = np.linalg.solve(basis.T @ basis, basis.T @ pixels.values)
    steepness = (light @ levels[3:])[:, None] * rise * edge[:, ::-1]
    steepness /= blur
    moved = -steepness @ across
    jacobian = np.concatenate([moved, moved * pixels.offsets, steepness * (seen @ turning.T),
                               -steepness * distance * blur, basis], axis=1)
    return jacobian, levels, pixels.values - basis @ levels
