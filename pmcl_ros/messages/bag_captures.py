"""What a bag's first capture was: a RawFrame or a LightField, read without ROS."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, views_of_mosaic
from pmcl_ros.messages.bags import read
from pmcl_ros.runtime.errors import BagError

_TYPES = get_typestore(Stores.ROS2_JAZZY)
_RAW = ('/metadata', '/image_raw')
_VIEWS = ('/views/camera_info', '/views/pupil', '/views')
_PIXELS = {'bayer_bggr16': ('<u2', 1), 'rgb16': ('<u2', 3), '32FC3': ('<f4', 3)}


def is_bag(path: Path | str) -> bool:
    """Whether `path` is the folder of a bag."""
    path = Path(path)
    return path.is_dir() and (path / 'metadata.yaml').is_file() and any(path.glob('*.mcap*'))


def read_bag(bag: Path | str) -> RawFrame | LightField:
    """The first complete capture of a bag, as `pmcl bag record` writes.

    The raw picture where there is one, else the views.
    Raises BagError where there is neither, or a message is not what its topic promises.
    """
    messages: dict[str, Any] = {}
    for each in read(bag):
        if each.topic in (*_RAW, *_VIEWS):
            messages.setdefault(each.topic, _TYPES.deserialize_cdr(each.cdr, each.type))
        if all(topic in messages for topic in _RAW):
            return _raw_frame(*(messages[topic] for topic in _RAW))
    if all(topic in messages for topic in _VIEWS):
        return _light_field(*(messages[topic] for topic in _VIEWS))
    raise BagError(f'{bag} holds neither {" with ".join(reversed(_RAW))} nor '
                   f'{", ".join(_VIEWS)}: it takes the picture or its views')


def _raw_frame(text: Any, image: Any) -> RawFrame:
    return RawFrame(_header(image), _pixels(image, 'bayer_bggr16', '/image_raw'),
                    CameraMetadata.parse(text.data))


def _light_field(info: Any, pupil: Any, views: Any) -> LightField:
    pinhole = Pinhole(info.width, info.height, *(float(info.k[k]) for k in (0, 4, 2, 5)))
    light = _pixels(pupil, '32FC3', '/views/pupil')
    mosaic = _pixels(views, 'rgb16', '/views')
    (rows, columns), (height, width) = light.shape[:2], (pinhole.height, pinhole.width)
    if mosaic.shape[:2] != (rows * height, columns * width):
        raise BagError(f'/views is {mosaic.shape[1]}x{mosaic.shape[0]} pixels, expected '
                       f'{columns}x{rows} views of {width}x{height}')
    grid = ViewGrid(pinhole, -float(info.p[3] / info.k[0]), light[..., 1:].astype(float),
                    light[..., 0].copy())
    return LightField(_header(views), views_of_mosaic(mosaic, rows, columns), grid)


def _header(message: Any) -> Header:
    stamp = message.header.stamp
    return Header(stamp.sec * 10**9 + stamp.nanosec, message.header.frame_id)


def _pixels(message: Any, encoding: str, topic: str) -> NDArray[Any]:
    """(height, width[, channels]), its own memory."""
    dtype, channels = _PIXELS[encoding]
    shape = message.height, message.width, channels
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    if message.encoding != encoding or message.is_bigendian or len(message.data) != size:
        raise BagError(f'{topic}: {message.width}x{message.height} pixels of '
                       f'{message.encoding!r} in {len(message.data)} bytes; expected '
                       f'little-endian {encoding!r}')
    pixels = np.frombuffer(message.data, dtype).reshape(shape).copy()
    return pixels if channels > 1 else pixels[..., 0]
