"""BOP's errors against their definitions, word by word, and against what must hold of them."""

import tracemalloc

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pmcl_scenes import bracket, cup, model_of
from scipy.spatial.transform import Rotation

from pmcl_ros.evaluation.surface_errors import Surface
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.symmetry import Symmetry

PINHOLE = Pinhole(328, 328, 945.0, 945, 163.5, 163.5)
SEEDS = st.integers(0, 2 ** 31)
CUP = Surface.from_model(model_of(cup(), [0, 0, 1]))
BRACKET = Surface.from_model(model_of(bracket()))
# Half a turn about x, then about z: a box's group but for the identity and their product.
HALVES = np.stack([np.diag([1.0, 1, 1, 1]), np.diag([1.0, -1, -1, 1]), np.diag([-1.0, -1, 1, 1]),
                   np.diag([-1.0, 1, -1, 1])])
_BOX = Surface.from_model(model_of(trimesh.creation.box((0.05, 0.08, 0.12))))
BOX = Surface(_BOX.points, _BOX.corners, Symmetry(None, HALVES))
_ROD = Surface.from_model(model_of(trimesh.creation.cylinder(0.02, 0.1, sections=30)))
ROD = Surface(_ROD.points, _ROD.corners, Symmetry(np.array([0, 0, 1.0]), HALVES[:2]))
ALL = {'cup': CUP, 'bracket': BRACKET, 'box': BOX, 'rod': ROD}


def two_poses(seed, far=0.02, turn=0.4):
    """A truth, and a pose off by some distance and angle."""
    rng = np.random.default_rng(seed)
    truth, pose = np.eye(4), np.eye(4)
    truth[:3, :3] = Rotation.random(None, rng).as_matrix()
    truth[:3, 3] = rng.uniform([-0.05, -0.05, 0.4], [0.05, 0.05, 0.7])
    pose[:3, :3] = Rotation.from_rotvec(turn * rng.uniform(-1, 1, 3)).as_matrix() @ truth[:3, :3]
    pose[:3, 3] = truth[:3, 3] + far * rng.uniform(-1, 1, 3)
    return truth, pose


def turned(surface, angle):
    """(4, 4) a turn about the surface's axis, if it has one."""
    matrix = np.eye(4)
    if surface.symmetry.axis is not None:
        matrix[:3, :3] = Rotation.from_rotvec(angle * surface.symmetry.axis).as_matrix()
    return matrix


def defined(surface, pose, truth, place):
    """The least over all symmetries (315 steps) of the largest distance of two `place`s."""
    found = place(surface.points @ pose[:3, :3].T + pose[:3, 3])
    best = np.inf
    for step in range(315 if surface.symmetry.axis is not None else 1):
        for discrete in surface.symmetry.discrete:
            alike = truth @ discrete @ turned(surface, 2 * np.pi * step / 315)
            expected = place(surface.points @ alike[:3, :3].T + alike[:3, 3])
            best = min(best, np.linalg.norm(expected - found, axis=1).max())
    return best


@pytest.mark.parametrize('name', ALL)
@pytest.mark.parametrize('seed', range(4))
def test_mssd_and_mspd_are_those_of_bops_steps_or_a_little_less(name, seed):
    surface, (truth, pose) = ALL[name], two_poses(seed)
    reach = np.linalg.norm(surface.points, axis=1).max() * np.pi / 315 + 1e-9
    coarse = defined(surface, pose, truth, lambda points: points)
    assert coarse - reach * (surface.symmetry.axis is not None) <= surface.mssd(pose, truth)
    assert surface.mssd(pose, truth) <= coarse + 1e-12
    coarse = defined(surface, pose, truth, PINHOLE.project)
    slack = reach * PINHOLE.fx / 0.3 if surface.symmetry.axis is not None else 1e-9
    assert coarse - slack <= surface.mspd(pose, truth, PINHOLE) <= coarse + 1e-9


