"""From weighted particles to one pose and its covariance, in the space the symmetry leaves."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import chdtr

from pmcl_ros.pmcl.weights import Weights

FREE_AXIS_VARIANCE = math.pi ** 2 / 3  # rad^2: of an angle uniform over the full turn


def mean_pose(poses: NDArray[np.float64], weights: Weights, axis: NDArray[np.float64] | None
              ) -> NDArray[np.float64]:
    """(4, 4) weighted mean of poses (n, 4, 4) of one mode.

    The mean rotation is the chordal mean; with an axis of symmetry only the mean axis is meant
    (averaging the arbitrary spins would tilt it) and the canonical representative is returned.
    """
    w = weights.normalised
    mean = np.eye(4)
    mean[:3, 3] = w @ poses[:, :3, 3]
    if axis is None:
        mean[:3, :3] = Rotation.from_matrix(poses[:, :3, :3]).mean(w).as_matrix()
        return mean
    direction = w @ (poses[:, :3, :3] @ axis)
    mean[:3, :3] = poses[int(w.argmax()), :3, :3]
    swing = Rotation.align_vectors(direction[None], (mean[:3, :3] @ axis)[None])[0]
    mean[:3, :3] = swing.as_matrix() @ mean[:3, :3]
    return canonical(mean, axis)


def canonical(pose: NDArray[np.float64], axis: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """The representative of a pose (4, 4) under a symmetry: the object's front faces the camera.

    The front is the mesh's axis after the axis of symmetry (x for z): it points to the camera as
    far as it can.
    """
    if axis is None:
        return pose
    along = np.abs(axis)
    if np.allclose(along, np.eye(3)[along.argmax()]):
        side = np.roll(axis, 1)
    else:
        side = np.cross(axis, [0, 0, 1.0])
    spindle = pose[:3, :3] @ axis
    towards = -pose[:3, 3] - spindle * (spindle @ -pose[:3, 3])
    if np.linalg.norm(towards) < 1e-3 * np.linalg.norm(pose[:3, 3]):
        # Seen along its axis: any side will do.
        towards = np.array([0, 1.0, 0]) - spindle * spindle[1]
    frame = [spindle, towards / np.linalg.norm(towards)]
    turned = pose.copy()
    turned[:3, :3] = Rotation.align_vectors(frame, [axis, side / np.linalg.norm(side)]
                                            )[0].as_matrix()
    return turned


def tangent(poses: NDArray[np.float64], mean: NDArray[np.float64],
            axis: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """(n, 6) how poses (n, 4, 4) deviate from a mean (4, 4): shift [m], then turn [rad].

    The turn is a rotation vector about the axes of the camera's frame. With an axis of symmetry it
    is the smallest that turns the one axis into the other: it has no part about the mean's axis.
    """
    shift = poses[:, :3, 3] - mean[:3, 3]
    if axis is None:
        turn = (Rotation.from_matrix(poses[:, :3, :3])
                * Rotation.from_matrix(mean[:3, :3]).inv()).as_rotvec()
        return np.concatenate([shift, turn], axis=1)
    spindle = mean[:3, :3] @ axis
    axes = poses[:, :3, :3] @ axis
    turn = np.cross(spindle, axes)
    sine = np.linalg.norm(turn, axis=1, keepdims=True)
    turn = turn / np.maximum(sine, 1e-12) * np.arctan2(sine, (axes @ spindle)[:, None])
    return np.concatenate([shift, turn], axis=1)


def tangent_basis(mean: NDArray[np.float64], axis: NDArray[np.float64] | None
                  ) -> NDArray[np.float64]:
    """(6, d) orthonormal columns that span the deviations from a mean pose (4, 4).

    d is 6, or 5 with an axis of symmetry: without the turn about it.
    """
    if axis is None:
        return np.eye(6)
    across = np.linalg.svd((mean[:3, :3] @ axis)[None])[2][1:]
    basis = np.zeros((6, 5))
    basis[:3, :3], basis[3:, 3:] = np.eye(3), across.T
    return basis


def credible_level(pose: NDArray[np.float64], mean: NDArray[np.float64],
                   covariance: NDArray[np.float64], axis: NDArray[np.float64] | None) -> float:
    """Level (0..1) of the smallest credible region about an estimate that holds `pose`.

    pose, mean: (4, 4). covariance: (6, 6) of the estimate. axis: (3,) of the object's symmetry.

    The region is the ellipsoid of the Gaussian with that covariance in the tangent space at the
    mean, in which turns about the axis of symmetry have no part: its level is the chi-squared
    distribution of the squared Mahalanobis distance, with 5 degrees of freedom, or 6 without a
    symmetry. A pose is in the 90 % region where this is 0.9 at most; over trials of an estimate
    that is as sure as it says, the truth's levels are uniform.
    """
    basis = tangent_basis(mean, axis)
    deviation = basis.T @ tangent(pose[None], mean, axis)[0]
    spread = basis.T @ covariance @ basis
    # Metres and radians differ in size: the spread is brought to unit variances first.
    scale = 1 / np.sqrt(np.maximum(np.diag(spread), 1e-30))
    correlation = spread * np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
    distance = (deviation * scale) @ np.linalg.solve(correlation, deviation * scale)
    return float(chdtr(basis.shape[1], distance))


def covariance(poses: NDArray[np.float64], weights: Weights, mean: NDArray[np.float64],
               axis: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """(6, 6) of x, y, z [m^2] and rotations about the camera's axes [rad^2].

    pi^2 / 3 about an axis of symmetry.
    """
    deviations = tangent(poses, mean, axis)
    result = (deviations * weights.normalised[:, None]).T @ deviations
    if axis is not None:
        spindle = mean[:3, :3] @ axis
        result[3:, 3:] += FREE_AXIS_VARIANCE * np.outer(spindle, spindle)
    return (result + result.T) / 2


def same_mode(poses: NDArray[np.float64], best: NDArray[np.float64],
              axis: NDArray[np.float64] | None, distance: float, angle: float
              ) -> NDArray[np.bool_]:
    """(n,) which poses lie within `distance` [m] and `angle` [rad] of `best`.

    Turns about the symmetry axis are ignored.
    """
    near = np.linalg.norm(poses[:, :3, 3] - best[:3, 3], axis=1) < distance
    return near & (rotation_distance(poses, best, axis) < angle)


def rotation_distance(poses: NDArray[np.float64], other: NDArray[np.float64],
                      axis: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """(n,) angle between orientations [rad]; between the symmetry axes where there is one."""
    if axis is not None:
        cosine = (poses[:, :3, :3] @ axis) @ (other[:3, :3] @ axis)
    else:
        cosine = (np.einsum('nij,ij->n', poses[:, :3, :3], other[:3, :3]) - 1) / 2
    return np.arccos(np.clip(cosine, -1, 1))
