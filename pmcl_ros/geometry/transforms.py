"""Transforms: (4, 4) float64 matrices that take points of one frame, in metres, to another.

`a_to_b` of a frame b in a frame a, as tf names them: the pose of b in a.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation


def transform(position: Sequence[float] | NDArray[np.float64], rpy: Sequence[float] = (0, 0, 0)
              ) -> NDArray[np.float64]:
    """(4, 4) of a position [m] and roll, pitch, yaw about the fixed axes, as in URDF [rad]."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler('xyz', rpy).as_matrix()
    matrix[:3, 3] = position
    return matrix


def inverse(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 4, 4) the inverse of rigid transforms (..., 4, 4)."""
    result = np.zeros(pose.shape)
    result[..., :3, :3] = np.swapaxes(pose[..., :3, :3], -1, -2)
    result[..., :3, 3] = -(result[..., :3, :3] @ pose[..., :3, 3:])[..., 0]
    result[..., 3, 3] = 1
    return result


def about(axis: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 4, 4) turns by `angles` (n,) [rad] about a unit vector through the origin."""
    matrices = np.tile(np.eye(4), (len(angles), 1, 1))
    matrices[:, :3, :3] = Rotation.from_rotvec(angles[:, None] * axis).as_matrix()
    return matrices


def turned_covariance(covariance: NDArray[np.float64], rotation: NDArray[np.float64]
                      ) -> NDArray[np.float64]:
    """(6, 6) of x, y, z and rotations about fixed axes, told in a frame turned by (3, 3).

    rotation takes vectors of the old frame to the new one.
    """
    both = np.kron(np.eye(2), rotation)
    return both @ covariance @ both.T


def without_spin(covariance: NDArray[np.float64], axis: NDArray[np.float64]
                 ) -> NDArray[np.float64]:
    """(6, 6) without the rotation about a unit `axis`, which a symmetric object does not show."""
    keep = np.eye(6)
    keep[3:, 3:] -= np.outer(axis, axis)
    return keep @ covariance @ keep


def covariance_at(covariance: NDArray[np.float64], lever: NDArray[np.float64]
                  ) -> NDArray[np.float64]:
    """(..., 3, 3) [m^2] of a point's shift, to first order.

    covariance: (6, 6) of the object's pose. lever: (..., 3) from the object's origin to the point.
    """
    jacobian = np.zeros((*lever.shape[:-1], 3, 6))
    jacobian[..., :3] = np.eye(3)
    x, y, z = np.moveaxis(lever, -1, 0)
    jacobian[..., 0, 4], jacobian[..., 0, 5] = z, -y
    jacobian[..., 1, 3], jacobian[..., 1, 5] = -z, x
    jacobian[..., 2, 3], jacobian[..., 2, 4] = y, -x
    return jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)
