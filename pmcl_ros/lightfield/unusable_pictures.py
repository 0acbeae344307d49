"""PosedViews -> which of the pictures are unusable, and why.

Only what is clear without knowing the scene: white or black where the object can be, blurred
beside the others, the same as another one. Brightness does not matter otherwise, and whether all
pictures are blurred cannot be told from what they show.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.posed_view import PosedView

Part = tuple[int, int, int, int]  # left, top, width, height [px]
_WHITE = 0.99  # a pixel that is clipped; two of 255 are left for compression
_CLIPPED = 0.5  # share of such pixels that is no highlight
_BLACK = 0.1  # of 99 % of the pixels: light of 0.6 %, in 25 steps of 8 bits
_DIRECTIONS = (1, 0), (1, 1), (0, 1), (-1, 1)  # a camera that moves blurs along one of them
_FINE, _COARSE, _SMOOTH = 2.0, 8.0, 2.0  # px: distances of differences; sigma of the coarse ones
_BLURRED = 0.6  # of the fine detail that all others have; unblurred views have more than 0.7
_FARTHER = 1.25  # times as far away another camera may be
_LEAST = 1000  # px that tell anything
_SMALL = 320  # px: the longer side of pictures that are compared with each other
_AROUND, _CONTRAST = 3.0, 0.01  # px, and of white: by which a pixel differs from those around it
_SAME = 0.9  # share of pixels that differ the same way, and of cells; of other pictures half
_CELLS, _TOLD = (8, 6), 0.02  # of a picture; share of pixels of a cell that differ at all
_MOVED = 10.0  # px by which pictures of a camera that is elsewhere are clearly not the same


def unusable_pictures(views: Sequence[PosedView], parts: Mapping[int, Part],
                      place: NDArray[np.float64]) -> list[str]:
    """What is wrong with pictures, and what to do: a part of a sentence each.

    parts: that can show the object, by the numbers of the views. place: (3,) where it is about, in
    the reference frame [m].
    """
    exposed = _badly_exposed(views, parts)
    rest = {number: each for number, each in _uncovered(views).items() if number not in exposed}
    return [*exposed.values(), *_blurred(rest, place), *_same(rest, place)]


def blurred_pictures(views: Sequence[PosedView], place: NDArray[np.float64]) -> list[str]:
    """Which pictures are blurred beside the others, as of `unusable_pictures`."""
    return _blurred(_uncovered(views), place)


def _uncovered(views: Sequence[PosedView]) -> dict[int, PosedView]:
    return {number: each for number, each in enumerate(views) if not _is_covered(each)}


def _is_covered(view: PosedView) -> bool:
    """Whether another line tells of it: it is of one colour."""
    return view.is_of_one_colour(0, 0, view.pinhole.width, view.pinhole.height)


def _badly_exposed(views: Sequence[PosedView], parts: Mapping[int, Part]) -> dict[int, str]:
    found = {}
    for number, (left, top, width, height) in parts.items():
        view, rows, columns = views[number], slice(top, top + height), slice(left, left + width)
        pixels = view.picture[rows, columns].reshape(-1, 3)
        if view.mask is not None:
            pixels = pixels[view.mask[rows, columns].ravel()]
        if len(pixels) < _LEAST:
            continue
        white = float((pixels.min(axis=1) >= _WHITE).mean())
        light = float(np.percentile(pixels.max(axis=1), 99))
        name = 'the picture' if len(views) == 1 else _name(number, view)
        which = f'of the pixels of {name} that can show the object are'
        if white > _CLIPPED:
            found[number] = f'{100 * white:.0f} % {which} white: expose it less'
        elif light < _BLACK:
            found[number] = f'99 % {which} below {100 * light:.0f} % of white: expose it more'
    return found


def _blurred(views: Mapping[int, PosedView], place: NDArray[np.float64]) -> list[str]:
    details = {number: _details(each) for number, each in views.items()}
    away = {number: float(np.linalg.norm(each.camera_to_reference[:3, 3] - place))
            for number, each in views.items()}
    found = []
    for number, view in views.items():
        # Another lens may be softer, and from nearer the same looks so.
        others = [details[other] for other, each in views.items()
                  if other != number and each.pinhole == view.pinhole
                  and away[other] <= _FARTHER * away[number]]
        if len(others) < 2:
            continue
        share = float((details[number] / np.min(others, axis=0)).max(axis=0).min())
        if share < _BLURRED:  # not where it is NaN
            found.append(f'{_name(number, view)} is blurred: along one direction it has '
                         f'{100 * share:.0f} % of the fine detail that all others have; was the '
                         'camera at rest, and in focus?')
    return found


def _details(view: PosedView) -> NDArray[np.float64]:
    """(2, 4) rms of fine second differences, over that of coarse ones and itself, by direction.

    In the first a picture's contrast cancels; what a picture shows besides coarsely changes it.
    """
    grey = view.picture.mean(axis=2)
    smooth = cv2.GaussianBlur(grey, (0, 0), _SMOOTH)
    fine, coarse = (np.array([_curvature(of, view.mask, each, distance) for each in _DIRECTIONS])
                    for of, distance in ((grey, _FINE), (smooth, _COARSE)))
    fine[fine == 0] = coarse[coarse == 0] = np.nan  # it is of one colour
    return np.stack([fine / coarse, fine])


def _curvature(grey: NDArray[np.float32], mask: NDArray[np.bool_] | None,
               direction: tuple[int, int], distance: float) -> float:
    """Rms of second differences of a picture along a direction; NaN where little counts."""
    x, y = (round(distance / np.hypot(*direction)) * each for each in direction)
    border = max(abs(x), abs(y))

    def along(values: NDArray[Any]) -> list[NDArray[Any]]:
        height, width = values.shape
        return [values[border + dy:height - border + dy, border + dx:width - border + dx]
                for dx, dy in ((0, 0), (x, y), (-x, -y))]

    middle, one, other = along(grey)
    squares = np.square(one + other - 2 * middle)
    if mask is not None:
        squares = squares[np.all(along(mask), axis=0)]
    return float(np.sqrt(squares.mean())) if squares.size >= _LEAST else np.nan


def _same(views: Mapping[int, PosedView], place: NDArray[np.float64]) -> list[str]:
    signs = {number: _signs(each) for number, each in views.items()}
    found = []
    for one, other in combinations(views, 2):
        if signs[one].shape != signs[other].shape or not _apart(views[one], views[other], place):
            continue
        if _agree(signs[one] * signs[other]):
            found.append(f'{_name(one, views[one])} and {_name(other, views[other])} show the '
                         'same, though their cameras are apart: did the camera repeat a picture, '
                         'or was a file copied?')
    return found


def _agree(both: NDArray[np.int8]) -> bool:
    """Whether pixels (rows, columns) agree (1) and do not differ (-1); 0: they tell nothing.

    All over the picture: a gripper is at the same place in all pictures.
    """
    told, agree = (cv2.resize(each.astype(np.float32), _CELLS, interpolation=cv2.INTER_AREA)
                   for each in (both != 0, both > 0))
    tell = told > _TOLD
    return bool(tell.mean() > 0.5 and (agree[tell] > _SAME * told[tell]).mean() > _SAME)


def _signs(view: PosedView) -> NDArray[np.int8]:
    """(rows, columns) of a smaller picture: whether pixels are brighter (1) or darker (-1) than
    those around them; 0 where they hardly differ, or its mask is False.
    """
    share = min(_SMALL / max(view.picture.shape), 1.0)
    size = round(share * view.pinhole.width), round(share * view.pinhole.height)
    grey = cv2.resize(view.picture.mean(axis=2), size, interpolation=cv2.INTER_AREA)
    above = grey - cv2.GaussianBlur(grey, (0, 0), _AROUND)
    signs = np.sign(above) * (np.abs(above) > _CONTRAST)
    if view.mask is not None:
        signs *= cv2.resize(view.mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    return signs.astype(np.int8)


def _apart(one: PosedView, other: PosedView, place: NDArray[np.float64]) -> bool:
    """Whether the corners of a picture, as far away as a place, are elsewhere in another one."""
    pinhole, camera = one.pinhole, one.camera_to_reference
    right, bottom = pinhole.width - 1, pinhole.height - 1
    corners = np.array([[0, 0], [right, 0], [0, bottom], [right, bottom]])
    away = np.linalg.norm(place - camera[:3, 3])
    seen = away * pinhole.rays(corners) @ camera[:3, :3].T + camera[:3, 3]
    into = np.linalg.inv(other.camera_to_reference)
    pixels = other.pinhole.project(seen @ into[:3, :3].T + into[:3, 3])
    return not np.linalg.norm(pixels - corners, axis=1).mean() <= _MOVED  # NaN: behind it


def _name(number: int, view: PosedView) -> str:
    return f'view {number}' + (f' ({view.name})' if view.name else '')