@pytest.mark.parametrize('seed', range(3))
def test_add_s_is_the_mean_distance_to_the_nearest_point(seed):
    truth, pose = two_poses(seed)
    found = BRACKET.points @ pose[:3, :3].T + pose[:3, 3]
    expected = BRACKET.points @ truth[:3, :3].T + truth[:3, 3]
    apart = np.linalg.norm(expected[:, None] - found[None], axis=-1)
    assert BRACKET.add_s(pose, truth) == pytest.approx(apart.min(axis=1).mean())


@settings(deadline=None, max_examples=15)
@given(SEEDS, st.floats(0, 7), st.integers(0, 1), st.sampled_from(sorted(ALL)))
def test_symmetries_of_the_object_change_nothing(seed, angle, which, name):
    surface, (truth, pose) = ALL[name], two_poses(seed)
    discrete = surface.symmetry.discrete
    alike = pose @ discrete[which % len(discrete)] @ turned(surface, angle)
    # The farthest point is another after a turn of a mesh with corners: a cup has 24 of them.
    assert surface.mssd(alike, truth) == pytest.approx(surface.mssd(pose, truth), abs=4e-4)
    assert surface.mssd(truth @ turned(surface, angle), truth) < 1e-6
    assert surface.mspd(truth @ turned(surface, angle), truth, PINHOLE) < 1e-3


@settings(deadline=None, max_examples=15)
@given(SEEDS, st.sampled_from(sorted(ALL)))
def test_at_the_truth_all_is_zero_and_elsewhere_mssd_is_above_add_s(seed, name):
    surface, (truth, pose) = ALL[name], two_poses(seed)
    assert surface.mssd(truth, truth) == pytest.approx(0, abs=1e-12)
    assert surface.mspd(truth, truth, PINHOLE) == pytest.approx(0, abs=1e-9)
    assert surface.add_s(truth, truth) == pytest.approx(0, abs=1e-12)
    if surface.symmetry.axis is None:  # otherwise the turned vertices are not those of the mesh
        assert surface.mssd(pose, truth) >= surface.add_s(pose, truth) - 1e-12
    assert surface.mssd(pose, truth) >= 0.9 * surface.add_s(pose, truth)


@settings(deadline=None, max_examples=15)
@given(SEEDS, st.floats(-0.05, 0.05), st.sampled_from(sorted(ALL)))
def test_a_shift_moves_the_whole_surface_by_as_much(seed, length, name):
    surface, (truth, _) = ALL[name], two_poses(seed)
    pose = truth.copy()
    pose[:3, 3] += length * np.array([0.6, 0, 0.8])
    assert surface.mssd(pose, truth) <= abs(length) + 1e-9
    if surface.symmetry.axis is None and len(surface.symmetry.discrete) == 1:
        assert surface.mssd(pose, truth) == pytest.approx(abs(length), abs=1e-9)


def test_diameter_and_what_cannot_be_projected():
    apart = np.linalg.norm(BRACKET.points[:, None] - BRACKET.points[None], axis=-1)
    assert BRACKET.diameter == pytest.approx(apart.max())
    truth, pose = two_poses(0)
    pose[2, 3] = -0.4
    assert np.isinf(CUP.mspd(pose, truth, PINHOLE))


def test_a_fine_mesh_takes_little_memory():
    """BOP's errors of 6,000 vertices at 315 turns, all at a time, would be hundreds of MB."""
    fine = model_of(trimesh.creation.uv_sphere(0.05, count=[80, 80]), [0, 0, 1])
    surface = Surface.from_model(fine)
    truth, pose = two_poses(1)
    tracemalloc.start()
    errors = surface.mssd(pose, truth), surface.mspd(pose, truth, PINHOLE), surface.diameter
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert np.isfinite(errors).all()
    assert errors[2] == pytest.approx(0.1, rel=1e-6)
    assert peak < 60e6
