"""An ordinary camera: a pinhole with distortion, as sensor_msgs/CameraInfo has it."""

from dataclasses import dataclass
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import LightFieldError

DistortionModel = Literal['plumb_bob', 'rational_polynomial', 'equidistant']
_COUNTS = {'plumb_bob': (0, 4, 5), 'rational_polynomial': (0, 8, 12, 14), 'equidistant': (0, 4)}


@dataclass(frozen=True)
class Lens:
    """A pinhole and what its lens does to it.

    distortion: coefficients of OpenCV's models, which are those of REP-104: plumb_bob and
        rational_polynomial (k1, k2, p1, p2[, k3, ...]), equidistant (its fisheye, k1 to k4).
        Empty: none.
    Raises LightFieldError for other models, or other numbers of coefficients.
    """

    pinhole: Pinhole
    distortion: tuple[float, ...] = ()
    model: DistortionModel = 'plumb_bob'

    def __post_init__(self) -> None:
        if self.model not in get_args(DistortionModel):
            raise LightFieldError(f'distortion model {self.model!r} is not known, only '
                                  f'{", ".join(get_args(DistortionModel))}; rectify the images '
                                  'first')
        if (len(self.distortion) not in _COUNTS[self.model]
                or not np.isfinite(self.distortion).all()):
            raise LightFieldError(
                f'{self.model} distortion {list(self.distortion)} has {len(self.distortion)} '
                f'coefficients; expected {" or ".join(map(str, _COUNTS[self.model]))} numbers')

    def places(self, turn: NDArray[np.float64], wanted: Pinhole
               ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Where this camera's image shows what each pixel of `wanted` looks at, far away.

        turn: (3, 3) takes directions of this camera to those of `wanted`. Two arrays (height,
        width) of `wanted`: column and row [px], which may lie outside the image.
        """
        size, distortion = (wanted.width, wanted.height), np.array(self.distortion, float)
        if self.model == 'equidistant' and len(distortion):
            x, y = cv2.fisheye.initUndistortRectifyMap(
                self.pinhole.matrix, distortion, turn, wanted.matrix, size, cv2.CV_32FC1)
        else:
            x, y = cv2.initUndistortRectifyMap(
                self.pinhole.matrix, distortion, turn, wanted.matrix, size, cv2.CV_32FC1)
        return np.asarray(x, np.float32), np.asarray(y, np.float32)
