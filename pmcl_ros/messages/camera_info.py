"""CameraInfo: rectified pinholes, and the lenses of ordinary cameras."""

from array import array

import numpy as np

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.sweep.frame import Lens, warn_distorted
from pmcl_ros.messages.header import header_to_message, promised_by
from pmcl_ros.messages.types import CameraInfo, RegionOfInterest
from pmcl_ros.runtime.errors import MessageError


def pinhole_to_message(header: Header, pinhole: Pinhole, baseline: float = 0) -> CameraInfo:
    """A rectified pinhole; a baseline B [m] as for stereo: P[3] = -fx B and P[7] = -fy B."""
    p = np.zeros((3, 4))
    p[:, :3] = pinhole.matrix
    p[:2, 3] = -pinhole.fx * baseline, -pinhole.fy * baseline
    return CameraInfo(header=header_to_message(header), height=pinhole.height, width=pinhole.width,
                      distortion_model='plumb_bob', d=array('d', bytes(40)),
                      k=pinhole.matrix.ravel(), r=np.eye(3).ravel(), p=p.ravel(),
                      binning_x=0, binning_y=0,
                      roi=RegionOfInterest(x_offset=0, y_offset=0, height=0, width=0,
                                           do_rectify=False))


def pinhole_from(message: CameraInfo) -> Pinhole:
    """The pinhole of a rectified camera; distortion or skew are refused."""
    k, p = np.reshape(message.k, (3, 3)), np.reshape(message.p, (3, 4))
    fx, fy, cx, cy = (float(each) for each in (k[0, 0], k[1, 1], k[0, 2], k[1, 2]))
    with promised_by('camera_info'):
        pinhole = Pinhole(message.width, message.height, fx, fy, cx, cy)
    if not np.array_equal(k, pinhole.matrix) or not np.array_equal(p[:, :3], k) or any(message.d):
        raise MessageError(f'camera_info: K {k.tolist()}, P {p.tolist()}, D {list(message.d)} are '
                           'not of a rectified pinhole: no skew, no distortion, P begins with K')
    return pinhole


def baseline_from(message: CameraInfo) -> float:
    """Metres between adjacent views, from P[3] = -fx B and P[7] = -fy B, which must agree."""
    across, down = -message.p[3] / message.k[0], -message.p[7] / message.k[4]
    if not np.isclose(across, down, rtol=1e-6):
        raise MessageError(f'views/camera_info: P[3] and P[7] say baselines of {across} m and '
                           f'{down} m; expected -fx B and -fy B of one B')
    return float(across)


def lens_from(message: CameraInfo, rectified: bool) -> Lens:
    """The lens that a camera_info describes; rectified: that of its image_rect.

    A warning, once, as of `warn_distorted`, names the camera by its frame. MessageError when the
    camera is not calibrated, or its pictures are cut or binned.
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
    coefficients = () if rectified else tuple(float(each) for each in message.d)
    with promised_by('camera_info'):
        lens = Lens.from_matrix(message.width, message.height, numbers, coefficients,
                                message.distortion_model)
    if lens.distortion:
        warn_distorted(message.header.frame_id, lens)
    return lens
