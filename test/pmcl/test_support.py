from dataclasses import replace

import numpy as np
import pytest
from contour_maps import NUMBERS
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.support import contour_support, evidence_beyond, log_odds, share_in_view


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


@given(st.floats(0, 1), st.floats(0, 1))
def test_log_odds_of_a_share_of_particles(one, other):
    assert log_odds(one) == pytest.approx(-log_odds(1 - one), abs=1e-9)
    assert log_odds(min(one, other)) <= log_odds(max(one, other))
    assert log_odds(0.8) == pytest.approx(np.log(4), abs=0.02)
    # All of 192 particles in a mode tell no more than that the next one is likely in it.
    assert np.log(192) < log_odds(1.0) < np.log(2 * 192 + 20)


def test_noise_within_an_arc_is_averaged():
    evidence = np.where(np.arange(400) % 2, 2.0, -1.0)
    assert contour_support(contour(evidence), 1.0) == pytest.approx(0.5)
    points = replace(contour([1.0, -1.0]), lengths=np.array([3.0, 1.0]))
    assert contour_support(points, 1.0) == pytest.approx(0.5)


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
    # Half a pixel about the middle of the first and the last is theirs.
    for cx, share in ((9.4, 0.5), (9.6, 1), (10.4, 1), (10.6, 0.5)):
        assert share_in_view(model, pose, Pinhole(21, 100, 500, 500, cx, 50)) == share


MIDDLE, RADIUS = 80, 40  # px: of a disc that a contour map shows
DISC = Pinhole(160, 160, 200, 200, MIDDLE, MIDDLE)


@pytest.fixture(scope='module')
def disc_seen():
    """Log odds of 4 for its outline, of -4 where there is none."""
    y, x = np.indices((160, 160)) - MIDDLE
    away = np.maximum(np.hypot(x, y), 1e-9)
    on, nx, ny = np.exp(-0.2 * (away - RADIUS) ** 2), x / away, y / away
    tensor = np.stack([on - 4, 5 * on * nx, 5 * on * ny, 2 * on * (nx ** 2 - ny ** 2),
                       4 * on * nx * ny], axis=-1).astype(np.float32)
    return ContourMap(Header(), tensor[:, :, None], np.array([0.5, 0.3]), DISC,
                      np.zeros((160, 160, 1), np.float32), NUMBERS)


def circle(radius, outer=1.0):
    """The contour of a disc, a point for each pixel."""
    angles = np.linspace(0, 2 * np.pi, round(2 * np.pi * radius), endpoint=False)
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    plain = contour(np.zeros(len(angles)))
    return replace(plain, pixels=MIDDLE + radius * normals, normals=normals,
                   depths=np.full(len(angles), 0.4), outer=np.full(len(angles), outer))


def beyond(points, seen):
    return evidence_beyond(points, seen, seen.profile)


@pytest.mark.parametrize('radius', [27, 32, 35])
def test_a_larger_outline_is_seen_beyond_that_of_a_smaller_object(disc_seen, radius):
    np.testing.assert_allclose(beyond(circle(radius), disc_seen), 4 * NUMBERS.contour_weight,
                               rtol=0.15)


@pytest.mark.parametrize('radius', [
    20,  # too far inside to be mistaken for it
    RADIUS, RADIUS + 8])
def test_beyond_the_outline_itself_there_is_nothing(disc_seen, radius):
    assert not beyond(circle(radius), disc_seen).any()


def test_what_is_the_object_itself_is_not_beyond_it(disc_seen):
    inner, own = circle(32), circle(RADIUS)
    assert not beyond(replace(inner, outer=0 * inner.outer), disc_seen).any()
    assert not beyond(inner.joined(own), disc_seen).any()
    assert not len(beyond(contour([]), disc_seen))


def test_what_other_objects_show_and_what_is_out_of_the_image_is_not_beyond(disc_seen):
    inner, left = circle(32), np.zeros((160, 160), bool)
    left[:, :MIDDLE] = True  # another object's
    found = evidence_beyond(inner, disc_seen, disc_seen.profile, left)
    assert not found[inner.pixels[:, 0] < MIDDLE - 10].any()
    clear = inner.pixels[:, 0] > MIDDLE + 10
    np.testing.assert_array_equal(found[clear], beyond(inner, disc_seen)[clear])
    assert found[clear].all()
    cut = replace(disc_seen, tensor=disc_seen.tensor[:, :MIDDLE + RADIUS + 1],
                  inside=disc_seen.inside[:, :MIDDLE + RADIUS + 1],
                  pinhole=replace(DISC, width=MIDDLE + RADIUS + 1))
    # Its right border shows the disc's contour; from 116 px on all that is beyond is out of it.
    flat = replace(circle(3), pixels=np.column_stack([np.full(19, 117.0), np.arange(71.0, 90)]),
                   normals=np.tile([1.0, 0.0], (19, 1)))
    assert not beyond(flat, cut).any()
    assert beyond(replace(flat, pixels=flat.pixels - [2, 0]), cut).all()
