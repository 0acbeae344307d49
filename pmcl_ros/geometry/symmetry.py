"""The symmetry of an object, and poses modulo that symmetry.

Poses T and T S give the same picture, for each motion S of its symmetry group: rotations about an
axis, a finite group of rigid motions, or both. Means, deviations and distances of poses are here
those of the quotient space, in which such poses are one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry import student_t
from pmcl_ros.geometry.se3 import least_turn, local, pose_of, rotation_angle, rotations_about
from pmcl_ros.runtime.errors import ObjectModelError

FREE_AXIS_VARIANCE = math.pi ** 2 / 3  # rad^2: of an angle that is uniform over the full turn

_MOST = 128  # elements of a group: the icosahedron's has 60
_ROUNDED, _APART = 0.005, 0.04  # rad: closer rotations differ by rounding; elements are farther
_FAR = 1e9  # of units of a mesh: nothing is
_RIGID = 1e-3  # tolerance of a rotation matrix's orthonormality
# Upright and facing the camera, but oblique: no common pose (standing, lying) is then half way
# between two equivalent ones, where noise would decide.
_OBLIQUE = Rotation.from_rotvec([0.25, 0.15, 0.35])
_UP = _OBLIQUE.apply([0.0, -1.0, 0.0])
_UPRIGHT = _OBLIQUE.as_matrix() @ np.array([[0, 1.0, 0], [0, 0, -1], [-1, 0, 0]])


@dataclass(frozen=True, eq=False)
class Symmetry:
    """The symmetry group of an object; by default the object has none.

    axis: (3,) unit vector through the origin; any rotation about it is a symmetry. Or None.
    discrete: (k, 4, 4) group of rigid motions in the object's frame [m], the identity first; with
        an axis one or two: beside the rotations only a reversal of the axis is possible.

    Poses are (4, 4), object to camera [m]. Tangent vectors and covariances are of x, y, z [m] and
    of rotations about the camera's axes [rad].
    """

    axis: NDArray[np.float64] | None = None
    discrete: NDArray[np.float64] = field(default_factory=lambda: np.eye(4)[None])

    @property
    def rotations_in_place(self) -> NDArray[np.float64]:
        """(m, 3, 3) rotations of the discrete group that keep the origin in place (1 um)."""
        fixed = np.linalg.norm(self.discrete[:, :3, 3], axis=1) < 1e-6
        return self.discrete[fixed, :3, :3]

    # equivalent poses

    def equivalents(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k, 4, 4) images of a pose (4, 4) under the discrete group, itself first."""
        return pose @ self.discrete

    def nearest_equivalents(self, poses: NDArray[np.float64], reference: NDArray[np.float64]
                            ) -> NDArray[np.float64]:
        """(n, 4, 4) for each pose its discrete equivalent with the rotation nearest `reference`.

        The rotation about the axis is left as it is.
        """
        if len(self.discrete) == 1:
            return poses
        equivalents = poses[:, None] @ self.discrete
        angles = self._angle(equivalents.reshape(-1, 4, 4), reference)
        nearest = angles.reshape(equivalents.shape[:2]).argmin(axis=1)
        return np.asarray(equivalents[np.arange(len(poses)), nearest])

    def canonical(self, equivalents: NDArray[np.float64]) -> NDArray[np.float64]:
        """(4, 4) the one of equivalent poses (k, 4, 4) that represents them, in any order.

        Its axis points up in the image most, or, without an axis, its x to the camera and its z
        up (both directions tilted a little); its spin is that of `canonical_spin`.
        """
        if self.axis is not None:
            rank = (equivalents[:, :3, :3] @ self.axis) @ _UP
        else:
            rank = np.einsum('nij,ij->n', equivalents[:, :3, :3], _UPRIGHT)
        return self.canonical_spin(equivalents[int(rank.argmax())])

    def canonical_spin(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """(4, 4) the pose, rotated about the axis so that the object's front faces the camera.

        The front is the mesh's axis after the axis of symmetry (x for z). Without an axis of
        symmetry the pose is returned as it is.
        """
        axis = self.axis
        if axis is None:
            return pose
        along = np.abs(axis)
        if np.allclose(along, np.eye(3)[along.argmax()]):
            front = np.roll(axis, 1)
        else:
            front = np.cross(axis, [0, 0, 1.0])
        direction = pose[:3, :3] @ axis
        towards = -pose[:3, 3] - direction * (direction @ -pose[:3, 3])
        if np.linalg.norm(towards) < 1e-3 * np.linalg.norm(pose[:3, 3]):
            # Seen along its axis: any front will do.
            towards = np.array([0, 1.0, 0]) - direction * direction[1]
        frame = [direction, towards / np.linalg.norm(towards)]
        result = pose.copy()
        result[:3, :3] = Rotation.align_vectors(frame, [axis, front / np.linalg.norm(front)]
                                                )[0].as_matrix()
        return result

    def nearest(self, equivalents: NDArray[np.float64], reference: NDArray[np.float64]
                ) -> NDArray[np.float64]:
        """(4, 4) the one of equivalent poses (k, 4, 4) with the rotation nearest a reference's.

        Its spin is that of `nearest_spin`.
        """
        nearest = equivalents[int(self._angle(equivalents, reference).argmin())]
        return self.nearest_spin(nearest, reference)

    def nearest_spin(self, pose: NDArray[np.float64], reference: NDArray[np.float64]
                     ) -> NDArray[np.float64]:
        """(4, 4) the pose, rotated about the axis so that its rotation is nearest a reference's.

        Without an axis of symmetry, or where any spin is as near, the pose is returned as it is.
        """
        if self.axis is None:
            return pose
        apart = reference[:3, :3].T @ pose[:3, :3]
        # The trace of `apart` times a rotation about the axis is largest at the least angle.
        across = np.trace(apart) - self.axis @ apart @ self.axis
        about = self.axis @ [apart[1, 2] - apart[2, 1], apart[2, 0] - apart[0, 2],
                             apart[0, 1] - apart[1, 0]]
        if math.hypot(across, about) < 1e-9:  # the axis is reversed
            return pose
        turn = rotations_about(self.axis, np.array([math.atan2(about, across)]))
        return np.asarray(pose @ turn[0])

    # distances

    def rotation_distance(self, poses: NDArray[np.float64], other: NDArray[np.float64]
                          ) -> NDArray[np.float64]:
        """(n,) least angle [rad] between the orientations of poses (n, 4, 4) and of one (4, 4).

        With an axis of symmetry: the angle between the axes.
        """
        return self._angle(self.nearest_equivalents(poses, other), other)

    def same_mode(self, poses: NDArray[np.float64], other: NDArray[np.float64], distance: float,
                  angle: float) -> NDArray[np.bool_]:
        """(n,) which poses (n, 4, 4) lie within `distance` [m] and `angle` [rad] of one (4, 4)."""
        nearest = self.nearest_equivalents(poses, other)
        near = np.linalg.norm(nearest[:, :3, 3] - other[:3, 3], axis=1) < distance
        return near & (self._angle(nearest, other) < angle)

    def _angle(self, poses: NDArray[np.float64], other: NDArray[np.float64]
               ) -> NDArray[np.float64]:
        """(n,) angle [rad] modulo rotations about the axis, not modulo the discrete group."""
        if self.axis is None:
            return rotation_angle(poses, other)
        cosine = (poses[:, :3, :3] @ self.axis) @ (other[:3, :3] @ self.axis)
        return np.arccos(np.clip(cosine, -1, 1))

    # the tangent space

    def local(self, poses: NDArray[np.float64], mean: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 6) tangent vectors from `mean`, (4, 4) or (n, 4, 4), to poses (n, 4, 4).

        `se3.retract` goes back. With an axis of symmetry the rotation is the smallest that brings
        one axis to the other: it has no component about the axis of `mean`.
        """
        if self.axis is None:
            return local(poses, mean)
        first, last = mean[..., :3, :3] @ self.axis, poses[:, :3, :3] @ self.axis
        cosine = last @ first if mean.ndim == 2 else (last * first).sum(axis=1)
        turn = np.cross(first, last)
        sine = np.linalg.norm(turn, axis=1, keepdims=True)
        turn = turn / np.maximum(sine, 1e-12) * np.arctan2(sine, cosine[:, None])
        reversed_ = (sine[:, 0] < 1e-12) & (cosine < 0)
        if reversed_.any():  # half a turn about any axis across
            across = np.cross(first, np.eye(3)[np.abs(first).argmin(axis=-1)])
            across = np.pi * across / np.linalg.norm(across, axis=-1, keepdims=True)
            turn[reversed_] = np.broadcast_to(across, turn.shape)[reversed_]
        return np.concatenate([poses[:, :3, 3] - mean[..., :3, 3], turn], axis=1)

    def tangent_basis(self, mean: NDArray[np.float64]) -> NDArray[np.float64]:
        """(6, d) orthonormal columns that span the tangent vectors at a pose (4, 4).

        d is 6, or 5 with an axis of symmetry: the rotation about it is left out.
        """
        if self.axis is None:
            return np.eye(6)
        across = np.linalg.svd((mean[:3, :3] @ self.axis)[None])[2][1:]
        basis = np.zeros((6, 5))
        basis[:3, :3], basis[3:, 3:] = np.eye(3), across.T
        return basis

    # statistics

    def mean_pose(self, poses: NDArray[np.float64],
                  weights: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """(4, 4) mean of poses (n, 4, 4) of one mode, already the nearest equivalents.

        weights: (n,) of sum 1, by default equal. The mean rotation is the chordal mean; with an
        axis of symmetry only the axes are averaged (the mean of arbitrary spins would tilt them),
        and the spin is canonical.
        """
        weights = np.full(len(poses), 1 / len(poses)) if weights is None else weights
        place = weights @ poses[:, :3, 3]
        if self.axis is None:
            return pose_of(Rotation.from_matrix(poses[:, :3, :3]).mean(weights), place)
        direction = weights @ (poses[:, :3, :3] @ self.axis)
        turn = poses[int(weights.argmax()), :3, :3]
        swing = least_turn(turn @ self.axis, direction)
        return self.canonical_spin(pose_of(swing.as_matrix() @ turn, place))

    def covariance(self, poses: NDArray[np.float64], mean: NDArray[np.float64],
                   weights: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """(6, 6) covariance of poses (n, 4, 4) about a mean (4, 4) [m^2, rad^2].

        weights: (n,) of sum 1, by default equal. The variance about an axis of symmetry is
        pi^2 / 3.
        """
        weights = np.full(len(poses), 1 / len(poses)) if weights is None else weights
        deviations = self.local(poses, mean)
        result = (deviations * weights[:, None]).T @ deviations
        if self.axis is not None:
            direction = mean[:3, :3] @ self.axis
            result[3:, 3:] += FREE_AXIS_VARIANCE * np.outer(direction, direction)
        return (result + result.T) / 2

    def credible_level(self, pose: NDArray[np.float64], mean: NDArray[np.float64],
                       covariance: NDArray[np.float64], degrees_of_freedom: float = math.inf
                       ) -> float:
        """Level (0 to 1) of the smallest credible region of an estimate that holds `pose` (4, 4).

        mean, covariance: (4, 4) and (6, 6) of the estimate. degrees_of_freedom: of the Student's
        t with the same 90 % region as the Gaussian with that covariance (`student_t`); inf: of
        that Gaussian.

        The region is an ellipsoid in the tangent space at the mean, which has 5 dimensions with an
        axis of symmetry, else 6. A pose is in the 90 % region where the level is 0.9 at most. The
        levels of the truth over trials of a calibrated estimate are uniform.
        """
        basis = self.tangent_basis(mean)
        nearest = self.nearest_equivalents(pose[None], mean)
        deviation = basis.T @ self.local(nearest, mean)[0]
        spread = basis.T @ covariance @ basis
        # Metres and radians differ in size: the variances are scaled to 1 first.
        scale = 1 / np.sqrt(np.maximum(np.diag(spread), 1e-30))
        correlation = spread * np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
        distance = (deviation * scale) @ np.linalg.solve(correlation, deviation * scale)
        return float(student_t.credible_level(distance, basis.shape[1], degrees_of_freedom))


def symmetry_group(given: Sequence[Sequence[float]], axis: NDArray[np.float64] | None,
                   scale: float, reach: float, name: str) -> NDArray[np.float64]:
    """(k, 4, 4) the group [m] that 4x4 matrices generate, the identity first.

    given: 16 numbers of each, row by row (BOP, models_info.json); translations in units of the
        mesh, which are `scale` metres. axis: of the continuous symmetry, or None. reach: largest
        distance of a point of the object from its origin [m].
    Raises ObjectModelError when a matrix is no rigid motion that can map the object to itself, or
    the group has more than 128 elements.
    """
    motions = [_rigid(each, scale, reach, name) for each in given]
    if axis is not None:
        return _beside_axis(motions, axis, reach, name)
    group = [np.eye(4)]
    for element in group:  # the list grows
        for motion in motions:
            product = element @ motion
            apart = rotation_angle(np.stack(group), product)
            if apart.min() < _ROUNDED:
                _check_shift(group[int(apart.argmin())], product, reach, name)
                continue
            group.append(product)
            if len(group) > _MOST or apart.min() < _APART:
                raise ObjectModelError(
                    f'object {name!r}: its {len(given)} discrete symmetries, one after the other, '
                    f'make no group of at most {_MOST} rotations: {len(group)} of them are '
                    f'{apart.min():.3f} rad apart; give their matrices with more digits')
    return np.stack(group)


def _beside_axis(motions: Sequence[NDArray[np.float64]], axis: NDArray[np.float64], reach: float,
                 name: str) -> NDArray[np.float64]:
    """(1 or 2, 4, 4) the identity and, if given, a motion that reverses the axis."""
    group = [np.eye(4)]
    for motion in motions:
        turned = motion[:3, :3] @ axis
        aside = np.linalg.norm(np.cross(motion[:3, 3], axis))
        if np.linalg.norm(np.cross(turned, axis)) > _APART or aside > 0.01 * reach:
            raise ObjectModelError(
                f'object {name!r}: with the axis of symmetry {axis.tolist()} a discrete symmetry '
                f'can only reverse that axis, but {motion.tolist()} tilts or shifts it')
        if turned @ axis > 0:
            _check_shift(group[0], motion, reach, name)
        elif len(group) == 1:
            group.append(motion)
        else:
            _check_shift(group[1], motion, reach, name)
    return np.stack(group)


def _check_shift(known: NDArray[np.float64], motion: NDArray[np.float64], reach: float, name: str
                 ) -> None:
    """Raise ObjectModelError when motions (4, 4) of one rotation differ in translation."""
    shift = float(np.linalg.norm(known[:3, 3] - motion[:3, 3]))
    if shift > 0.05 * reach:
        raise ObjectModelError(
            f'object {name!r}: its discrete symmetries, one after the other, shift it by '
            f'{shift:.4g} m and leave it as it is otherwise: correct their translations, which '
            'are in units of the mesh')


def _rigid(numbers: Sequence[float], scale: float, reach: float, name: str
           ) -> NDArray[np.float64]:
    motion = np.array(numbers, float).reshape(4, 4)
    turn = motion[:3, :3]
    # Of larger numbers, products would overflow.
    if (np.abs(motion).max() > _FAR or np.abs(turn @ turn.T - np.eye(3)).max() > _RIGID
            or np.linalg.det(turn) < 0 or not np.allclose(motion[3], [0, 0, 0, 1], atol=1e-6)):
        raise ObjectModelError(
            f'object {name!r}: the discrete symmetry {motion.tolist()} must be a rotation '
            '(orthonormal within 0.001, not mirrored) and a translation, its last row 0 0 0 1')
    motion[:3, :3] = Rotation.from_matrix(turn).as_matrix()  # the nearest rotation
    motion[:3, 3] *= scale
    shift = float(np.linalg.norm(motion[:3, 3]))
    if shift > 2.1 * reach:
        raise ObjectModelError(
            f'object {name!r}: a discrete symmetry shifts its origin by {shift:.4g} m, but no '
            f'point of it is farther than {reach:.4g} m from there; translations are in units of '
            'the mesh')
    return motion
