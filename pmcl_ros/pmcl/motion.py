"""How particles start and how they move."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.pmcl.region import Region


def uniform_poses(region: Region, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(count, 4, 4) poses, origins uniform in the region, orientations uniform over SO(3)."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, 3] = np.array(region.center) + (rng.random((count, 3)) - 0.5) * region.size
    poses[:, :3, :3] = Rotation.random(count, rng).as_matrix()
    return poses


def perturb(poses: NDArray[np.float64], translation: NDArray[np.floating] | float,
            rotation: NDArray[np.floating] | float, rng: np.random.Generator
            ) -> NDArray[np.float64]:
    """Poses moved by zero-mean Gaussians in the six degrees of freedom.

    Paper, section V: the action model.
    translation: standard deviation along x, y, z of the camera's frame [m].
    rotation: about these axes through the object's origin [rad].
    """
    moved = poses.copy()
    moved[:, :3, 3] += rng.normal(size=(len(poses), 3)) * translation
    turn = Rotation.from_rotvec(rng.normal(size=(len(poses), 3)) * rotation)
    moved[:, :3, :3] = turn.as_matrix() @ poses[:, :3, :3]
    return moved
