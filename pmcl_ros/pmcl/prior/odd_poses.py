"""What poses of cameras seem to be, where these do not see the region of interest."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, pose_of
from pmcl_ros.runtime.errors import LocalizationError

_BACKWARDS = np.diag([1.0, -1, -1, 1])
# An optical frame (z forward) in the frame of a link whose x axis points forward, as in REP 103.
_OPTICAL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_ASK = ('are poses and region of the same frame, in metres, quaternions in the order x, y, z, w, '
        'and the poses from the camera (z forward) to that frame?')
_MOST = 0.8  # share of the views that see a place, of poses without a mistake
_LEAST = 4.0  # px: no object is found that is smaller in all views
_FAR = 10.0  # m: no camera on a robot is as far from its frame; in millimetres most are


def _in_metres(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """A pose in millimetres; in metres already where it is near."""
    if np.linalg.norm(pose[:3, 3]) <= _FAR:
        return pose
    pose = pose.copy()
    pose[:3, 3] /= 1000
    return pose


def _transposed(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """A pose with its rotation transposed."""
    pose = pose.copy()
    pose[:3, :3] = pose[:3, :3].T
    return pose


def _reordered(*order: int) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """What takes the quaternion x, y, z, w of a pose in another order."""
    def mended(pose: NDArray[np.float64]) -> NDArray[np.float64]:
        quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat()[list(order)]
        return pose_of(Rotation.from_quat(quaternion), pose[:3, 3])
    return mended


_MISTAKES: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
    'are the poses from that frame to the camera? By their inverses': inverse,
    'do the cameras look along -z (OpenGL, Blender)? With other signs of the second and third '
    'column of their poses': lambda pose: pose @ _BACKWARDS,
    'are they poses of a link with x forward (camera_link), not of the optical frame? With the '
    'latter': lambda pose: pose @ _OPTICAL,
    'are the poses in millimetres? In metres': _in_metres,
    'are the rotations transposed? By their transposes': _transposed,
    'are quaternions w, x, y, z taken for x, y, z, w? By the former': _reordered(1, 2, 3, 0),
    'are quaternions x, y, z, w taken for w, x, y, z? By the former': _reordered(3, 0, 1, 2)}


def sees(pinhole: Pinhole, camera: NDArray[np.float64], place: tuple[float, float, float]) -> bool:
    """Whether a place is in a camera's picture.

    camera: its pose (4, 4) in the frame of the place [m].
    """
    before = (np.array(place) - camera[:3, 3]) @ camera[:3, :3]
    pixel = pinhole.project(before) + 0.5  # NaN behind the camera
    return bool((pixel >= 0).all() and (pixel < (pinhole.width, pinhole.height)).all())


def likely_mistake(cameras: Sequence[tuple[Pinhole, NDArray[np.float64]]],
                   place: tuple[float, float, float]) -> str:
    """A question for the mistake without which most views see a place, or for all mistakes.

    cameras: each with its pose (4, 4) in the frame of the place [m].
    """
    return _mistake(cameras, place) or (
        "is the region in a camera's frame? There it is in view; it must be in that of the poses"
        if not any(sees(*each, place) for each in cameras)
        and all(sees(pinhole, np.eye(4), place) for pinhole, _ in cameras) else _ASK)


def check_poses(cameras: Sequence[tuple[Pinhole, NDArray[np.float64]]],
                place: tuple[float, float, float], seen: int) -> None:
    """Raise LocalizationError where a mistake explains that most views do not see a region.

    What the others show there is not the object. cameras: as of `likely_mistake`. place: the
    region's middle. seen: number of views that see any of it.
    """
    if seen < len(cameras) / 2 and (mistake := _mistake(cameras, place)):
        raise LocalizationError(
            f'{seen} of {len(cameras)} views see the region of interest: {mistake}; mend the '
            'poses, or leave out the views that do not see it')


def check_size(size: float) -> None:
    """Raise LocalizationError where an object is too small in all views, as in millimetres.

    Cameras that look at the origin see it, wherever they are on that ray. size: of the object in
    the middle of the region, in the view that it is largest in [px].
    """
    if size < _LEAST:
        raise LocalizationError(f'the object in the region of interest is {size:.2g} px large in '
                                'the nearest view: are the poses in millimetres, or is the mesh '
                                'in another unit? All must be in metres')


def without_mistakes(cameras: Sequence[tuple[Pinhole, NDArray[np.float64]]]
                     ) -> Iterator[tuple[str, list[tuple[Pinhole, NDArray[np.float64]]]]]:
    """The cameras without each mistake that poses may have, after the question for it."""
    for mistake, mended in _MISTAKES.items():
        yield mistake, [(pinhole, mended(camera)) for pinhole, camera in cameras]


def _mistake(cameras: Sequence[tuple[Pinhole, NDArray[np.float64]]],
             place: tuple[float, float, float]) -> str:
    """A question for the mistake that explains best what the views do not see; empty for none.

    For several that explain it alike.
    """
    counts = {mistake: sum(sees(*each, place) for each in mended)
              for mistake, mended in without_mistakes(cameras)}
    most, given = max(counts.values()), sum(sees(*each, place) for each in cameras)
    if most < _MOST * len(cameras) or most <= given:
        return ''
    share = 'all' if most == len(cameras) else f'{most} of'
    return '; or '.join(f'{mistake} {share} {len(cameras)} views see its middle'
                        for mistake, count in counts.items() if count == most)
