"""What poses of cameras seem to be, where these do not see the region of interest."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse

_BACKWARDS = np.diag([1.0, -1, -1, 1])
_ASK = ('are poses and region of the same frame, in metres, quaternions in the order x, y, z, w, '
        'and the poses from the camera (z forward) to that frame?')


def _in_metres(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """A pose in millimetres."""
    pose = pose.copy()
    pose[:3, 3] /= 1000
    return pose


_MISTAKES: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
    'are the poses from that frame to the camera? By their inverses': inverse,
    'do the cameras look along -z (OpenGL, Blender)? With other signs of the second and third '
    'column of their poses': lambda pose: pose @ _BACKWARDS,
    'are the poses in millimetres? In metres': _in_metres}


def sees(pinhole: Pinhole, camera: NDArray[np.float64], place: tuple[float, float, float]) -> bool:
    """Whether a place is in a camera's picture.

    camera: its pose (4, 4) in the frame of the place [m].
    """
    before = (np.array(place) - camera[:3, 3]) @ camera[:3, :3]
    if before[2] <= 0:
        return False
    pixel = pinhole.project(before[None])[0] + 0.5
    return bool((pixel >= 0).all() and (pixel < (pinhole.width, pinhole.height)).all())


def likely_mistake(cameras: Sequence[tuple[Pinhole, NDArray[np.float64]]],
                   place: tuple[float, float, float]) -> str:
    """A question for the usual mistake in poses without which all cameras see a place, or for all.

    cameras: each with its pose (4, 4) in the frame of the place [m].
    """
    for mistake, mended in _MISTAKES.items():
        if all(sees(pinhole, mended(camera), place) for pinhole, camera in cameras):
            return f'{mistake} all {len(cameras)} views see its middle'
    return _ASK
