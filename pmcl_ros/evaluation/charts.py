"""Line charts, drawn without a screen: (height, width, 3) uint8 RGB arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

_COLOURS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233),
            (230, 159, 0))  # told apart by colour-blind eyes too (Okabe and Ito)
_GREY, _BLACK = (205, 205, 205), (40, 40, 40)
_LEFT, _RIGHT, _TOP, _BOTTOM = 56, 16, 34, 52  # px around the axes and the legend
_FRACTION = 4  # bits of a pixel's fraction in OpenCV's drawing functions
_DASH = 18  # px: of a dash and the gap after it


@dataclass(frozen=True)
class Line:
    """y over x, both (n,). colour counts from 0; NaN breaks the line."""

    name: str
    x: ArrayLike
    y: ArrayLike
    colour: int = 0
    dashed: bool = False


def chart(title: str, x_name: str, y_name: str, lines: Sequence[Line],
          x_range: tuple[float, float], y_range: tuple[float, float],
          size: tuple[int, int] = (400, 270)) -> NDArray[np.uint8]:
    """Lines over a grid of round numbers, a legend at their right. size: of the axes [px].

    A range may run from a larger number to a smaller one.
    """
    width, height = size[0] + _LEFT + _RIGHT, size[1] + _TOP + _BOTTOM
    names = 56 + max(_length(each.name) for each in lines)
    canvas = np.full((height, width + names, 3), 255, np.uint8)
    low, high = np.array([x_range[0], y_range[0]]), np.array([x_range[1], y_range[1]])
    corner = np.array([_LEFT, height - _BOTTOM])
    extent = np.array([size[0], -size[1]])

    def place(x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        return corner + (np.stack([x, y], axis=-1) - low) / (high - low) * extent

    for axis, (start, end) in enumerate((x_range, y_range)):
        for value in round_numbers(min(start, end), max(start, end)):
            ends = [(value, y_range[0]), (value, y_range[1])] if axis == 0 else [
                (x_range[0], value), (x_range[1], value)]
            _draw(canvas, np.array([place(*each) for each in ends]), _GREY, 1)
            x, y = np.rint(place(*ends[0])).astype(int)
            if axis == 0:
                _write(canvas, f'{value:g}', x, y + 16, centred=True)
            else:
                _write(canvas, f'{value:g}', x - 6 - _length(f'{value:g}'), y + 4)
    for each in lines:
        points = place(np.asarray(each.x, float), np.asarray(each.y, float))
        _draw(canvas, points, _COLOURS[each.colour % len(_COLOURS)], 2, each.dashed)
    _legend(canvas, lines, width)
    _write(canvas, title, _LEFT + size[0] // 2, 20, centred=True)
    _write(canvas, x_name, _LEFT + size[0] // 2, height - 12, centred=True)
    _write(canvas, y_name, 6, 20)
    return canvas


def beside(pictures: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Pictures of the same height from left to right."""
    return np.concatenate(pictures, axis=1)


def round_numbers(low: float, high: float) -> NDArray[np.float64]:
    """Multiples of 1, 2 or 5 times a power of ten, about five of them."""
    rough = (high - low) / 5
    power = 10.0 ** np.floor(np.log10(rough))
    step = power * min((1, 2, 5, 10), key=lambda each: abs(np.log(each * power / rough)))
    numbers = np.arange(np.ceil(low / step - 1e-9), high / step + 1e-9) * step
    return np.round(numbers, 12) + 0.0  # no -0


def _draw(canvas: NDArray[np.uint8], points: NDArray[np.float64], colour: tuple[int, int, int],
          thickness: int, dashed: bool = False) -> None:
    """A polyline (n, 2) [px], cut at NaN and, if dashed, by its length."""
    known = np.asarray(np.isfinite(points).all(axis=1))
    along = np.r_[0, np.cumsum(np.nan_to_num(np.linalg.norm(np.diff(points, axis=0), axis=1)))]
    if dashed and known.any():  # finer steps, so that a dash may end between two points
        fine = np.arange(0, along[-1], 2.0)
        points = np.stack([np.interp(fine, along, points[:, k]) for k in (0, 1)], axis=1)
        known, along = np.asarray(np.isfinite(points).all(axis=1)), fine
    fixed = np.rint(np.where(known[:, None], points, 0) * 2 ** _FRACTION).astype(int).tolist()
    for k in range(len(points) - 1):
        if known[k] and known[k + 1] and not (dashed and along[k] % _DASH > 0.4 * _DASH):
            cv2.line(canvas, fixed[k], fixed[k + 1], colour, thickness, cv2.LINE_AA, _FRACTION)


def _legend(canvas: NDArray[np.uint8], lines: Sequence[Line], left: int) -> None:
    for k, each in enumerate(lines):
        y = _TOP + 10 + 18 * k
        _draw(canvas, np.array([[left, y - 4.0], [left + 34, y - 4]]),
              _COLOURS[each.colour % len(_COLOURS)], 2, each.dashed)
        _write(canvas, each.name, left + 42, y)


def _length(text: str) -> int:
    return int(cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)[0][0])


def _write(canvas: NDArray[np.uint8], text: str, x: int, y: int, centred: bool = False) -> None:
    origin = (x - _length(text) // 2 if centred else x, y)
    cv2.putText(canvas, text, origin, cv2.FONT_HERSHEY_SIMPLEX, 0.4, _BLACK, 1, cv2.LINE_AA)
