"""Draws a lattice over its raw frame, and the residuals of its fit."""

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.drawing.charts import picture
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.lightfield.calibration.lytro.lattice_fit import LatticeFit

_CROP, _ZOOM = 46, 7  # raw px, and pixels drawn for each
_RIM = 4  # px between crops
_SIDE = 3 * _CROP * _ZOOM + 4 * _RIM  # px of each half of the picture
_DPI = 100


def lattice_picture(frame: RawFrame, fit: LatticeFit) -> NDArray[np.uint8]:
    """(height, width, 3) RGB.

    Left: crops of the frame at the sensor's corners, edges and middle, with the centres marked.
    Right: the residuals (measured minus modelled centres) of the tiles over the sensor: their size
    in colours, from none (dark) to twice the 95th percentile, and arrows in their direction; tiles
    that were not used have no arrow.
    """
    drawn = Figure((2 * _SIDE / _DPI, _SIDE / _DPI), _DPI)
    height, width = frame.counts.shape
    side = min(_CROP, height, width)
    for row, column in np.ndindex(3, 3):
        left, top = (width - side) * column // 2, (height - side) * row // 2
        x, y = (_RIM + each * (_CROP * _ZOOM + _RIM) for each in (column, row))
        size = side * _ZOOM / _SIDE
        axes = drawn.add_axes((x / _SIDE / 2, 1 - y / _SIDE - size, size / 2, size))
        axes.imshow(_grey(frame, left, top, side), 'gray', vmin=0, vmax=1, interpolation='nearest',
                    extent=(left - 0.5, left + side - 0.5, top + side - 0.5, top - 0.5))
        axes.plot(*_centres(fit.lattice, left, top, side).T, '+', color='#ff2828', markersize=8)
        axes.set(xlim=axes.get_xlim(), ylim=axes.get_ylim())
        axes.set_axis_off()
    _draw_residuals(drawn, frame, fit)
    return picture(drawn)


def _grey(frame: RawFrame, left: int, top: int, side: int) -> NDArray[np.float64]:
    """(side, side) a crop in 0 to 1; by phase of the mosaic, whose colours are no pattern then."""
    counts = frame.counts[top:top + side, left:left + side].astype(float)
    for row, column in np.ndindex(2, 2):
        phase = counts[row::2, column::2] - frame.metadata.black
        counts[row::2, column::2] = phase / max(float(np.percentile(phase, 99)), 1.0)
    return np.clip(counts, 0, 1) ** 0.7


def _centres(lattice: Lattice, left: int, top: int, side: int) -> NDArray[np.float64]:
    """(n, 2) the lenslets' centres in a crop [raw px]."""
    i, j = lattice.nearest(np.array([left + side / 2, top + side / 2]))
    steps = np.arange(-int(side / lattice.row_step_px) - 2, int(side / lattice.row_step_px) + 3)
    centres = lattice.centres(*np.meshgrid(i + steps, j + steps)).reshape(-1, 2)
    inside = (np.abs(centres - [left + (side - 1) / 2, top + (side - 1) / 2]) <= side / 2)
    return np.asarray(centres[inside.all(axis=1)])


def _draw_residuals(drawn: Figure, frame: RawFrame, fit: LatticeFit) -> None:
    height, width = frame.counts.shape
    axes = drawn.add_axes((0.52, 0.02, 0.46, 0.92))
    lengths, top = np.hypot(*fit.errors.T), max(2 * fit.p95_px, 1e-6)
    tile = np.sqrt(np.prod(np.ptp(fit.places, axis=0)) / len(fit.places))
    points = tile / max(height, width) * 0.92 * _SIDE * 72 / _DPI  # a tile's side in the picture
    axes.scatter(fit.places[:, 0], fit.places[:, 1], points ** 2, lengths, marker='s', vmin=0,
                 vmax=top, linewidths=0)
    # An error of the 95th percentile is drawn as long as a tile is wide, and so are larger ones.
    arrows = fit.errors * (tile / np.maximum(lengths, top / 2))[:, None]
    axes.quiver(*fit.places[fit.used].T, *arrows[fit.used].T, color='white', angles='xy',
                scale_units='xy', scale=1, pivot='mid', width=0.002)
    longest = max(height, width)
    axes.set(xlim=(0, longest), ylim=(longest, 0), aspect='equal')
    axes.set_title(f'centres measured - modelled: median {fit.median_px:.3f} px, 95 % within '
                   f'{fit.p95_px:.3f} px; yellow: {top:.3f} px', fontsize='medium')
    axes.set_axis_off()
