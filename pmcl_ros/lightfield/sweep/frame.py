"""One picture of a sweep with its camera and its pose."""

import logging
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal, NamedTuple, cast, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import LightFieldError

_LOG = logging.getLogger(__name__)
DistortionModel = Literal['plumb_bob', 'rational_polynomial', 'equidistant']
_COUNTS = {'plumb_bob': (0, 4, 5), 'rational_polynomial': (0, 8, 12, 14), 'equidistant': (0, 4)}
_COARSE = 64  # px: directions that are tried, across and down
_KEPT = 0.75  # of a picture, without its distortion: less than lenses of 60 degrees leave
_HALF = 0.5  # of a pixel
_SIGMA = 1.0  # px: smooths pixel noise, which motion does not blur
_RIGID = 1e-4  # tolerance of orthogonality: poses in messages are rounded


@dataclass(frozen=True)
class Lens:
    """A pinhole and the distortion of its lens.

    distortion: coefficients of OpenCV's models, which are those of REP-104: plumb_bob and
        rational_polynomial (k1, k2, p1, p2[, k3, ...]), equidistant (its fisheye, k1 to k4).
        Empty: none.
    Raises LightFieldError for other models, other numbers of coefficients, or NaN among them.
    """

    pinhole: Pinhole
    distortion: tuple[float, ...] = ()
    model: DistortionModel = 'plumb_bob'

    def __post_init__(self) -> None:
        if self.model not in get_args(DistortionModel):
            raise LightFieldError(f'distortion model {self.model!r} is not known, only '
                                  f'{", ".join(get_args(DistortionModel))}; rectify the images '
                                  'first')
        if not np.isfinite(self.distortion).all():
            raise LightFieldError(f'{self.model} distortion {list(self.distortion)} is not '
                                  'finite: calibrate the camera again')
        if len(self.distortion) not in _COUNTS[self.model]:
            others = [name for name, counts in _COUNTS.items() if len(self.distortion) in counts
                      and name != self.model]
            raise LightFieldError(
                f'{self.model} distortion {list(self.distortion)} has {len(self.distortion)} '
                f'coefficients; expected {" or ".join(map(str, _COUNTS[self.model]))} numbers'
                + ''.join(f'; so many are of {name}' for name in others))

    @classmethod
    def from_matrix(cls, width: int, height: int, matrix: NDArray[np.float64],
                    distortion: tuple[float, ...], model: str) -> 'Lens':
        """Of a camera matrix (3, 3) and pictures of a size [px], as ROS tells them.

        Coefficients that are all 0 are none, whatever their model.
        """
        fx, fy, cx, cy = (float(each) for each in matrix[[0, 1, 0, 1], [0, 1, 2, 2]])
        pinhole = Pinhole(width, height, fx, fy, cx, cy)
        if not any(distortion):
            return cls(pinhole)
        return cls(pinhole, distortion, cast(DistortionModel, model))  # which is checked there

    def check_size(self, picture: NDArray[Any], name: str) -> None:
        """Raise LightFieldError for a picture (height, width[, 3]) of another size; name: its."""
        height, width = picture.shape[:2]
        if (width, height) != (self.pinhole.width, self.pinhole.height):
            raise LightFieldError(
                f'{name} has {width}x{height} px, its camera (camera_info) {self.pinhole.width}x'
                f'{self.pinhole.height}: give the calibration of this resolution')

    def places(self, turn: NDArray[np.float64], wanted: Pinhole
               ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Column and row [px] in this image of the direction of each pixel of `wanted`.

        turn: (3, 3) rotates directions of this camera to those of `wanted`. Returns two arrays
        (height, width) of `wanted`; places may lie outside the image.
        """
        size, distortion = (wanted.width, wanted.height), np.array(self.distortion, float)
        if self.model == 'equidistant' and len(distortion):
            x, y = cv2.fisheye.initUndistortRectifyMap(
                self.pinhole.matrix, distortion, turn, wanted.matrix, size, cv2.CV_32FC1)
        else:
            x, y = cv2.initUndistortRectifyMap(
                self.pinhole.matrix, distortion, turn, wanted.matrix, size, cv2.CV_32FC1)
        return np.asarray(x, np.float32), np.asarray(y, np.float32)

    @property
    def folds(self) -> bool:
        """Whether the image would show different directions at one place, as no lens does.

        Of the directions that the pinhole sees.
        """
        return bool((self._areas < 0).any())

    @property
    def kept(self) -> float:
        """Share of the image that the pinhole sees; distortion may bring in more than that."""
        return float(self._areas.sum() / (_COARSE - 1) ** 2)

    @property
    def _areas(self) -> NDArray[np.float64]:
        """(n,) areas [px] in the image of the squares of a coarse pinhole, of those inside it.

        Negative where directions are mirrored.
        """
        pinhole = self.pinhole.resized(_COARSE, _COARSE)
        x, y = replace(self, pinhole=pinhole).places(np.eye(3), pinhole)
        with np.errstate(over='ignore', invalid='ignore'):  # far outside, by absurd coefficients
            areas = (np.diff(x, axis=1)[:-1] * np.diff(y, axis=0)[:, :-1]
                     - np.diff(x, axis=0)[:, :-1] * np.diff(y, axis=1)[:-1])
        inside = (x >= 0) & (x <= _COARSE - 1) & (y >= 0) & (y <= _COARSE - 1)
        return np.asarray(areas[inside[:-1, :-1]], np.float64)

    def undistorted(self, picture: NDArray[np.float32], wanted: Pinhole) -> NDArray[np.float32]:
        """The picture (height, width[, 3]), 0 to 1, that a pinhole at its place sees.

        Pixels that the camera did not see repeat the border.
        """
        if self.pinhole == wanted and not self.distortion:
            return picture
        x, y = self.places(np.eye(3), wanted)
        seen = np.asarray(cv2.remap(picture, x, y, cv2.INTER_CUBIC,
                                    borderMode=cv2.BORDER_REPLICATE), np.float32)
        return np.clip(seen, 0, 1, out=seen)

    def undistorted_mask(self, mask: NDArray[np.bool_], wanted: Pinhole) -> NDArray[np.bool_]:
        """A mask (height, width) of such a picture, as `undistorted`."""
        return np.asarray(self.undistorted(mask.astype(np.float32), wanted) >= _HALF)


@lru_cache  # camera_info comes with each picture, of some cameras with other numbers each time
def warn_distorted(camera: str, lens: Lens) -> None:
    """Warn, once, of a distortion that folds the picture of a camera, or leaves little of it."""
    if lens.folds:
        _LOG.warning('camera %r: its distortion, %s %s, shows different directions at one place '
                     'of the picture: are the coefficients of another model, or in another order?',
                     camera, lens.model, list(lens.distortion))
    elif lens.kept < _KEPT:
        _LOG.warning('camera %r: without its distortion %.0f %% of each picture are left, and an '
                     'object near the border may be lost: if it can be there, undistort the '
                     'pictures with a smaller fx, and state that camera', camera, 100 * lens.kept)


class LeftOut(NamedTuple):
    """An unused frame and the reason.

    spare: a better frame of the same place exists. moved: it was taken on the way between two
    places, as an arm moves.
    """

    name: str
    reason: str
    spare: bool = False
    moved: bool = False

    def __str__(self) -> str:
        return (self.reason if self.reason.startswith((f'{self.name} ', f'{self.name}: '))
                else f'{self.name}: {self.reason}')


@dataclass(frozen=True)
class SweepFrame:
    """A picture, its camera and its pose.

    name: in messages. stamp_ns: time of the exposure. image: (height, width, 3) RGB of the
    camera: uint8, uint16, or float32 with 1 at white. pose: (4, 4) the optical frame (x
    right, y down, z forward) in a fixed frame [m]. speed, angular_speed: of the camera
    while it was exposed [m/s], [rad/s].
    Raises LightFieldError when these do not fit together.
    """

    name: str
    stamp_ns: int
    image: NDArray[Any]
    lens: Lens
    pose: NDArray[np.float64]
    speed: float = 0.0
    angular_speed: float = 0.0

    def __post_init__(self) -> None:
        if (self.image.ndim != 3 or self.image.shape[2] != 3
                or self.image.dtype not in (np.uint8, np.uint16, np.float32)):
            raise LightFieldError(
                f'{self.name} is {self.image.dtype} of shape {self.image.shape}; expected '
                '(height, width, 3) of uint8, uint16 or float32')
        self.lens.check_size(self.image, self.name)
        turn = self.pose[:3, :3]
        if (self.pose.shape != (4, 4) or not np.isfinite(self.pose).all()
                or abs(turn @ turn.T - np.eye(3)).max() > _RIGID or np.linalg.det(turn) < 0):
            raise LightFieldError(f'{self.name}: its pose {self.pose.tolist()} is no rigid '
                                  'transform (4, 4)')

    @property
    def position(self) -> NDArray[np.float64]:
        """(3,) position of the camera [m]."""
        return self.pose[:3, 3]

    def movement(self, near: float, exposure: float) -> float:
        """Image motion of a point at depth `near` during `exposure` s [px]."""
        return self.lens.pinhole.fx * exposure * (self.speed / near + self.angular_speed)

    @property
    def brightness(self) -> float:
        """Mean of the camera's values, 1 at white."""
        return self._measured[0]

    @property
    def sharpness(self) -> NDArray[np.float64]:
        """(2,) energy of the horizontal and vertical second derivatives over the brightness.

        Motion blurs along its own direction only.
        """
        return self._measured[1]

    @cached_property
    def _measured(self) -> tuple[float, NDArray[np.float64]]:
        """Brightness and sharpness: at once, as a grey picture is larger than the image."""
        white = 1.0 if self.image.dtype == np.float32 else np.iinfo(self.image.dtype).max
        grey = np.asarray(self.image.mean(axis=2, dtype=np.float32) / np.float32(white))
        brightness = float(grey.mean())
        smooth = cv2.GaussianBlur(grey, (0, 0), _SIGMA)
        bends = (cv2.Sobel(smooth, cv2.CV_32F, 2, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 2))
        return brightness, np.array([float((each ** 2).mean()) for each in bends]) / max(
            brightness, 1e-6) ** 2
