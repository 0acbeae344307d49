"""Modes: limits for the same pose, suppression of duplicates, ambiguous poses, copies."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import least_turn, pose_of
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.estimate import PoseEstimate, PoseMode
from pmcl_ros.pmcl.object_model import ObjectModel

# Limits of translation [m] and rotation [rad] for `Symmetry.same_mode`, the only ones there are.
# Maxima of the evidence that are closer merge under refinement.
SAME_MODE = 0.01, 0.15
# Particles of one mode: a mode's posterior is as wide as this.
MODE_EXTENT = 0.02, 0.25
# Proposals: as far as the templates' steps are apart (7.5 degrees, 3 % of depth).
SAME_PROPOSAL = 0.012, 0.2
# Candidates of several objects, which are refined: closer ones differ by noise.
SAME_CANDIDATE = 0.005, 0.1
_AS_EVIDENT = 0.8  # of the evidence of the estimate: a copy has it, a chance likeness seldom


def suppress_duplicates(poses: NDArray[np.float64], symmetry: Symmetry, count: int,
                        limits: tuple[float, float] = SAME_MODE) -> list[int]:
    """Non-maximum suppression: which of poses (n, 4, 4), best first, to keep; `count` at most.

    A pose is dropped when it, or an equivalent one, is within `limits` [m, rad] of one kept.
    """
    places = KDTree(poses[:, :3, 3])
    # Farther apart than this, a cheap test says that poses differ: equivalents move the origin.
    reach = limits[0] + 1.01 * np.linalg.norm(symmetry.discrete[:, :3, 3], axis=1).max()
    free = np.ones(len(poses), bool)
    kept: list[int] = []
    while len(kept) < count and free.any():
        best = int(free.argmax())
        kept.append(best)
        near = np.array(places.query_ball_point(poses[best, :3, 3], reach))
        near = near[free[near]]
        free[near] = ~symmetry.same_mode(poses[near], poses[best], *limits)
        free[best] = False
    return kept


def ambiguous_poses(model: ObjectModel, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 4, 4) poses that a pose (4, 4) could be mistaken for, the middle of the mesh in place.

    With an axis of symmetry: the object upside down, and both of these with the axis tilted away
    from the camera instead of towards it, which from afar gives nearly the same outline. Without:
    half turns about the mesh's axes, and about the line of sight. Poses that are equivalent to
    `pose` or an earlier one by a discrete symmetry are left out.
    """
    middle = (model.vertices.min(axis=0) + model.vertices.max(axis=0)) / 2
    rotation = pose[:3, :3]
    centre = rotation @ middle + pose[:3, 3]
    sight = centre / np.linalg.norm(centre)
    if model.axis is None:
        turned = [rotation @ Rotation.from_rotvec(np.pi * each).as_matrix() for each in np.eye(3)]
        turned.append(Rotation.from_rotvec(np.pi * sight).as_matrix() @ rotation)
    else:
        axis = rotation @ model.axis
        away = axis - 2 * (axis @ sight) * sight
        turned = [least_turn(axis, each).as_matrix() @ rotation
                  for each in (-axis, away, -away)]
    result = pose_of(np.array(turned), centre - np.array(turned) @ middle)
    return _drop_equivalents(model.symmetry, pose, result)


def _drop_equivalents(symmetry: Symmetry, pose: NDArray[np.float64], found: NDArray[np.float64]
                      ) -> NDArray[np.float64]:
    """(k, 4, 4) poses `found` that are not equivalent to `pose` (4, 4) or an earlier one."""
    kept, spin = [pose], Symmetry(symmetry.axis)
    for each in found:
        images = symmetry.equivalents(each)[1:]
        if not any(spin.same_mode(images, other, *SAME_MODE).any() for other in kept):
            kept.append(each)
    return np.array(kept[1:]).reshape(-1, 4, 4)


def copy_beside(model: ObjectModel, estimate: PoseEstimate) -> PoseMode | None:
    """The mode that may be another such object: nearly as evident, beside the one that is found.

    The weights of modes do not tell it: the evidence of two equal objects differs by many nats.
    None where there is none, or nothing is found.
    """
    low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
    middle, size = (low + high) / 2, np.median(high - low)
    found = estimate.pose[:3, :3] @ middle + estimate.pose[:3, 3]
    return next((each for each in estimate.modes[1:] if not estimate.lost
                 and each.score > _AS_EVIDENT * estimate.score
                 and np.linalg.norm(each.pose[:3, :3] @ middle + each.pose[:3, 3] - found) > size),
                None)
