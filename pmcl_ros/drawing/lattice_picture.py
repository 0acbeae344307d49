"""A lattice drawn over its raw frame: (height, width, 3) uint8 RGB, without a screen."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.lightfield.calibration.lattice import Lattice
from pmcl_ros.lightfield.calibration.lattice_fit import LatticeFit

_CROP, _ZOOM = 46, 7  # raw px, and pixels drawn for each
_RIM = 4  # px between crops
_CENTRE = (255, 40, 40)
_CROSS = 5  # px, an arm
_PLOT = 3 * _CROP * _ZOOM + 4 * _RIM  # px, side of the plot of residuals: as the crops together
_MARGIN = 30  # px about the plot, its title above


def lattice_picture(frame: RawFrame, fit: LatticeFit) -> NDArray[np.uint8]:
    """Left: crops of the frame at the sensor's corners, edges and middle, with the centres marked.

    Right: the residuals (measured minus modelled centres) of the tiles over the sensor: their size
    in colours, from none (dark) to twice the 95th percentile, and arrows in their direction; tiles
    that were not used have no arrow.
    """
    return np.hstack([_crops(frame, fit.lattice), _residuals(frame, fit)])


def _crops(frame: RawFrame, lattice: Lattice) -> NDArray[np.uint8]:
    height, width = frame.counts.shape
    canvas = np.full((_PLOT, _PLOT, 3), 255, np.uint8)
    side = min(_CROP, height, width)
    for row in range(3):
        for column in range(3):
            left, top = (width - side) * column // 2, (height - side) * row // 2
            crop = _crop(frame, lattice, left, top, side)
            y, x = (_RIM + k * (_CROP * _ZOOM + _RIM) for k in (row, column))
            canvas[y:y + crop.shape[0], x:x + crop.shape[1]] = crop
    return canvas


def _crop(frame: RawFrame, lattice: Lattice, left: int, top: int, side: int) -> NDArray[np.uint8]:
    counts = frame.counts[top:top + side, left:left + side].astype(float)
    # By phase of the mosaic: colours would look like a pattern.
    grey = np.zeros_like(counts)
    for row, column in np.ndindex(2, 2):
        phase = counts[row::2, column::2] - frame.metadata.black
        grey[row::2, column::2] = phase / max(float(np.percentile(phase, 99)), 1.0)
    levels = np.rint(255 * np.clip(grey, 0, 1) ** 0.7).astype(np.uint8)
    crop = np.repeat(np.repeat(levels, _ZOOM, axis=0), _ZOOM, axis=1)[..., None].repeat(3, axis=2)
    i, j = lattice.nearest(np.array([left + side / 2, top + side / 2]))
    reach = int(side / lattice.row_step_px) + 2
    centres = lattice.centres(*np.meshgrid(i + np.arange(-reach, reach + 1),
                                           j + np.arange(-reach, reach + 1)))
    pixels = (centres.reshape(-1, 2) - [left, top] + 0.5) * _ZOOM - 0.5
    for x, y in np.rint(pixels[((pixels >= 0) & (pixels < side * _ZOOM)).all(axis=1)]).astype(int):
        cv2.line(crop, (int(x) - _CROSS, int(y)), (int(x) + _CROSS, int(y)), _CENTRE, 1)
        cv2.line(crop, (int(x), int(y) - _CROSS), (int(x), int(y) + _CROSS), _CENTRE, 1)
    return crop


def _residuals(frame: RawFrame, fit: LatticeFit) -> NDArray[np.uint8]:
    height, width = frame.counts.shape
    canvas = np.full((_PLOT, _PLOT, 3), 255, np.uint8)
    scale = (_PLOT - 2 * _MARGIN) / max(height, width)
    top = max(2 * fit.p95_px, 1e-6)
    places = fit.places * scale + _MARGIN
    half = np.sqrt(np.prod(np.ptp(places, axis=0)) / len(places)) / 2
    levels = np.rint(255 * np.clip(np.hypot(*fit.errors.T) / top, 0, 1)).astype(np.uint8)
    colours = cv2.applyColorMap(levels[:, None], cv2.COLORMAP_VIRIDIS)[:, 0, ::-1]
    for (x, y), colour in zip(places, colours.tolist(), strict=True):
        cv2.rectangle(canvas, (round(x - half), round(y - half)),
                      (round(x + half), round(y + half)), colour, -1)
    # An error of the 95th percentile is drawn as long as a tile is wide, and so are larger ones.
    arrows = fit.errors * (2 * half / np.maximum(np.hypot(*fit.errors.T), top / 2))[:, None]
    for place, arrow in zip(places[fit.used], arrows[fit.used], strict=True):
        start, end = (np.rint(16 * (place + part * arrow)).astype(int).tolist()
                      for part in (-0.5, 0.5))
        cv2.arrowedLine(canvas, start, end, (255, 255, 255), 1, cv2.LINE_AA, 4, 0.3)
    cv2.putText(canvas, f'centres measured - modelled: median {fit.median_px:.3f} px, 95 % within '
                f'{fit.p95_px:.3f} px; yellow: {top:.3f} px', (_MARGIN, _MARGIN - 10),
                cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
    return canvas
