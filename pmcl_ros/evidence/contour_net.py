"""Computes the contour map of a picture by the learned network, with OpenCV's dnn.

The map tells for each pixel and each direction how much more likely than anywhere an occluding
contour passes there with its outward normal in that direction, and the same of the inside of
solids. `pmcl learn-map` trains and calibrates the network (docs/concepts/evidence.md).
"""

import hashlib
import logging
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from threading import Lock

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.learned import Calibration, LearnedMap, learned_file, learned_map
from pmcl_ros.lightfield.posed_view import LEAST_SIDE
from pmcl_ros.runtime.errors import PictureError, SettingsError

CHANNELS = 6  # a0, c1, s1, c2, s2 of the contour, and the inside
MOST_PIXELS = 2 ** 20  # a larger picture is reduced: the network takes 0.2 s for as many
_MOST_SIDE = 8192  # px
_STEP = 16  # px: the network halves its input four times

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class ContourNet:
    """A network and its calibration. Calls from several threads wait for each other.

    path: the ONNX file. SettingsError when it cannot be read, or is not that of `learned`.
    """

    path: Path
    learned: LearnedMap
    _net: cv2.dnn.Net = field(init=False, repr=False, compare=False)
    _lock: Lock = field(default_factory=Lock, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        try:
            data = self.path.read_bytes()
        except OSError as error:
            raise SettingsError(
                f'cannot read {self.path}: {error.strerror or error}') from None
        found = hashlib.sha256(data).hexdigest()
        if found != self.learned.sha256:
            raise SettingsError(f'{self.path} has the sha256 {found[:12]}..., its YAML file says '
                                f'{self.learned.sha256[:12]}...: they do not belong together')
        object.__setattr__(self, '_net', read_network(data))
        _LOG.info('contour map: network %s of %s', self.learned.version, self.path)

    def __call__(self, picture: NDArray[np.generic]) -> NDArray[np.float32]:
        """(H, W, 6) float32 log odds ratios [nat]: what the picture says beside the base rates.

        picture: (H, W, 3) RGB or (H, W) grey, gamma encoded, uint8 or float of 0 to 1. The first
        five channels a0, c1, s1, c2, s2 give the ratio of a contour whose outward normal is within
        22.5 degrees of t, atan2(y, x) with y down: a0 + c1 cos t + s1 sin t + c2 cos 2t + s2 sin
        2t. The last channel is the inside's. A picture of more than `MOST_PIXELS` is reduced, and
        its map enlarged. PictureError when the picture cannot be used.
        """
        scales, offsets = factors(self.learned.contour, self.learned.inside)
        found = self.logits(picture)
        found *= scales
        found += offsets
        return found

    def logits(self, picture: NDArray[np.generic]) -> NDArray[np.float32]:
        """(H, W, 6) what the network says of a picture, before calibration."""
        with self._lock:
            return logits(self._net, picture)


@cache
def contour_net() -> ContourNet:
    """The network that the package ships; SettingsError names the file that is missing."""
    return ContourNet(learned_file('contour_map.onnx'), learned_map())


def read_network(data: bytes) -> cv2.dnn.Net:
    """A network from the bytes of an ONNX file; SettingsError when they are none."""
    try:
        return cv2.dnn.readNetFromONNX(np.frombuffer(data, np.uint8))
    except cv2.error as error:
        raise SettingsError(f'OpenCV {cv2.__version__} cannot read the network of the contour '
                            f'map: {error.err}') from None


def factors(contour: Calibration, inside: Calibration
            ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(scales, offsets) of the six channels, from logits to log odds ratios."""
    scales = np.array([contour.scale] * (CHANNELS - 1) + [inside.scale], np.float32)
    offsets = np.zeros(CHANNELS, np.float32)
    offsets[[0, -1]] = contour.offset, inside.offset
    return scales, offsets


def logits(net: cv2.dnn.Net, picture: NDArray[np.generic]) -> NDArray[np.float32]:
    """(H, W, 6) what the network says of a picture, see `ContourNet`."""
    encoded = network_input(picture)
    height, width = encoded.shape[:2]
    read = reduced(encoded)
    rows, columns = read.shape[:2]
    padded = cv2.copyMakeBorder(read, 0, -rows % _STEP, 0, -columns % _STEP,
                                cv2.BORDER_REPLICATE)
    net.setInput(cv2.dnn.blobFromImage(padded))
    out = np.moveaxis(net.forward()[0, :, :rows, :columns], 0, -1)
    if (rows, columns) != (height, width):
        out = cv2.resize(np.ascontiguousarray(out), (width, height))
    return np.ascontiguousarray(out)


def reduced(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """A picture (H, W, 3) of at most about `MOST_PIXELS`, by means of its pixels."""
    height, width = picture.shape[:2]
    factor = np.sqrt(MOST_PIXELS / (height * width))
    if factor >= 1:
        return picture
    size = max(round(factor * width), 1), max(round(factor * height), 1)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.float32)


def network_input(picture: NDArray[np.generic]) -> NDArray[np.float32]:
    """(H, W, 3) encoded values of -0.5 to 0.5, of a picture as `ContourNet` takes it.

    Raises PictureError.
    """
    shape = picture.shape
    if picture.ndim == 2:
        picture = np.repeat(picture[..., None], 3, axis=-1)
    if picture.ndim != 3 or picture.shape[-1] != 3:
        raise PictureError(f'a picture must be (height, width, 3) or (height, width), it is '
                           f'{shape}')
    if min(shape[:2]) < LEAST_SIDE or max(shape[:2]) > _MOST_SIDE:
        raise PictureError(f'a picture must have {LEAST_SIDE} to {_MOST_SIDE} px a side, it has '
                           f'{shape[1]}x{shape[0]}')
    if picture.dtype == np.uint8:
        return picture.astype(np.float32) / np.float32(255) - np.float32(0.5)
    if not np.issubdtype(picture.dtype, np.floating):
        raise PictureError(f'a picture must be uint8, or float of 0 to 1; it is {picture.dtype}')
    least, most = float(picture.min()), float(picture.max())
    if not (least >= 0 and most <= 1):  # also of NaN
        raise PictureError(f"a picture's values must be 0 to 1, they are {least:g} to {most:g}")
    return picture.astype(np.float32) - np.float32(0.5)
