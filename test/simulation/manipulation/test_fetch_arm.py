"""The simulated arm's chain, its inverse kinematics, and times of its paths."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import rotation_angle
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.simulation.manipulation.fetch_arm import ARM, HOME, STEP, VELOCITIES, fetch_arm
from pmcl_ros.simulation.manipulation.inverse_kinematics import InverseKinematics, nearest_turn
from pmcl_ros.simulation.manipulation.physics import mujoco
from pmcl_ros.simulation.manipulation.trajectory import timed

LOW, HIGH = np.array([each.limits or (-np.pi, np.pi) for each in ARM]).T


@pytest.fixture(scope='module')
def arm():
    return InverseKinematics(GripperSettings())


def by_hand(joints):
    """The product of the joints' transforms."""
    turn, place = Rotation.identity(), np.zeros(3)
    for link, angle in zip(ARM, joints, strict=True):
        place = place + turn.apply(link.offset)
        turn = turn * Rotation.from_rotvec(angle * np.array(link.axis))
    return turn, place + turn.apply(GripperSettings().parent_to_grasp)


def test_forward_kinematics_are_the_product_of_the_joints_transforms(arm):
    for joints in np.random.default_rng(0).uniform(LOW, HIGH, (20, 7)):
        pose, (turn, place) = arm.forward(joints), by_hand(joints)
        assert pose[:3, 3] == pytest.approx(place, abs=1e-12)
        assert pose[:3, :3] == pytest.approx(turn.as_matrix(), abs=1e-12)


def test_inverse_kinematics_reach_what_the_arm_reached(arm):
    for joints in np.random.default_rng(1).uniform(LOW, HIGH, (20, 7)):
        tool = arm.forward(joints)
        found = arm.solutions(tool, HOME)
        assert found
        for each in found:
            pose = arm.forward(each)
            assert np.linalg.norm(pose[:3, 3] - tool[:3, 3]) < 1e-3
            assert rotation_angle(pose[None], tool)[0] < np.radians(0.5)
            limited = np.array([link.limits is not None for link in ARM])
            assert ((each >= LOW - 1e-6) & (each <= HIGH + 1e-6))[limited].all()
            assert (abs(each - HOME) <= np.pi)[~limited].all()
    far = np.eye(4)
    far[:3, 3] = 1.5, 0, 1
    assert arm.solutions(far, HOME) == []


def test_nearest_turn_is_the_same_posture(arm):
    rng = np.random.default_rng(2)
    joints, other = rng.uniform(LOW, HIGH, (2, 7))
    turned = nearest_turn(joints + np.array([0, 0, 1, 0, -2, 0, 3]) * 2 * np.pi, other)
    assert arm.forward(turned) == pytest.approx(arm.forward(joints), abs=1e-9)
    assert abs(turned - other).max() <= 2 * max(abs(LOW).max(), np.pi)


def test_the_arm_holds_still_at_home():
    mj = mujoco()
    model = fetch_arm(GripperSettings()).compile()
    data = mj.MjData(model)
    data.qpos[:7] = data.ctrl[:7] = HOME
    mj.mj_step(model, data, 500)
    assert data.ncon == 0
    assert data.qpos[:7] == pytest.approx(HOME, abs=1e-4)


def test_a_timed_path_keeps_to_limits_and_corners():
    rng = np.random.default_rng(3)
    corners = rng.uniform(-1, 1, (4, 7))
    dense = np.concatenate([a + (b - a) * np.linspace(0, 1, 30)[:, None]
                            for a, b in pairwise(corners)])
    postures = timed(dense, 0.5)
    speeds = abs(np.diff(postures, axis=0)) / STEP / VELOCITIES
    assert speeds.max() == pytest.approx(0.5, rel=0.01)
    assert postures[[0, -1]] == pytest.approx(corners[[0, -1]], abs=1e-12)
    for corner in corners:  # it stops there
        nearest = abs(postures - corner).max(axis=1).argmin()
        assert postures[nearest] == pytest.approx(corner, abs=1e-9)
        assert speeds[max(nearest - 2, 0):nearest + 1].max() < 0.01
