"""Pictures and depths as images."""

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.buffer import Buffer
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.runtime.errors import MessageError

# encoding: type of one value, values per pixel
_ENCODINGS = {'bayer_bggr16': ('<u2', 1), 'rgb16': ('<u2', 3), 'rgb8': ('u1', 3),
              '32FC1': ('<f4', 1), '32FC3': ('<f4', 3)}


def picture_to_message(header: Header, picture: NDArray[np.uint8],
                       buffer: Buffer | None = None) -> Image:
    """A picture to look at: (height, width, 3) uint8 RGB as rgb8."""
    message, pixels = image_message(header, 'rgb8', picture.shape[:2], buffer)
    pixels[:] = picture
    return message


def picture_from(message: Image) -> NDArray[np.uint8]:
    """(height, width, 3) uint8 of an rgb8 image."""
    return pixels_of(message, 'rgb8', 'picture')


def depth_to_message(volume: DepthLikelihoodVolume, buffer: Buffer | None = None) -> Image:
    """The most likely depth as 32FC1 [m]; NaN where no label is better than another (REP-118)."""
    depth = volume.depth_map()
    message, pixels = image_message(volume.header, '32FC1', depth.shape, buffer)
    pixels[:] = depth
    return message


def depth_from(message: Image) -> NDArray[np.float32]:
    """(height, width) float32 [m] of a 32FC1 image; NaN: unknown."""
    return pixels_of(message, '32FC1', 'depth')


def image_message(header: Header, encoding: str, shape: tuple[int, ...],
           buffer: Buffer | None) -> tuple[Image, NDArray]:
    """An Image of (height, width) pixels and the view through which its data are filled."""
    dtype, channels = _ENCODINGS[encoding]
    height, width = shape
    shape = (height, width, channels) if channels > 1 else (height, width)
    message, pixels = (buffer or Buffer()).message(Image, 'B', shape, dtype)
    message.header = header_to_message(header)
    message.height, message.width, message.encoding = height, width, encoding
    message.is_bigendian, message.step = 0, width * channels * np.dtype(dtype).itemsize
    return message, pixels


def pixels_of(message: Image, encoding: str, topic: str) -> NDArray:
    """The data of an Image as (height, width[, channels]), not copied."""
    dtype, channels = _ENCODINGS[encoding]
    height, width = message.height, message.width
    step = width * channels * np.dtype(dtype).itemsize
    if message.encoding != encoding:
        raise MessageError(f'{topic}: encoding is {message.encoding!r}, expected {encoding!r}')
    if message.is_bigendian:
        raise MessageError(f'{topic}: is_bigendian is {message.is_bigendian}, expected 0')
    if not height or not width or message.step != step or len(message.data) != step * height:
        raise MessageError(
            f'{topic}: {width}x{height} pixels in rows of {message.step} bytes with '
            f'{len(message.data)} bytes of data; {encoding} needs rows of {step} bytes and '
            f'{step * height} bytes, and at least one pixel')
    shape = (height, width, channels) if channels > 1 else (height, width)
    return np.frombuffer(message.data, dtype).reshape(shape)
