"""A rectified pinhole as CameraInfo."""

from array import array

import numpy as np
from sensor_msgs.msg import CameraInfo

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.messages.header import header_to_message, promised_by
from pmcl_ros.runtime.errors import MessageError


def pinhole_to_message(header: Header, pinhole: Pinhole, baseline: float = 0) -> CameraInfo:
    """A rectified pinhole; a baseline [m] is told as in stereo: P[3] = -fx B and P[7] = -fy B."""
    p = np.zeros((3, 4))
    p[:, :3] = pinhole.matrix
    p[:2, 3] = -pinhole.fx * baseline, -pinhole.fy * baseline
    return CameraInfo(header=header_to_message(header), height=pinhole.height, width=pinhole.width,
                      distortion_model='plumb_bob', d=array('d', bytes(40)),
                      k=pinhole.matrix.ravel(), r=np.eye(3).ravel(), p=p.ravel())


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
    if not (across > 0 and np.isclose(across, down, rtol=1e-6)):
        raise MessageError(f'views/camera_info: P[3] and P[7] say baselines of {across} m and '
                           f'{down} m; expected -fx B and -fy B of one positive B')
    return float(across)
