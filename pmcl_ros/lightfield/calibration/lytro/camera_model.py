"""Projection of points by a light-field camera: the model of the bundle adjustment."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.lightfield.calibration.lytro.calibration import RAW_PITCH

# Parameters of the camera, in this order; a board's pose follows: rotation vector, origin.
PARAMETERS = ('fx', 'fy', 'cx', 'cy', 'baseline', 'focus', 'k1', 'k2')


@dataclass(frozen=True)
class Model:
    """Free parameters: one focal length or two, and the number of distortion terms."""

    focals: int = 1
    distortions: int = 0

    @property
    def basis(self) -> NDArray[np.float64]:
        """(8, free): the camera's parameters are `basis` times the free ones."""
        columns = [np.isin(PARAMETERS, names).astype(float) for names in (
            *([('fx', 'fy')] if self.focals == 1 else [('fx',), ('fy',)]),
            ('cx',), ('cy',), ('baseline',), ('focus',), *(('k1',), ('k2',))[:self.distortions])]
        return np.stack(columns, axis=1)

    @property
    def free(self) -> int:
        """How many parameters are free."""
        return self.basis.shape[1]


def predict(points: NDArray[np.float64], camera: NDArray[np.float64],
            poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, m, 4) position and disparity of points (m, 3) of boards at poses (n, 6).

    With c = baseline (1 / focus distance - 1 / z), a view at (a, b) of the aperture sees a point
    at the normalised coordinates (x / z + a c, y / z + b c), which the lens then displaces to
    (1 + k1 r^2 + k2 r^4) times them; `focus` is 1 / focus distance. Bok et al. (2017) write the
    same, before distortion, as x - xc = (X - Z xc) / (K1 Z + K2): see `bok_parameters`.
    """
    fx, fy, cx, cy, baseline, focus, k1, k2 = camera
    turned = np.einsum('nij,mj->nmi', Rotation.from_rotvec(poses[:, :3]).as_matrix(), points)
    seen = turned + poses[:, None, 3:]
    x, y = seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2]
    per_step = baseline * (focus - 1 / seen[..., 2])
    square = x ** 2 + y ** 2
    factor, slope = 1 + (k1 + k2 * square) * square, 2 * k1 + 4 * k2 * square
    return np.stack([fx * x * factor + cx, fy * y * factor + cy,
                     fx * per_step * (factor + x ** 2 * slope),
                     fy * per_step * (factor + y ** 2 * slope)], axis=-1)


def bok_parameters(fx: float, baseline: float, focus_distance: float) -> tuple[float, float]:
    """K1 and K2 [m] of Bok et al. (PAMI 2017).

    Their x - xc = (X - Z xc) / (K1 Z + K2) is where, under the lenslet at normalised xc, a point
    is seen, normalised with the focal length in raw pixels, RAW_PITCH fx: a view step, one raw
    pixel, is 1 / (RAW_PITCH fx). Ours, solved for the step, is a = (X / Z - xc) / (-c) with the
    same point's c = baseline (1/F - 1/Z), hence K2 = baseline RAW_PITCH fx and K1 = -K2 / F: views
    one step apart are K2 / (RAW_PITCH fx) apart and see no disparity at Z = -K2 / K1 = F.
    """
    k2 = baseline * RAW_PITCH * fx
    return -k2 / focus_distance, k2
