"""Image: pictures, depths, and the images of ordinary cameras."""

import logging
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.types import Buffer, CompressedImage, Image
from pmcl_ros.runtime.errors import MessageError, PictureError
from pmcl_ros.runtime.picture_file import decoded

_LOG = logging.getLogger(__name__)

# What this package publishes. encoding: type of one value, values per pixel
_ENCODINGS = {'bayer_bggr16': ('<u2', 1), 'rgb16': ('<u2', 3), 'rgba16': ('<u2', 4),
              'rgb8': ('u1', 3),
              '32FC1': ('<f4', 1), '32FC3': ('<f4', 3), '32FC4': ('<f4', 4),
              '32FC5': ('<f4', 5)}
# What other cameras publish. encoding: bits, channels, OpenCV's code to make it RGB (None: it is
# RGB). OpenCV's Bayer codes of four letters name the first pixels, as ROS does; those of two
# letters name the second.
_CAMERA_ENCODINGS: dict[str, tuple[int, int, int | None]] = {
    'rgb8': (8, 3, None), 'rgb16': (16, 3, None),
    'bgr8': (8, 3, cv2.COLOR_BGR2RGB), 'bgr16': (16, 3, cv2.COLOR_BGR2RGB),
    '8UC3': (8, 3, cv2.COLOR_BGR2RGB),
    'rgba8': (8, 4, cv2.COLOR_RGBA2RGB), 'bgra8': (8, 4, cv2.COLOR_BGRA2RGB),
    'mono8': (8, 1, cv2.COLOR_GRAY2RGB), 'mono16': (16, 1, cv2.COLOR_GRAY2RGB),
    '8UC1': (8, 1, cv2.COLOR_GRAY2RGB),
    'yuv422': (8, 2, cv2.COLOR_YUV2RGB_UYVY), 'uyvy': (8, 2, cv2.COLOR_YUV2RGB_UYVY),
    'yuv422_yuy2': (8, 2, cv2.COLOR_YUV2RGB_YUY2), 'yuyv': (8, 2, cv2.COLOR_YUV2RGB_YUY2),
    **{f'bayer_{pattern}{bits}': (bits, 1, code) for bits in (8, 16) for pattern, code in (
        ('rggb', cv2.COLOR_BayerRGGB2RGB), ('bggr', cv2.COLOR_BayerBGGR2RGB),
        ('gbrg', cv2.COLOR_BayerGBRG2RGB), ('grbg', cv2.COLOR_BayerGRBG2RGB))},
}


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
           buffer: Buffer | None) -> tuple[Image, NDArray[Any]]:
    """An Image of (height, width) pixels and the view through which its data are filled."""
    dtype, channels = _ENCODINGS[encoding]
    height, width = shape
    shape = (height, width, channels) if channels > 1 else (height, width)
    message, pixels = (buffer or Buffer()).message(Image, 'B', shape, dtype)
    message.header = header_to_message(header)
    message.height, message.width, message.encoding = height, width, encoding
    message.is_bigendian, message.step = 0, width * channels * np.dtype(dtype).itemsize
    return message, pixels


def pixels_of(message: Image, encoding: str, topic: str) -> NDArray[Any]:
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


def colours_from(message: Image) -> NDArray[Any]:
    """(height, width, 3) RGB, uint8 or uint16, of an image in one of the usual encodings.

    Its own memory. MessageError for other encodings, for a size that they cannot have, or when
    data are missing.
    """
    if message.encoding not in _CAMERA_ENCODINGS:
        raise MessageError(f'image: encoding {message.encoding!r} is none of '
                           f'{", ".join(_CAMERA_ENCODINGS)}; convert it with image_proc or '
                           'cv_bridge')
    bits, channels, code = _CAMERA_ENCODINGS[message.encoding]
    width, height, size = message.width, message.height, bits // 8
    needed = width * channels * size
    if not width or not height or message.step < needed or (
            len(message.data) < message.step * height):
        raise MessageError(f'image: {width}x{height} px of {message.encoding} in rows of '
                           f'{message.step} bytes with {len(message.data)} bytes of data; rows '
                           f'need {needed} bytes')
    values = message.step // (width * size)
    if message.step == values * width * size and channels < values <= 4:
        _tell_padding(message.step, width, message.encoding, values, channels)
    rows = np.frombuffer(message.data, np.uint8)[:message.step * height]
    rows = np.ascontiguousarray(rows.reshape(height, message.step)[:, :needed])
    kind = np.dtype(f'{">" if message.is_bigendian else "<"}u{size}')
    pixels = rows.view(kind).astype(kind.newbyteorder('='), copy=False)
    pixels = pixels.reshape((height, width, channels) if channels > 1 else (height, width))
    if code is None:
        return pixels.copy()
    if channels == 2 and width % 2:  # of YUV; OpenCV before 5 invents the last column
        raise MessageError(f'image: {width}x{height} px of {message.encoding}, where two pixels '
                           'share a colour: the width must be even')
    try:
        return np.asarray(cv2.cvtColor(pixels, code))
    except cv2.error as error:
        raise MessageError(f'image: {width}x{height} px of {message.encoding} cannot be '
                           f'converted to RGB: {error.err}') from None


@cache
def _tell_padding(step: int, width: int, encoding: str, values: int, channels: int) -> None:
    _LOG.warning('image: rows of %d bytes hold %d values for each of %d px, and %s has %d; they '
                 'are taken as padding: is it the encoding of the data?', step, values, width,
                 encoding, channels)


def decompressed_from(message: CompressedImage) -> NDArray[Any]:
    """(height, width, 3) RGB, uint8 or uint16, of a JPEG, PNG or the like.

    MessageError where it is none, and for a mosaic, which image_transport compresses as grey.
    """
    if message.format.startswith('bayer'):
        raise MessageError(f'compressed image: format {message.format!r} is a mosaic; compress '
                           'colour images (image_proc)')
    data = bytes(message.data)
    try:
        pixels = decoded(data, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    except PictureError as error:
        raise MessageError(f'compressed image: {len(data)} bytes of format {message.format!r}: '
                           f'{error}') from None
    if pixels.dtype not in (np.uint8, np.uint16):
        raise MessageError(f'compressed image: {pixels.dtype} values, expected 8 or 16 bits')
    return np.ascontiguousarray(pixels[..., ::-1])
