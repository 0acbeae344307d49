import numpy as np
import pytest
from pmcl_scenes import bracket, cup, model_of, random_poses

from pmcl_ros.geometry.se3 import rotation_angle
from pmcl_ros.pmcl.modes import ambiguous_poses

CUP = model_of(cup(), [0, 0, 1])
BRACKET = model_of(bracket())


@pytest.mark.parametrize('model', [CUP, BRACKET], ids=['symmetric', 'whole'])
@pytest.mark.parametrize('seed', range(6))
def test_rivals_are_rigid_and_keep_the_middle_in_place(model, seed):
    pose = random_poses(1, seed)[0]
    found = ambiguous_poses(model, pose)
    middle = (model.vertices.min(axis=0) + model.vertices.max(axis=0)) / 2
    turns = found[:, :3, :3]
    np.testing.assert_allclose(turns @ turns.swapaxes(1, 2),
                               np.tile(np.eye(3), (len(found), 1, 1)), atol=1e-7)
    np.testing.assert_allclose(np.linalg.det(turns), 1)
    np.testing.assert_allclose(turns @ middle + found[:, :3, 3],
                               np.tile(pose[:3, :3] @ middle + pose[:3, 3], (len(found), 1)),
                               atol=1e-9)
    assert (rotation_angle(found, pose) > 1e-3).all()


def test_an_axis_is_turned_upside_down_and_away():
    for pose in random_poses(20, 3):
        axes = ambiguous_poses(CUP, pose)[:, :3, :3] @ CUP.axis
        axis = pose[:3, :3] @ CUP.axis
        middle = pose[:3, 3]  # the cup's own
        sight = middle / np.linalg.norm(middle)
        np.testing.assert_allclose(axes[0], -axis, atol=1e-7)
        np.testing.assert_allclose(axes[2], -axes[1], atol=1e-7)
        # The tilt is mirrored: the part across the line of sight stays.
        np.testing.assert_allclose(axes[1] @ sight, -axis @ sight, atol=1e-7)
        np.testing.assert_allclose(np.cross(axes[1] + axis @ sight * sight,
                                            axis - axis @ sight * sight), 0, atol=1e-7)
