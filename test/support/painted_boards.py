"""Pictures of a printed board at a known pose, drawn by its homography."""

from xml.etree import ElementTree

import cv2
import numpy as np

from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing

_SIZE = 40  # px of a square before it is seen
_FINER = 4  # times as many pixels are drawn, and averaged, as those of the picture


def page(board, per_millimetre):
    """(height, width) uint8: what a printer makes of the board's SVG, without its writing."""
    drawn = ElementTree.fromstring(board.svg)
    width, height = (round(float(drawn.get(name).removesuffix('mm')) * per_millimetre)
                     for name in ('width', 'height'))
    picture = np.full((height, width), 255, np.uint8)
    for each in drawn:
        if each.tag.endswith('rect'):
            x, y, width, height = (float(each.get(name)) * per_millimetre
                                   for name in ('x', 'y', 'width', 'height'))
            light = 255 if each.get('fill') == 'white' else 0
            picture[round(y):round(y + height), round(x):round(x + width)] = light
    return picture


def on_page(board):
    """(3, 3) a point (x, y, 1) on the board's plane [m] to one on its page [m], y down."""
    if isinstance(board, CharucoRing):  # its frame is in the middle, y up; the margin a quarter
        middle = board.square * (np.array([board.columns, board.rows]) + 0.5) / 2
        return np.array([[1, 0, middle[0]], [0, -1, middle[1]], [0, 0, 1]])
    first = 2 * board.square  # a margin and a square
    return np.array([[1, 0, first], [0, 1, first], [0, 0, 1]])


def painted(picture, board, pose, pinhole):
    """A picture with the board, at a pose (4, 4) to the camera, before all else in it.

    picture: (height, width) or (height, width, 3) uint8.
    """
    per_metre = _SIZE / board.square
    flat = 40 + 180 / 255 * page(board, per_metre / 1e3)
    pixels = np.array([[per_metre, 0, -0.5], [0, per_metre, -0.5], [0, 0, 1]])
    drawn = pinhole.resized(_FINER * pinhole.width, _FINER * pinhole.height)
    size = pinhole.width, pinhole.height
    seen = drawn.matrix @ pose[:3, [0, 1, 3]] @ np.linalg.inv(pixels @ on_page(board))
    light, share = (cv2.resize(cv2.warpPerspective(
        each.astype(np.float32), seen, (drawn.width, drawn.height)), size,
        interpolation=cv2.INTER_AREA) for each in (flat, np.ones_like(flat)))
    if picture.ndim == 3:
        light, share = light[..., None], share[..., None]
    return np.rint(light + (1 - share) * picture).clip(0, 255).astype(np.uint8)


def picture_of_board(board, pose, pinhole):
    """(height, width) uint8: the board before grey."""
    return painted(np.full((pinhole.height, pinhole.width), 128, np.uint8), board, pose, pinhole)


def picture_of_sheet(board, pose, pinhole, height, unrolled=lambda places: places):
    """The same of a sheet that is bent: height gives z at places (n, 2) on the board [m].

    unrolled: where these places are while it is flat, as paper does not stretch.
    """
    per_metre = _SIZE / board.square
    drawn = pinhole.resized(2 * pinhole.width, 2 * pinhole.height)
    camera = np.linalg.inv(pose)[:3]
    pixels = np.stack(np.meshgrid(np.arange(drawn.width), np.arange(drawn.height)), axis=-1)
    rays = drawn.rays(pixels.reshape(-1, 2)) @ camera[:, :3].T
    low, high = board.points[:, :2].min(axis=0), board.points[:, :2].max(axis=0)
    z = np.zeros(len(rays))
    for _ in range(6):  # until the ray is at the height of the sheet below it
        places = camera[:2, 3] + rays[:, :2] * ((z - camera[2, 3]) / rays[:, 2])[:, None]
        z = height(places.clip(2 * low - high, 2 * high - low))
    places = unrolled(places)
    on = np.concatenate([places, np.ones((len(places), 1))], axis=1) @ on_page(board).T
    x, y = (per_metre * on[:, :2].T - 0.5).astype(np.float32).reshape(2, *pixels.shape[:2])
    flat = 40 + 180 / 255 * page(board, per_metre / 1e3).astype(np.float32)
    seen = cv2.remap(flat, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT,
                     borderValue=128)
    return np.rint(cv2.resize(seen, (pinhole.width, pinhole.height),
                              interpolation=cv2.INTER_AREA)).astype(np.uint8)
