"""The closed form against samples, another implementation, and a gripper that meets a mesh."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from pmcl_ros.geometry.se3 import point_covariance, remove_spin
from pmcl_ros.grasps.clearance import (
    Clearance,
    in_grasp_frame,
    rectangle_probability,
    surface_points,
)
from pmcl_ros.grasps.grasp import Grasp
from pmcl_ros.grasps.settings import GripperSettings

FETCH = GripperSettings()
ends = st.floats(-4, 4)


@settings(max_examples=60, deadline=None)
@given(st.tuples(ends, ends), st.tuples(ends, ends), st.floats(-0.999, 0.999))
def test_a_rectangle_holds_what_scipy_integrates(first, second, correlation):
    low, high = np.sort(np.array([first, second]), axis=1).T
    expected = multivariate_normal(cov=[[1, correlation], [correlation, 1]]).cdf(
        high, lower_limit=low)
    found = rectangle_probability(low, high, np.array(correlation))
    assert found == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize('correlation', [-1.0, -0.7, 0.0, 0.4, 0.99])
def test_a_rectangle_holds_what_samples_say(correlation):
    rng = np.random.default_rng(3)
    x, other = rng.normal(size=(2, 200_000))
    y = correlation * x + np.sqrt(1 - correlation ** 2) * other
    low, high = np.array([[-1.2, -0.4], [-0.3, -2.0]]), np.array([[0.9, 1.5], [2.0, 0.2]])
    found = rectangle_probability(low, high, np.full(2, correlation))
    for k in range(2):
        share = np.mean((low[k, 0] < x) & (x < high[k, 0]) & (low[k, 1] < y) & (y < high[k, 1]))
        assert found[k] == pytest.approx(share, abs=5 * np.sqrt(0.25 / len(x)))


def test_the_whole_plane_and_nothing():
    wide = np.full(2, np.inf)
    assert rectangle_probability(-wide, wide, np.array(0.5)) == pytest.approx(1)
    assert rectangle_probability(np.zeros(2), wide, np.array(0.5)) == pytest.approx(
        0.25 + np.arcsin(0.5) / (2 * np.pi))  # Sheppard's quadrant
    assert rectangle_probability(np.ones(2), -np.ones(2), np.array(0.0)) == 0


def physically_clear(grasp, samples, shifts, turns, origin, gripper=FETCH):
    """(n,) whether the open gripper meets no sample of an object that is moved, on all its way.

    shifts (n, 3) and rotation vectors (n, 3) about `origin`, in the object's frame.
    """
    clear = []
    boxes = gripper.boxes(grasp.opening)
    for shift, turn in zip(shifts, turns, strict=True):
        moved = Rotation.from_rotvec(turn).apply(samples - origin) + origin + shift
        seen = in_grasp_frame(grasp, moved)
        clear.append(not any(
            ((seen[:, 0] < high[0]) & (seen[:, 1:] > low[1:]).all(axis=1)
             & (seen[:, 1:] < high[1:]).all(axis=1)).any() for low, high in boxes))
    return np.array(clear)


@pytest.mark.parametrize('kind', ['side', 'top', 'rim'])
def test_a_gripper_clears_a_glass_as_often_as_told(made, vessels, rooms, mesh_of, kind):
    grasp, room = next(each for each in zip(made['cup'], rooms, strict=True)
                       if each[0].kind == kind)
    model, rng = vessels['cup'], np.random.default_rng(8)
    samples = trimesh.sample.sample_surface(mesh_of(model), 6000, seed=2)[0]
    # Broad where the fingers close, narrow along the approach: there it may also slip off, which
    # is no touch. Correlated, with a tilt, and with the free spin of a symmetric object.
    turn = grasp.pose[:3, :3]
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = turn @ np.array([[.003, 0, 0], [.003, .011, 0], [0, .001, .002]]) @ (
        turn @ np.array([[.003, 0, 0], [.003, .011, 0], [0, .001, .002]])).T
    covariance[3:, 3:] = np.diag([.02, .02, 0]) ** 2
    covariance[5, 5] = np.pi ** 2 / 3
    shift = point_covariance(remove_spin(covariance, model.axis), grasp.pose[:3, 3])
    told = float(room.probability(turn.T @ shift @ turn))
    draws = rng.multivariate_normal(np.zeros(6), covariance, size=700)
    share = physically_clear(grasp, samples, draws[:, :3], draws[:, 3:], np.zeros(3)).mean()
    noise = np.sqrt(share * (1 - share) / len(draws))
    assert 0.5 < share < 0.98
    assert told < share + 3 * noise  # never surer than it is
    assert told > share - 3 * noise - 0.02


@pytest.mark.parametrize('gripper', [FETCH, FETCH.model_copy(
    update={'palm_width': 0.03, 'palm_height': 0.01})], ids=['palm', 'narrow palm'])
def test_no_shift_in_a_rectangle_meets_a_point(gripper):
    """Of a wall between the fingers, and pegs anywhere about it."""
    rng, grasp, tried = np.random.default_rng(5), Grasp('', 'other', np.eye(4), 0.04, 0.1), 0
    for _ in range(100):
        points = np.concatenate([rng.uniform([0, -.02, -.05], [.1, .02, .05], (30, 3)),
                                 rng.uniform([-.03, -.12, -.07], [.1, .12, .07], (4, 3))])
        room = Clearance.from_points(grasp, points, gripper)
        assert -room.low[..., 1].min() <= gripper.finger_length
        strip, rectangle = np.nonzero((room.low < room.high).all(axis=-1))
        low, high = (
            np.concatenate([each[strip, rectangle][:, ::-1], ends[:, None]], axis=1)
            for each, ends in zip((room.low, room.high), room.strips[strip].T, strict=True))
        shifts = low + 0.999 * rng.random(low.shape) * (high - low)
        assert physically_clear(grasp, points, shifts, 0 * shifts, np.zeros(3), gripper).all()
        tried += len(shifts)
        mirrored = Clearance.from_points(grasp, points * [1, -1, 1], gripper)
        np.testing.assert_allclose(mirrored.low, np.stack(
            [-room.high[..., 0], room.low[..., 1]], axis=-1), atol=1e-12)
        np.testing.assert_allclose(mirrored.high[..., 1], room.high[..., 1], atol=1e-12)
    assert tried > 1000


def test_the_probability_is_the_share_of_shifts_in_the_rectangles():
    edges, rng = np.linspace(-.03, .03, 41), np.random.default_rng(6)
    aside = edges[:-1, None, None] * [0.5, -1]  # along y and x: with the shift along z
    low, high = np.array([[0, 0], [.006, .006]])
    room = Clearance(np.stack([edges[:-1], edges[1:]], axis=1), aside + low, aside + high)
    covariance = 2e-5 * np.array([[1, .1, -.8], [.1, .6, .7], [-.8, .7, 2]])
    x, y, z = rng.multivariate_normal(np.zeros(3), covariance, size=400_000).T
    strip = np.digitize(z, edges) - 1
    off = np.stack([y, x], axis=1) - aside[strip.clip(0, 39), 0]
    share = ((abs(z) < .03) & ((low < off) & (off < high)).all(axis=1)).mean()
    assert room.probability(covariance) == pytest.approx(share, abs=0.003)


def test_less_sure_poses_are_less_surely_clear(rooms):
    sigmas = np.array([1e-4, 2e-3, 5e-3, 1e-2, 3e-2])
    for room in rooms:
        told = room.probability(sigmas[:, None, None] ** 2 * np.eye(3))
        assert (np.diff(told) <= 0).all()
        assert told[0] == pytest.approx(1)
        assert told[-1] < 0.7


def test_shifts_inside_a_box_touch_nothing_and_beyond_it_they_do(made, vessels, rooms, mesh_of):
    model = vessels['cup']
    samples = np.concatenate([
        model.vertices, trimesh.sample.sample_surface(mesh_of(model), 12000, seed=4)[0]])
    for grasp, room in zip(made['cup'], rooms, strict=True):
        low, high = room.room
        assert room.least == min(*-low, *high)
        turn = grasp.pose[:3, :3]
        inside = np.array([[y, x, 0] for y in 0.97 * np.array([low[0], 0, high[0]])
                           for x in 0.97 * np.array([low[1], 0])])[:, [1, 0, 2]]
        none = np.zeros_like(inside)
        assert physically_clear(grasp, samples, inside @ turn.T, none, np.zeros(3)).all()
        beyond = np.array([[0, low[0] - 0.002, 0], [0, high[0] + 0.002, 0]])
        met = physically_clear(grasp, samples, beyond @ turn.T, none[:2], np.zeros(3))
        assert not met.any(), grasp.name


def test_a_grasp_that_holds_nothing_has_no_room(made, vessels):
    from dataclasses import replace
    grasp = made['cup'][0]
    pose = grasp.pose.copy()
    pose[:3, 3] -= 0.3 * grasp.approach
    room = Clearance.from_points(replace(grasp, pose=pose), surface_points(vessels['cup']), FETCH)
    assert room.least <= 0
    assert room.probability(1e-6 * np.eye(3)) == 0


def test_surface_points_are_dense_and_on_the_surface(vessels, mesh_of):
    mesh, points = mesh_of(vessels['goblet']), surface_points(vessels['goblet'])
    assert abs(trimesh.proximity.closest_point(mesh, points[::150])[1]).max() < 1e-9
    samples = trimesh.sample.sample_surface(mesh, 2000, seed=3)[0]
    from scipy.spatial import cKDTree
    assert cKDTree(points).query(samples)[0].max() < 0.003
