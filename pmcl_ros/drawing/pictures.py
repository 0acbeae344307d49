"""Draws overlays and depth maps as (height, width, 3) uint8 RGB arrays."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.layers import Layers
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.outputs import write_file

if TYPE_CHECKING:  # they import trimesh and scipy, which who draws depth maps does not need
    from pmcl_ros.lightfield.posed_view import PosedView
    from pmcl_ros.pmcl.object_model import ObjectModel

_ZOOM = 3  # small pictures are drawn at this many times their size: lines stay fine on 328 px
_LARGE = 1600  # px: of the longer side; no picture is enlarged beyond
_FRACTION = 4  # bits of a pixel's fraction in OpenCV's drawing functions
_FARTHEST = 1e5  # px: points farther out are not drawn: OpenCV's integers cannot hold them
_CONTOUR = (0, 255, 0)
_COLOURS = ((0, 255, 0), (255, 140, 0), (0, 190, 255), (255, 60, 200), (255, 240, 0))
_AXES = ((255, 60, 60), (60, 200, 60), (80, 120, 255))  # x red, y green, z blue


def displayed(source: 'LightField | PosedView') -> NDArray[np.uint8]:
    """(height, width, 3) RGB for a screen: the centre view of a light field, or the picture."""
    return source.picture() if isinstance(source, LightField) else source.displayed()


def overlay(picture: NDArray[np.uint8], pinhole: Pinhole, model: 'ObjectModel',
            pose: NDArray[np.floating]) -> NDArray[np.uint8]:
    """The model's outline and axes at a pose (4, 4) on the centre view.

    picture: (height, width, 3) of the pinhole's size. A small one is drawn at up to three times
    its size.
    """
    zoom = _zoom(pinhole)
    canvas = _magnified(picture, zoom)
    _draw_outline(canvas, pinhole, model, pose, _CONTOUR, 1)
    arms = np.concatenate([np.zeros((1, 3)), 0.4 * model.radius * np.eye(3)])
    ends = _enlarged(pinhole.project(arms @ pose[:3, :3].T + pose[:3, 3]), zoom)
    if (np.abs(ends) < _FARTHEST).all():
        origin, *tips = np.rint(ends * 2 ** _FRACTION).astype(int).tolist()
        for tip, colour in zip(tips, _AXES, strict=True):
            cv2.arrowedLine(canvas, origin, tip, colour, 2, cv2.LINE_AA, _FRACTION)
    return canvas


def outlines(picture: NDArray[np.uint8], pinhole: Pinhole,
             things: Sequence[tuple['ObjectModel', NDArray[np.floating], str]]
             ) -> NDArray[np.uint8]:
    """Outlines of models at poses (4, 4), each in its colour and with a word; see `overlay`.

    A word stands at the object's origin; one behind the camera has none.
    """
    zoom = _zoom(pinhole)
    canvas = _magnified(picture, zoom)
    for number, (model, pose, word) in enumerate(things):
        _draw_outline(canvas, pinhole, model, pose, _COLOURS[number % len(_COLOURS)], 2)
        place = _enlarged(pinhole.project(pose[:3, 3]), zoom)
        if np.isfinite(place).all():
            x, y = place.clip(0, _FARTHEST).astype(int)
            _write(canvas, word, int(x), int(y))
    return canvas


def _zoom(pinhole: Pinhole) -> int:
    """How many times a picture is enlarged that is drawn on."""
    return min(max(_LARGE // max(pinhole.width, pinhole.height), 1), _ZOOM)


def _magnified(picture: NDArray[np.uint8], zoom: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.resize(picture, None, fx=zoom, fy=zoom,
                                 interpolation=cv2.INTER_CUBIC), np.uint8)


def _draw_outline(canvas: NDArray[np.uint8], pinhole: Pinhole, model: 'ObjectModel',
                  pose: NDArray[np.floating], colour: tuple[int, int, int], width: int) -> None:
    covered = silhouette(pinhole, model, pose, _zoom(pinhole)).astype(np.uint8)
    outline, _ = cv2.findContours(covered, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(canvas, outline, -1, colour, width, cv2.LINE_AA)


def contact_sheet(pictures: Sequence[NDArray[np.uint8]], width: int = 1920) -> NDArray[np.uint8]:
    """Pictures (height, width, 3) of one size in rows, reduced to `width` px together."""
    columns = math.ceil(math.sqrt(len(pictures)))
    height, across = pictures[0].shape[:2]
    scale = min(1.0, width / (columns * across))
    size = max(round(scale * across), 1), max(round(scale * height), 1)
    small = [cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in pictures]
    small += [np.zeros_like(small[0])] * (-len(small) % columns)
    return np.asarray(np.concatenate([
        np.concatenate(small[first:first + columns], axis=1)
        for first in range(0, len(small), columns)]), np.uint8)


def silhouette(pinhole: Pinhole, model: 'ObjectModel', pose: NDArray[np.floating],
               zoom: int = 1) -> NDArray[np.bool_]:
    """(zoom * height, zoom * width) the pixels that the model covers at a pose (4, 4).

    A face that reaches behind the camera is left out.
    """
    mask = np.zeros((zoom * pinhole.height, zoom * pinhole.width), np.uint8)
    pixels = _enlarged(pinhole.project(model.vertices @ pose[:3, :3].T + pose[:3, 3]), zoom)
    triangles = pixels[model.faces]
    triangles = triangles[(np.abs(triangles) < _FARTHEST).all(axis=(1, 2))]
    for triangle in np.rint(triangles * 2 ** _FRACTION).astype(np.int32):
        cv2.fillConvexPoly(mask, triangle, 1, cv2.LINE_8, _FRACTION)
    return mask.astype(bool)


def depth_picture(depth: NDArray[np.floating], near: float, far: float) -> NDArray[np.uint8]:
    """A depth map (height, width) [m] in colours, near warm, far cold, a scale below.

    Unknown depths (NaN) are black.
    """
    known = np.isfinite(depth)
    inverse = 1 / np.where(known, depth, far)
    picture = _colours((inverse - 1 / far) / (1 / near - 1 / far))
    picture[~known] = 0
    width = depth.shape[1]
    bar = np.repeat(_colours(np.linspace(0, 1, width)[None]), 14, axis=0)
    middle = 2 / (1 / near + 1 / far)
    for metres, x in ((far, 2), (middle, width // 2 - 22), (near, width - 48)):
        _write(bar, f'{metres:.2f} m', x, 11)
    return np.concatenate([picture, bar])


def layers_picture(layers: Layers, near: float, far: float) -> NDArray[np.uint8]:
    """Two depth pictures side by side: the front surface of each ray, and the next one behind it.

    Rays with one surface are black in the second.
    """
    halves = []
    for name, depth in (('front', layers.front), ('behind it', layers.behind)):
        half = depth_picture(depth, near, far)
        _write(half, name, 4, 14)
        halves.append(half)
    return np.concatenate(halves, axis=1)


def write_png(path: Path | str, picture: NDArray[np.uint8]) -> None:
    """Write a picture; OutputError when that is impossible."""
    _, data = cv2.imencode('.png', picture[..., ::-1])
    write_file(path, data.tobytes())


def _colours(part: NDArray[np.floating]) -> NDArray[np.uint8]:
    levels = np.rint(255 * np.clip(part, 0, 1)).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_TURBO)[..., ::-1], np.uint8).copy()


def _write(canvas: NDArray[np.uint8], text: str, x: int, y: int) -> None:
    """Black with a white rim, to be read on any colour."""
    rim = [(dx, dy, 255) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
    for dx, dy, grey in [*rim, (0, 0, 0)]:
        cv2.putText(canvas, text, (x + dx, y + dy), cv2.FONT_HERSHEY_SIMPLEX, 0.38, (grey,) * 3, 1,
                    cv2.LINE_AA)


def _enlarged(pixels: NDArray[np.floating], zoom: int) -> NDArray[np.float64]:
    """Where pixels (..., 2) lie in a picture enlarged `zoom` times (pixel centres at integers)."""
    return (np.asarray(pixels, float) + 0.5) * zoom - 0.5
