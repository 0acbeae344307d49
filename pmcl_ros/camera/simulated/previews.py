"""Small pictures of a raw one, as the camera makes for its own screen."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.packing import unpack12

_BLACK, _WHITE = 168, 4095  # counts


def jpeg(raw: bytes, width: int, height: int, side: int = 328) -> bytes:
    """A JPEG of `side` x `side` pixels; raw: packed counts, BGGR."""
    _, data = cv2.imencode('.jpg', _bgr(raw, width, height, side))
    return data.tobytes()


def thumbnail(raw: bytes, width: int, height: int, side: int = 128) -> bytes:
    """`side` x `side` pixels, two in four bytes: Y0 U Y1 V (YUY2)."""
    luma, red, blue = np.moveaxis(
        cv2.cvtColor(_bgr(raw, width, height, side), cv2.COLOR_BGR2YCrCb), 2, 0)
    packed = np.empty((side, side // 2, 4), np.uint8)
    packed[..., 0], packed[..., 2] = luma[:, ::2], luma[:, 1::2]
    packed[..., 1], packed[..., 3] = blue[:, ::2], red[:, ::2]
    return packed.tobytes()


def _bgr(raw: bytes, width: int, height: int, side: int) -> NDArray[np.uint8]:
    """(side, side, 3) uint8; a pixel of each 2x2 tile, averaged, with a gamma of 1/2.2."""
    counts = unpack12(raw, width, height)
    blue, green, red = counts[0::2, 0::2], counts[0::2, 1::2], counts[1::2, 1::2]
    linear = np.stack([cv2.resize(each.astype(np.float32), (side, side),
                                  interpolation=cv2.INTER_AREA) for each in (blue, green, red)],
                      axis=2)
    light = np.clip((linear - _BLACK) / (_WHITE - _BLACK), 0, 1)
    return np.round(255 * light ** (1 / 2.2)).astype(np.uint8)
