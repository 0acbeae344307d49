"""Images of ordinary cameras as arrays: what drivers and image_proc publish."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.sweep.frame import Lens
from pmcl_ros.runtime.errors import MessageError, PmclError

# encoding: bits, channels, how OpenCV makes it RGB (None: it is). Its Bayer codes of four letters
# are named by the first pixels, as in ROS; those of two by the second.
_ENCODINGS: dict[str, tuple[int, int, int | None]] = {
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


def colours_from(message: Image) -> NDArray[Any]:
    """(height, width, 3) RGB, uint8 or uint16, of an image in one of the usual encodings.

    Its own memory. MessageError for other encodings, or when data are missing.
    """
    if message.encoding not in _ENCODINGS:
        raise MessageError(f'image: encoding {message.encoding!r} is none of '
                           f'{", ".join(_ENCODINGS)}; convert it with image_proc or cv_bridge')
    bits, channels, code = _ENCODINGS[message.encoding]
    width, height, size = message.width, message.height, bits // 8
    needed = width * channels * size
    if not width or not height or message.step < needed or (
            len(message.data) < message.step * height):
        raise MessageError(f'image: {width}x{height} px of {message.encoding} in rows of '
                           f'{message.step} bytes with {len(message.data)} bytes of data; rows '
                           f'need {needed} bytes')
    rows = np.frombuffer(message.data, np.uint8)[:message.step * height]
    rows = np.ascontiguousarray(rows.reshape(height, message.step)[:, :needed])
    kind = np.dtype(f'{">" if message.is_bigendian else "<"}u{size}')
    pixels = rows.view(kind).astype(kind.newbyteorder('='), copy=False)
    pixels = pixels.reshape((height, width, channels) if channels > 1 else (height, width))
    return pixels.copy() if code is None else np.asarray(cv2.cvtColor(pixels, code))


def lens_from(message: CameraInfo, rectified: bool) -> Lens:
    """The camera that a camera_info tells; rectified: that of its image_rect.

    MessageError when the camera is not calibrated, or its pictures are cut or binned.
    """
    roi = message.roi
    cut = roi.x_offset or roi.y_offset or (
        roi.width and (roi.width, roi.height) != (message.width, message.height))
    if message.binning_x > 1 or message.binning_y > 1 or cut:
        raise MessageError('camera_info: binning or a region of interest is set; let the camera '
                           'send whole images')
    numbers = np.reshape(message.p, (3, 4))[:, :3] if rectified else np.reshape(message.k, (3, 3))
    if not numbers[0, 0] > 0:
        raise MessageError('camera_info: the focal length is 0: calibrate the camera '
                           '(camera_calibration)')
    fx, fy, cx, cy = (float(each) for each in numbers[[0, 1, 0, 1], [0, 1, 2, 2]])
    coefficients = () if rectified else tuple(float(each) for each in message.d)
    try:
        pinhole = Pinhole(message.width, message.height, fx, fy, cx, cy)
        if not any(coefficients):
            return Lens(pinhole)
        return Lens(pinhole, coefficients, message.distortion_model)
    except PmclError as error:
        raise MessageError(f'camera_info: {error}') from None
