from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.support import contour_support, share_in_view


def contour(evidence):
    """A closed contour of one point for each pixel."""
    count = len(evidence)
    return ContourPoints(np.zeros((count, 2)), np.zeros((count, 2)), np.ones(count),
                         np.ones(count), np.zeros((count, 1)), np.asarray(evidence, float),
                         np.zeros(count, np.int64), np.arange(count) + 0.5, np.ones(count))


def test_where_another_contour_fits_better_makes_up_for_nothing():
    assert contour_support(contour(np.repeat([1.0, -1.0], 200)), 1.0) == pytest.approx(-1)
    assert contour_support(contour(np.repeat([9.0, -1.0], 200)), 1.0) == pytest.approx(-1)
    assert contour_support(contour(np.repeat([9.0, -1.0], [360, 40])), 1.0) == pytest.approx(4)


def test_what_is_out_of_view_speaks_against_it():
    assert contour_support(contour(np.ones(100)), 0.5) == pytest.approx(0)
    assert contour_support(contour(np.ones(100)), 0.1) == pytest.approx(-8)
    assert contour_support(contour([]), 1.0) == contour_support(contour([1.0]), 0.0) == -np.inf


def test_noise_within_an_arc_is_averaged():
    evidence = np.where(np.arange(400) % 2, 2.0, -1.0)
    assert contour_support(contour(evidence), 1.0) == pytest.approx(0.5)


@given(hnp.arrays(float, st.integers(1, 300), elements=st.floats(-3, 3)), st.floats(0.5, 1))
def test_the_weakest_part_is_no_better_than_the_whole(evidence, seen):
    points = contour(evidence)
    support = contour_support(points, seen)
    assert evidence.min() - 1 - 1e-9 <= support <= evidence.mean() + 1e-9
    assert contour_support(replace(points, evidence=evidence + 1), seen) == pytest.approx(
        support + 1)


def test_half_a_mesh_out_of_view():
    vertices = np.array([[x, y, 0.0] for x in (-0.01, 0.01) for y in (-0.01, 0.01)])
    model = ObjectModel('square', vertices, np.array([[0, 1, 2]]), None, False)
    pose = np.eye(4)
    pose[2, 3] = 0.5
    assert share_in_view(model, pose, Pinhole(100, 100, 500, 500, 50, 50)) == 1
    assert share_in_view(model, pose, Pinhole(100, 100, 500, 500, 0, 50)) == 0.5
    assert share_in_view(model, pose, Pinhole(100, 100, 500, 500, 500, 50)) == 0
