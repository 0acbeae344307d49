"""What leaves an object as it is: turns about an axis, and a group of rigid motions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.pmcl.summary import canonical, rotation_distance
from pmcl_ros.runtime.errors import ObjectModelError

_MOST = 128  # elements of a group: the icosahedron's has 60
_SAME, _APART = 0.005, 0.04  # rad: what is closer is rounding; elements of a group are farther
_RIGID = 1e-3  # of a rotation matrix's products
# Upright and facing the camera, but askew: poses that stand or lie as things do are not half way
# between two representatives, where noise would decide.
_ASKEW = Rotation.from_rotvec([0.25, 0.15, 0.35])
_UP = _ASKEW.apply([0.0, -1.0, 0.0])
_UPRIGHT = _ASKEW.as_matrix() @ np.array([[0, 1.0, 0], [0, 0, -1], [-1, 0, 0]])


@dataclass(frozen=True, eq=False)
class Symmetry:
    """Poses T and T S show an object alike, for each S of its symmetries.

    axis: (3,) unit vector through the origin about which any turn is one, or None.
    discrete: (k, 4, 4) a group of rigid motions in the object's frame [m], the identity first;
        with an axis one or two: what else there is can only turn the axis round.
    """

    axis: NDArray[np.float64] | None
    discrete: NDArray[np.float64]

    def alike(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k, 4, 4) the poses that the group makes of one (4, 4), itself first."""
        return pose @ self.discrete

    def folded(self, poses: NDArray[np.float64], reference: NDArray[np.float64]
               ) -> NDArray[np.float64]:
        """Of each of poses (n, 4, 4) the one alike that is turned least from `reference` (4, 4).

        Turns about the axis are not undone: what looks at poses by the axis does not see them.
        """
        if len(self.discrete) == 1:
            return poses
        alike = poses[:, None] @ self.discrete
        angles = rotation_distance(alike.reshape(-1, 4, 4), reference, self.axis)
        nearest = angles.reshape(alike.shape[:2]).argmin(axis=1)
        return np.asarray(alike[np.arange(len(poses)), nearest])

    def canonical(self, alike: NDArray[np.float64]) -> NDArray[np.float64]:
        """The one of poses (k, 4, 4), all alike, that stands for them, whichever was first.

        The axis points up in the image, or, without an axis, x to the camera and z up, as far as
        can be (but for the askew); then as `summary.canonical`.
        """
        if self.axis is not None:
            rank = (alike[:, :3, :3] @ self.axis) @ _UP
        else:
            rank = np.einsum('nij,ij->n', alike[:, :3, :3], _UPRIGHT)
        return canonical(alike[int(rank.argmax())], self.axis)

    @property
    def about_origin(self) -> NDArray[np.float64]:
        """(m, 3, 3) the rotations of the group that keep the origin in place (1 um)."""
        fixed = np.linalg.norm(self.discrete[:, :3, 3], axis=1) < 1e-6
        return self.discrete[fixed, :3, :3]


def generated(given: Sequence[Sequence[float]], axis: NDArray[np.float64] | None, scale: float,
              reach: float, name: str) -> NDArray[np.float64]:
    """(k, 4, 4) the group [m] that 4x4 matrices generate, the identity first.

    given: each 16 numbers, row by row (BOP, models_info.json); translations in units of the mesh,
        which are `scale` metres. axis: of a continuous symmetry. reach: no point of the object is
        farther from the origin [m].
    Raises ObjectModelError when one is no rigid motion of the object, or they generate no small
    group.
    """
    motions = [_rigid(each, scale, reach, name) for each in given]
    if axis is not None:
        return _beside_axis(motions, axis, reach, name)
    group = [np.eye(4)]
    for element in group:  # which grows
        for motion in motions:
            product = element @ motion
            apart = rotation_distance(np.stack(group), product, None)
            if apart.min() < _SAME:
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
    """The identity and, if there is one, what turns an axis of symmetry round."""
    group = [np.eye(4)]
    for motion in motions:
        turned = motion[:3, :3] @ axis
        aside = np.linalg.norm(np.cross(motion[:3, 3], axis))
        if np.linalg.norm(np.cross(turned, axis)) > _APART or aside > 0.01 * reach:
            raise ObjectModelError(
                f'object {name!r}: with the axis of symmetry {axis.tolist()} a discrete symmetry '
                f'can only turn that axis round, but {motion.tolist()} takes it elsewhere')
        if turned @ axis > 0:
            _check_shift(group[0], motion, reach, name)
        elif len(group) == 1:
            group.append(motion)
        else:
            _check_shift(group[1], motion, reach, name)
    return np.stack(group)


def _check_shift(known: NDArray[np.float64], motion: NDArray[np.float64], reach: float, name: str
                 ) -> None:
    """Raise ObjectModelError if motions (4, 4) that turn alike do not shift alike."""
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
    if (np.abs(turn @ turn.T - np.eye(3)).max() > _RIGID or np.linalg.det(turn) < 0
            or not np.allclose(motion[3], [0, 0, 0, 1], atol=1e-6)):
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
