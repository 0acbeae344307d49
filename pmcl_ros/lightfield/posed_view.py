"""Pictures of ordinary cameras, and the cameras' poses in a reference frame."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.errors import LightFieldError

GAMMA = 2.2  # linear light is a picture's value to the power of this
LEAST_SIDE = 32  # px: a smaller picture shows no contour in its surroundings
_LEVEL = 0.3  # mean linear light of an exposed picture, 1 at white
_FAR = 1e8  # m: coordinates of a map have some millions
_SQUARE, _ONE_COLOUR = 8, 0.02  # px; range of means of squares that is noise, or a vignette
_RIGID = 1e-3  # tolerance of orthogonality: poses in files are rounded


@dataclass(frozen=True)
class PosedView:
    """A picture without distortion, taken from a known pose.

    header: stamp of the shutter; frame_id is the reference frame.
    picture: (height, width, 3) float32 RGB, gamma encoded (`GAMMA`), 0 to 1, at the full depth of
        its file; a grey camera has three equal channels. It is kept encoded, as cameras give it:
        the learned contour map reads encoded values, and dark and bright pixels are then about
        equally noisy. `linear` gives the light.
    camera_to_reference: (4, 4) pose of the camera's optical frame (x right, y down, z forward) in
        the reference frame [m].
    sigma: standard deviations of that pose on each axis: position [m], rotation [rad].
    group: name of the views that share errors of their poses, as of one hand-eye transform; empty:
        this view alone. common: share of the variance of these errors that the group shares; the
        rest is of each view.
    drift: standard deviation by which the object may have moved since, on each axis [m].
    name: of the picture, in messages; empty: it is the only one.
    mask: (height, width) bool, False where the picture shows what moves with the camera, as a
        gripper, or burnt-in text, which is no evidence; None: nowhere.
    Raises LightFieldError when these do not fit together.
    """

    header: Header
    picture: NDArray[np.float32]
    pinhole: Pinhole
    camera_to_reference: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    sigma: tuple[float, float] = (0.0, 0.0)
    group: str = ''
    common: float = 1.0
    drift: float = 0.0
    name: str = ''
    mask: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        expected = (self.pinhole.height, self.pinhole.width, 3)
        if self.picture.shape != expected or self.picture.dtype != np.float32:
            raise LightFieldError(f'the picture is {self.picture.dtype} of shape '
                                  f'{self.picture.shape}, its camera says float32 of {expected}: '
                                  'height, width, red green blue')
        if not (self.picture.min() >= 0 and self.picture.max() <= 1):  # NaN is neither
            raise LightFieldError('the picture holds values that are not 0 to 1, or NaN')
        if self.mask is not None and (self.mask.shape != expected[:2]
                                      or self.mask.dtype != np.bool_):
            raise LightFieldError(f'the mask is {self.mask.dtype} of shape {self.mask.shape}, its '
                                  f'picture says bool of {expected[:2]}: height, width')
        check_pose(self.camera_to_reference, 'camera_to_reference')
        if not (np.isfinite(self.sigma).all() and min(self.sigma) >= 0):
            raise LightFieldError(f'standard deviations of the pose {self.sigma} must be finite '
                                  'and not negative')
        if not 0 <= self.common <= 1:
            raise LightFieldError(f'common: a share of the variance is 0 to 1, not {self.common}')
        if not 0 <= self.drift < np.inf:
            raise LightFieldError(f'drift {self.drift} m must be finite and not negative')

    def crop(self, left: int, top: int, width: int, height: int) -> 'PosedView':
        """A part of it [px], as a view of its own."""
        rows, columns = slice(top, top + height), slice(left, left + width)
        return replace(self, picture=self.picture[rows, columns],
                       pinhole=self.pinhole.crop(left, top, width, height),
                       mask=None if self.mask is None else self.mask[rows, columns])

    def linear(self) -> NDArray[np.float32]:
        """(height, width, 3) linear light, 1 at white."""
        return self.picture ** np.float32(GAMMA)

    def is_of_one_colour(self, left: int, top: int, width: int, height: int) -> bool:
        """Whether a part of the picture [px] shows nothing: the lens is covered, or it is dark."""
        part = self.picture[top:top + height, left:left + width]
        size = max(width // _SQUARE, 1), max(height // _SQUARE, 1)
        means = cv2.resize(part, size, interpolation=cv2.INTER_AREA).reshape(-1, 3)
        least, most = np.percentile(means, (1, 99), axis=0)
        return bool((most - least).max() < _ONE_COLOUR)

    def displayed(self) -> NDArray[np.uint8]:
        """(height, width, 3) uint8 RGB for a screen."""
        return np.rint(255 * self.picture).astype(np.uint8)


def encoded(values: NDArray[Any], gamma: float) -> NDArray[np.float32]:
    """A camera's values, of any shape, as `PosedView.picture` has them.

    values: uint8, uint16, or float32 with 1 at white. gamma: exponent that makes them light.
    """
    white = 1 if values.dtype == np.float32 else np.iinfo(values.dtype).max
    picture = np.array(values, np.float32, order='C')  # in place: it may be large
    picture /= np.float32(white)
    if np.isfinite(picture).all():
        np.clip(picture, 0, 1, out=picture)
    if gamma != GAMMA:
        picture **= np.float32(gamma / GAMMA)
    return picture


def exposed(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """Linear light as a camera of automatic exposure encodes it, 0 to 1."""
    linear = linear * np.float32(_LEVEL / max(float(linear.mean()), 1e-6))
    return np.asarray(np.clip(linear, 0, 1) ** np.float32(1 / GAMMA), np.float32)


def centre_view(light_field: LightField) -> PosedView:
    """The centre view alone, as a picture of an ordinary camera, which is the reference."""
    return PosedView(light_field.header, exposed(light_field.centre_view),
                     light_field.grid.pinhole)


def check_pose(pose: NDArray[np.float64], name: str) -> None:
    """Raise LightFieldError unless a matrix is a rotation and a shift (4, 4)."""
    if wrong := _no_pose(pose):
        raise LightFieldError(f'{name} is no pose: {wrong}; expected 4x4 numbers, row by row, the '
                              'last row 0, 0, 0, 1')
    turn = pose[:3, :3]
    off = float(abs(turn @ turn.T - np.eye(3)).max())
    if off > _RIGID:
        raise LightFieldError(f'{name} is no rotation: its rows are {off:.2g} off being '
                              f'orthonormal, {_RIGID:g} is allowed; write it with more digits, or '
                              "as scipy's Rotation.from_matrix(R).as_matrix()")
    if np.linalg.det(turn) < 0:
        raise LightFieldError(f'{name} is no rotation: it mirrors (its determinant is -1); is an '
                              'axis turned round, or are two exchanged?')


def _no_pose(pose: NDArray[np.float64]) -> str:
    """Why numbers are no rotation and shift, whatever they are; empty where they may be."""
    if pose.shape != (4, 4):
        return f'its shape is {pose.shape}'
    if not (abs(pose) < _FAR).all():
        return f'it has a number that is NaN, or beyond {_FAR:g}'
    if (pose[3] == [0, 0, 0, 1]).all():
        return ''
    by_column = (pose[:, 3] == [0, 0, 0, 1]).all()
    return ('it is written column by column' if by_column
            else f'its last row is {", ".join(f"{each:.4g}" for each in pose[3])}')


def quaternion_pose(position: Sequence[float], quaternion: Sequence[float], name: str
                    ) -> NDArray[np.float64]:
    """(4, 4) of a position [m] and a unit quaternion x, y, z, w; else LightFieldError."""
    length = float(np.linalg.norm(quaternion))
    if not abs(length - 1) < _RIGID:
        values = ', '.join(f'{each:.5g}' for each in quaternion)
        raise LightFieldError(f'{name}: the quaternion ({values}) has length {length:.4g}, not 1: '
                              'x, y, z, w is the order, w last; no rotation is 0, 0, 0, 1')
    return pose_of(Rotation.from_quat(quaternion), position)


@dataclass(frozen=True)
class PosedViews:
    """Several views of one scene, with poses in one frame.

    views: at least one, all of the same reference frame. Raises LightFieldError otherwise.
    """

    views: tuple[PosedView, ...]

    def __post_init__(self) -> None:
        if not self.views:
            raise LightFieldError('there is no view; at least one is needed')
        frames = sorted({each.header.frame_id for each in self.views})
        if len(frames) > 1:
            raise LightFieldError(f'views have poses in the frames {", ".join(frames)}; give them '
                                  'all in one')

    @property
    def header(self) -> Header:
        """The stamp of the last view, and the reference frame."""
        return max((each.header for each in self.views), key=lambda header: header.stamp_ns)

    @property
    def cameras(self) -> list[tuple[Pinhole, NDArray[np.float64]]]:
        """Of the views, each with its pose (4, 4) in the reference frame."""
        return [(each.pinhole, each.camera_to_reference) for each in self.views]


@dataclass(frozen=True)
class PoseErrors:
    """Errors of camera poses that a user states, for views whose source does not, or otherwise.

    position [m], rotation [rad]: standard deviations on each axis. common: share of the variance
    that all views have in common. None: as the views have it.
    """

    position: float | None = None
    rotation: float | None = None
    common: float | None = None

    def of(self, views: PosedViews) -> PosedViews:
        """The views with these errors. Raises LightFieldError for impossible ones."""
        found = [replace(each, sigma=(
            each.sigma[0] if self.position is None else self.position,
            each.sigma[1] if self.rotation is None else self.rotation)) for each in views.views]
        if self.common is not None:
            found = [replace(each, group='all', common=self.common) for each in found]
        return PosedViews(tuple(found))
