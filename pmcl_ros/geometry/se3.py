"""Rigid motions: make, invert, interpolate, perturb; and covariances of poses.

A pose is a (4, 4) float64 matrix that takes points of one frame, in metres, to another. The
covariance of a pose is (6, 6): x, y, z [m^2], then rotations about the fixed axes of the frame in
which the pose is expressed [rad^2].
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp


def pose_of(rotation: Rotation | NDArray[np.float64],
            position: NDArray[np.floating] | Sequence[float]) -> NDArray[np.float64]:
    """(..., 4, 4) poses of rotations, or matrices (..., 3, 3), and positions (..., 3) [m]."""
    turn = rotation.as_matrix() if isinstance(rotation, Rotation) else np.asarray(rotation)
    pose = np.zeros((*turn.shape[:-2], 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = turn, position, 1
    return pose


def transform(position: Sequence[float] | NDArray[np.float64], rpy: Sequence[float] = (0, 0, 0)
              ) -> NDArray[np.float64]:
    """(4, 4) pose of a position [m] and roll, pitch, yaw about fixed axes, as in URDF [rad]."""
    return pose_of(Rotation.from_euler('xyz', rpy), position)


def inverse(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 4, 4) inverses of poses (..., 4, 4)."""
    result = np.zeros(pose.shape)
    result[..., :3, :3] = np.swapaxes(pose[..., :3, :3], -1, -2)
    result[..., :3, 3] = -(result[..., :3, :3] @ pose[..., :3, 3:])[..., 0]
    result[..., 3, 3] = 1
    return result


def rotations_about(axis: NDArray[np.float64], angles: NDArray[np.float64]
                    ) -> NDArray[np.float64]:
    """(n, 4, 4) rotations by `angles` (n,) [rad] about a unit vector through the origin."""
    return pose_of(Rotation.from_rotvec(angles[:, None] * axis), [0, 0, 0])


def least_turn(start: NDArray[np.float64], end: NDArray[np.float64]) -> Rotation:
    """The smallest rotation that takes one direction (3,) to another, neither of length 0.

    Of opposite directions: half a turn about the axis across both that is farthest from the
    coordinate axis nearest to it. (`Rotation.align_vectors` of one pair is not the smallest
    before SciPy 1.12.)
    """
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    flip = Rotation.identity()
    if start @ end < 0:  # near half a turn the rest is short, and exact
        across = np.cross(start, end)
        if np.linalg.norm(across) < 1e-12:
            across = np.cross(start, np.eye(3)[np.abs(start).argmin()])
        across -= (across @ start) * start
        flip = Rotation.from_rotvec(np.pi * across / np.linalg.norm(across))
        start = -start
    turn = np.cross(start, end)
    sine = np.linalg.norm(turn)
    scale = np.arctan2(sine, start @ end) / sine if sine > 0 else 1.0
    return Rotation.from_rotvec(scale * turn) * flip


def rotation_angle(poses: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) angles [rad] between the orientations of poses (n, 4, 4) and of one pose (4, 4)."""
    cosine = (np.einsum('nij,ij->n', poses[:, :3, :3], other[:3, :3]) - 1) / 2
    return np.arccos(np.clip(cosine, -1, 1))


def interpolate(first: NDArray[np.float64], last: NDArray[np.float64], fraction: float
                ) -> NDArray[np.float64]:
    """(4, 4) pose at `fraction` (0 to 1) between two: linear in position, slerp in rotation."""
    ends = Rotation.from_matrix([first[:3, :3], last[:3, :3]])
    return pose_of(Slerp([0.0, 1.0], ends)(fraction),
                   (1 - fraction) * first[:3, 3] + fraction * last[:3, 3])


def retract(poses: NDArray[np.float64], deviations: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 4, 4) poses (..., 4, 4) moved by tangent vectors (n, 6); the inverse of `local`.

    deviations: translation [m], then a rotation vector [rad], both in the frame in which the
    poses are expressed.
    """
    result = np.array(np.broadcast_to(poses, (len(deviations), 4, 4)))
    if len(deviations) == 0:  # which Rotation takes from SciPy 1.15 on only
        return result
    result[:, :3, 3] += deviations[:, :3]
    result[:, :3, :3] = Rotation.from_rotvec(deviations[:, 3:]).as_matrix() @ result[:, :3, :3]
    return result


def local(poses: NDArray[np.float64], mean: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 6) tangent vectors that move `mean` (4, 4) or (n, 4, 4) to poses (n, 4, 4).

    Translation [m], then a rotation vector [rad]; `retract` is the inverse.
    """
    if len(poses) == 0:
        return np.zeros((0, 6))
    rotation = (Rotation.from_matrix(poses[:, :3, :3])
                * Rotation.from_matrix(mean[..., :3, :3]).inv()).as_rotvec()
    return np.concatenate([poses[:, :3, 3] - mean[..., :3, 3], rotation], axis=1)


def rotate_covariance(covariance: NDArray[np.float64], rotation: NDArray[np.float64]
                      ) -> NDArray[np.float64]:
    """(6, 6) covariance of a pose, expressed in another frame.

    rotation: (3, 3), takes vectors of the old frame to the new one.
    """
    both = np.kron(np.eye(2), rotation)
    return both @ covariance @ both.T


def remove_spin(covariance: NDArray[np.float64], axis: NDArray[np.float64]
                ) -> NDArray[np.float64]:
    """(6, 6) covariance without the rotation about a unit `axis`, which symmetry hides."""
    keep = np.eye(6)
    keep[3:, 3:] -= np.outer(axis, axis)
    return keep @ covariance @ keep


def point_covariance(covariance: NDArray[np.float64], lever: NDArray[np.float64]
                     ) -> NDArray[np.float64]:
    """(..., 3, 3) [m^2] covariance of points of the object, to first order.

    covariance: (6, 6) of its pose. lever: (..., 3) from the object's origin to the points [m].
    """
    jacobian = _lever_jacobian(lever)
    return jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)


def covariance_at(covariance: NDArray[np.float64], lever: NDArray[np.float64]
                  ) -> NDArray[np.float64]:
    """(6, 6) covariance of a pose whose origin is another point of the object, to first order.

    covariance: (6, 6) of its pose. lever: (3,) from the object's origin to that point [m].
    """
    jacobian = np.eye(6)
    jacobian[:3] = _lever_jacobian(lever)
    return jacobian @ covariance @ jacobian.T


def _lever_jacobian(lever: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3, 6) of the positions of points `lever` (..., 3) from the origin, by the pose."""
    jacobian = np.zeros((*lever.shape[:-1], 3, 6))
    jacobian[..., :3] = np.eye(3)
    x, y, z = np.moveaxis(lever, -1, 0)
    jacobian[..., 0, 4], jacobian[..., 0, 5] = z, -y
    jacobian[..., 1, 3], jacobian[..., 1, 5] = -z, x
    jacobian[..., 2, 3], jacobian[..., 2, 4] = y, -x
    return jacobian
