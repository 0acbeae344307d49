"""Pictures of a checkerboard at a known pose, drawn by its homography."""

import cv2
import numpy as np

_SIZE = 40  # px of a square before it is seen
_FINER = 4  # times as many pixels are drawn, and averaged, as those of the picture


def painted(picture, board, pose, pinhole):
    """A picture with the board, at a pose (4, 4) to the camera, before all else in it.

    picture: (height, width) or (height, width, 3) uint8. A light corner square is beside the
    board's first corner.
    """
    rows, columns = board.rows + 1, board.columns + 1
    squares = np.kron((np.indices((rows, columns)).sum(axis=0) + 1) % 2, np.ones((_SIZE, _SIZE)))
    flat = np.pad(40 + 180 * squares, _SIZE, constant_values=255)
    # From its pixels to the plane of the board, whose origin is the first inner corner.
    scale, origin = board.square / _SIZE, 2 * _SIZE - 0.5
    onto = np.array([[scale, 0, -origin * scale], [0, scale, -origin * scale], [0, 0, 1]])
    drawn = pinhole.resized(_FINER * pinhole.width, _FINER * pinhole.height)
    size = pinhole.width, pinhole.height
    seen = drawn.matrix @ pose[:3, [0, 1, 3]] @ onto
    light, share = (cv2.resize(cv2.warpPerspective(
        each.astype(np.float32), seen, (drawn.width, drawn.height)), size,
        interpolation=cv2.INTER_AREA) for each in (flat, np.ones_like(flat)))
    if picture.ndim == 3:
        light, share = light[..., None], share[..., None]
    return np.rint(light + (1 - share) * picture).clip(0, 255).astype(np.uint8)


def picture_of_board(board, pose, pinhole):
    """(height, width) uint8: the board before grey."""
    return painted(np.full((pinhole.height, pinhole.width), 128, np.uint8), board, pose, pinhole)
