"""Solids in each other are moved apart, by as little as their covariances allow."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pmcl_scenes import model_of, pose_of
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.multi_object.penetration import (
    MAX_PENETRATION,
    PlacedSolid,
    Solid,
    deepest_penetration,
    resolve_penetration,
)

BALL = Solid.from_model(model_of(trimesh.creation.icosphere(4, 0.03)))
BOX = Solid.from_model(model_of(trimesh.creation.box((0.04, 0.06, 0.1))))
SURE = np.diag([1e-8, 1e-8, 1e-8, 1e-6, 1e-6, 1e-6])
DEEP = np.diag([1e-8, 1e-8, 25e-6, 1e-6, 1e-6, 1e-6])  # 5 mm along the line of sight


def at(x, y, z):
    return pose_of(Rotation.identity(), [x, y, z])


def test_the_less_sure_one_moves_and_along_the_way_it_is_unsure_of():
    things = [PlacedSolid(BALL, at(0.01, 0, 0.5), SURE), PlacedSolid(BALL, at(0, 0, 0.55), DEEP)]
    found = resolve_penetration(things)
    assert found.depth <= MAX_PENETRATION
    first, second = np.abs(found.deviations[:, :3])
    assert second[2] > 20 * first.max()
    assert second[2] > 20 * second[:2].max()
    assert found.cost == pytest.approx(0.5 * (second[2] / 0.005) ** 2, rel=0.05)


def test_what_is_apart_stays_and_what_costs_too_much_is_given_up():
    far = [PlacedSolid(BALL, at(0, 0, 0.5), SURE), PlacedSolid(BALL, at(0.07, 0, 0.5), SURE)]
    found = resolve_penetration(far)
    assert not found.deviations.any()
    assert found.cost == 0
    assert deepest_penetration([(each.solid, each.pose) for each in far]) <= 0
    same = [PlacedSolid(BALL, at(0, 0, 0.5), SURE), PlacedSolid(BALL, at(0.01, 0, 0.5), SURE)]
    given_up = resolve_penetration(same, most=10.0)
    assert given_up.cost > 10
    assert resolve_penetration([]).depth == -np.inf


@settings(max_examples=8, deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=12, max_size=12))
def test_any_three_are_apart_in_the_end(numbers):
    spots = np.array(numbers[:9]).reshape(3, 3) * 0.03 + [0, 0, 0.5]
    spots += [[0, 0, 0], [0.05, 0, 0], [0, 0.06, 0]]
    turn = Rotation.from_rotvec(numbers[9:])
    wide = np.diag([1e-4] * 3 + [1e-2] * 3)
    things = [PlacedSolid(solid, pose_of(turn, spot), wide)
              for solid, spot in zip((BALL, BOX, BALL), spots, strict=True)]
    found = resolve_penetration(things)
    after = [(each.solid, retract(each.pose, off[None])[0])
             for each, off in zip(things, found.deviations, strict=True)]
    depth = deepest_penetration(after)
    assert depth == pytest.approx(max(found.depth, depth))
    assert found.depth <= MAX_PENETRATION
