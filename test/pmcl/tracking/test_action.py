"""The action models are exact on motion without noise, and say how unsure they are."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pmcl_scenes import pose_of, random_poses
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.tracking.action import ActionModel, State
from pmcl_ros.runtime.errors import LocalizationError

NONE, ROUND = Symmetry(), Symmetry(np.array([0, 0, 1.0]))
SECOND = 10 ** 9
SEEDS = st.integers(0, 10_000)


def exact(model):
    return ActionModel(model, 0.0, 0.0, 0.1)


def moving(rng, turns_about=None):
    """A function of time: the pose of an object of constant velocity."""
    start = random_poses(1, int(rng.integers(1000)))[0]
    speed, turn = rng.normal(0, 0.05, 3), rng.normal(0, 0.5, 3)

    def at(time):
        rotation = Rotation.from_rotvec(turn * time) * Rotation.from_matrix(start[:3, :3])
        return pose_of(rotation, start[:3, 3] + speed * time)
    return at


@given(SEEDS)
@settings(deadline=None, max_examples=30)
def test_constant_velocity_goes_on_as_it_went(seed):
    rng = np.random.default_rng(seed)
    at, (first, second, third) = moving(rng), np.cumsum(rng.uniform(0.05, 1, 3))
    before = State.at_rest(round(first * SECOND), np.tile(at(first), (3, 1, 1)), None)
    model = exact('constant_velocity')
    now = model.update(before, round(second * SECOND), np.tile(at(second), (3, 1, 1)), None, NONE,
                       rng)
    after = model.predict(now, round(third * SECOND), None, rng)
    np.testing.assert_allclose(after.poses, np.tile(at(third), (3, 1, 1)), atol=1e-7)


@given(SEEDS)
@settings(deadline=None, max_examples=30)
def test_a_spin_about_the_axis_of_symmetry_is_no_velocity(seed):
    rng = np.random.default_rng(seed)
    first, second = random_poses(2, seed)
    spun = second.copy()
    spun[:3, :3] = spun[:3, :3] @ Rotation.from_rotvec([0, 0, rng.uniform(0, 6)]).as_matrix()
    before = State.at_rest(0, first[None], None)
    model = exact('constant_velocity')
    plain, turned = (model.update(before, SECOND, each[None], None, ROUND, rng)
                     for each in (second, spun))
    np.testing.assert_allclose(plain.velocities, turned.velocities, atol=1e-9)
    expected = ROUND.local(second[None], first)
    np.testing.assert_allclose(plain.velocities, expected, atol=1e-9)


@given(SEEDS)
@settings(deadline=None, max_examples=30)
def test_an_object_that_rests_is_where_the_camera_s_motion_puts_it(seed):
    rng = np.random.default_rng(seed)
    world, first, second = random_poses(3, seed)
    before = State.at_rest(0, (np.linalg.inv(first) @ world)[None], first)
    after = exact('camera').predict(before, SECOND, second, rng)
    np.testing.assert_allclose(after.poses[0], np.linalg.inv(second) @ world, atol=1e-9)
    np.testing.assert_array_equal(after.camera, second)


def test_a_constant_pose_stays():
    before = State.at_rest(0, random_poses(5, 1), None)
    after = exact('constant_pose').predict(before, SECOND, None, np.random.default_rng(0))
    np.testing.assert_allclose(after.poses, before.poses, atol=1e-12)


@pytest.mark.parametrize('model', ['constant_pose', 'constant_velocity', 'camera'])
def test_what_is_left_open_grows_as_the_root_of_time(model):
    action = ActionModel(model, 0.01, 0.05, 0.1)
    state = State.at_rest(0, np.tile(random_poses(1, 3), (20_000, 1, 1)), np.eye(4))
    for periods in (1, 4):
        after = action.predict(state, periods * SECOND // 10, np.eye(4),
                                 np.random.default_rng(periods))
        off = NONE.local(after.poses, state.poses[0])
        np.testing.assert_allclose(off[:, :3].std(axis=0), 0.01 * periods ** 0.5, rtol=0.03)
        np.testing.assert_allclose(off[:, 3:].std(axis=0), 0.05 * periods ** 0.5, rtol=0.03)


@pytest.mark.parametrize('stamp', [5, 4])
def test_a_capture_that_is_not_newer_cannot_follow(stamp):
    state = State.at_rest(5, random_poses(2, 0), None)
    with pytest.raises(LocalizationError, match=f'capture at {stamp} cannot follow one at 5'):
        exact('constant_pose').predict(state, stamp, None, np.random.default_rng(0))


@pytest.mark.parametrize(('then', 'now'), [(None, np.eye(4)), (np.eye(4), None)])
def test_the_camera_s_motion_needs_its_pose_at_both_times(then, now):
    state = State.at_rest(0, random_poses(2, 0), then)
    with pytest.raises(LocalizationError, match='pose of the camera is not known'):
        exact('camera').predict(state, 1, now, np.random.default_rng(0))


def test_velocities_are_those_that_a_kalman_filter_would_know():
    # Where poses are unsure, what they did before tells more of the velocity than they do.
    rng, count = np.random.default_rng(1), 600
    place, speed, open_, time = 0.015, 0.04, 0.01, 0.1  # m, m/s, m, s
    model = ActionModel('constant_velocity', open_, 1.0, time)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 0, 3] = rng.normal(0, place, count)
    velocities = np.zeros((count, 6))
    velocities[:, 0] = rng.normal(0.1, speed, count)
    now = np.tile(np.eye(4), (count, 1, 1))
    now[:, 0, 3] = 0.03
    found = model.update(State(0, poses, velocities, None), SECOND // 10, now, None, NONE, rng)
    # Where it was then, if it is here now: a product of Gaussians.
    step = (speed * time) ** 2 + open_ ** 2
    was, spread = (np.array([0.03 - 0.1 * time, 0]) @ [1 / step, 1 / place ** 2]
                   / (1 / step + 1 / place ** 2), (1 / step + 1 / place ** 2) ** -0.5)
    assert found.velocities[:, 0].mean() == pytest.approx((0.03 - was) / time, abs=0.02)
    assert found.velocities[:, 0].std() == pytest.approx(spread / time, rel=0.15)
    np.testing.assert_allclose(found.velocities[:, 1:], 0, atol=1e-9)


@pytest.mark.parametrize('model', ['constant_pose', 'camera'])
def test_other_models_know_no_velocity(model):
    poses, camera = random_poses(4, 2), np.eye(4)
    before = State.at_rest(0, poses[:2], None)
    state = exact(model).update(before, SECOND, poses[2:], camera, NONE, np.random.default_rng(0))
    np.testing.assert_array_equal(state.poses, poses[2:])
    assert state.camera is camera
    assert not state.velocities.any()


def test_many_particles_have_few_ancestors():
    # Each of 10000 may be asked for; all pairs of them would not fit into memory.
    rng = np.random.default_rng(0)
    before = State.at_rest(0, np.tile(random_poses(1, 3), (10_000, 1, 1)), None)
    poses = before.poses.copy()
    poses[:, 0, 3] += 0.05
    state = exact('constant_velocity').update(before, SECOND, poses, None, ROUND, rng)
    np.testing.assert_allclose(state.velocities, np.tile([0.05, 0, 0, 0, 0, 0], (10_000, 1)),
                               atol=1e-9)
