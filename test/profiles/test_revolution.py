from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import PINHOLE, PLACE, camera, masks_of, solid
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pmcl_ros.profiles.revolution import AXIS, ENDS, Revolution


def test_contour_is_the_outline_of_the_mesh(true_surface, masks):
    for mask, azimuth in zip(masks, (-0.5, 0.0, 0.5), strict=True):
        outline = np.concatenate([each[:, 0] for each in cv2.findContours(
            mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]])
        outline = (outline + 0.5) / 4 - 0.5  # px of the picture
        contour = true_surface.contour(PINHOLE, camera(azimuth))
        apart = cKDTree(outline).query(contour.pixels)[0]
        assert apart.max() < 0.5
        assert cKDTree(contour.pixels).query(outline)[0].max() < 6  # no part is left out
        length = np.linalg.norm(np.diff(outline, axis=0), axis=1).sum()
        assert contour.lengths.sum() == pytest.approx(0.95 * length, rel=0.05)  # pixels zigzag


def test_an_edge_is_no_wider_than_the_foot(true_surface):
    radii = true_surface.radii.copy()
    radii[0] = 0.0005
    found = replace(true_surface, radii=radii).with_edges(np.array([0.003, 0.001]), 5e-4)
    assert found.edges == (0.00025, 0.001)
    assert found.wall[:, 0].min() >= 0
    assert true_surface.with_edges(np.array([0.003, 0.001]), 5e-4).edges == (0.003, 0.001)
    flat = replace(true_surface, low=0.0, high=0.008)
    assert flat.with_edges(np.array([0.003, 0.001]), 5e-4).edges == (0.002, 0.001)


@pytest.mark.parametrize('number', [3, 20, *range(-ENDS - AXIS - 3, 0)])
def test_motion_is_the_derivative_of_the_contour(true_surface, number):
    of = np.zeros(len(true_surface.radii) + ENDS + AXIS)
    of[number] = 1e-3 if number in {-2, -1} else 1e-4
    before = true_surface.contour(PINHOLE, camera(0.2))
    after = true_surface.moved(of, 1e-4).contour(PINHOLE, camera(0.2))
    apart, nearest = cKDTree(after.pixels).query(before.pixels)
    off = ((after.pixels[nearest] - before.pixels) * before.normals).sum(axis=1)
    expected = before.motion @ of
    close = apart < 0.7  # elsewhere the nearest point is too far along the contour
    assert close.mean() > 0.5
    assert abs(expected).max() > 0.02
    np.testing.assert_allclose(off[close], expected[close], atol=0.03)


def test_normals_point_outwards(true_surface):
    contour = true_surface.contour(PINHOLE, camera(0.0))
    middle = contour.pixels.mean(axis=0)
    assert (((contour.pixels - middle) * contour.normals).sum(axis=1) > 0).mean() > 0.95


@pytest.mark.parametrize('number', range(3, 24, 5))
def test_turns_are_those_of_the_wall_and_change_as_told(true_surface, number):
    heights = np.linspace(-0.05, 0.05, 60)
    cone = Revolution.from_curve(np.eye(4), heights, 0.03 + 0.2 * heights, 0.0025)
    np.testing.assert_allclose(cone.turns[0], 0, atol=1e-9)
    radii = true_surface.radii.copy()
    radii[number] += 1e-7
    turns, by = true_surface.turns
    after, _ = replace(true_surface, radii=radii).turns
    np.testing.assert_allclose((after - turns) / 1e-7, by[:, number], rtol=1e-3, atol=1e-2)


def test_knots_are_as_far_apart_on_a_flat_wall_as_on_a_steep_one():
    heights = np.array([0, 0.003, 0.006, 0.1])
    found = Revolution.from_curve(np.eye(4), heights, np.array([0.03, 0.03, 0.005, 0.005]), 0.0025)
    knots = 0.1 * np.array(found.breaks)
    assert np.diff(knots).max() == pytest.approx(0.0025, rel=0.02)
    assert (knots < 0.006).sum() > 28.2 / 2.5


def test_a_stem_is_seen_before_its_foot():
    """Those points are on the outline of the stem alone, and within that of the foot alone."""
    frame = np.eye(4)
    frame[:3, 3] = PLACE
    glass = Revolution.from_curve(frame, np.array([-0.05, -0.047, -0.046, -0.04, 0.05]),
                                  np.array([0.03, 0.027, 0.006, 0.004, 0.004]), 0.002)
    outline, contour = (replace(glass, on_foot=on_foot).contour(PINHOLE, camera(0.0)).pixels
                        for on_foot in (False, True))
    more = contour[cKDTree(outline).query(contour)[0] > 0]
    assert len(contour) == len(outline) + len(more)
    assert np.ptp(more[:, 1]) > 8
    wall = glass.wall
    foot, stem = masks_of(solid(wall[wall[:, 1] < -0.046]), [camera(0.0)]) + masks_of(
        solid(wall[wall[:, 1] > -0.0465]), [camera(0.0)])
    column, row = (np.rint((more + 0.5) * 4 - 0.5).astype(int)).T
    assert foot[row, column].all()
    edge = cv2.findContours(stem.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    edge = (np.concatenate(edge)[:, 0] + 0.5) / 4 - 0.5
    upper = more[:, 1] < more[:, 1].min() + 6  # px: below the stem gets wider, and more is seen
    assert upper.sum() > 4
    assert cKDTree(edge).query(more[upper])[0].max() < 0.5


def test_radii_stay_positive(true_surface):
    thin = np.zeros(len(true_surface.radii) + ENDS + AXIS)
    thin[:len(true_surface.radii)] = -0.05
    thin[len(true_surface.radii) + 2:][:2] = 0.02  # edges wider than what is left
    surface = true_surface.moved(thin, 5e-4)
    assert surface.wall[:, 0].min() > 0
    assert (np.diff(surface.wall[:, 1]) > 0).all()
    heights = np.linspace(-0.05, 0.05, 60)
    tip = Revolution.from_curve(np.eye(4), heights, np.maximum(heights, 0), 0.0025)
    assert tip.radii.min() > 0


def test_a_step_turns_the_axis_and_leaves_the_ends_where_they_would_change_places(true_surface):
    n = len(true_surface.radii)
    step = np.zeros(n + ENDS + AXIS)
    step[n], step[-2:] = 0.2, (0.3, -0.2)
    moved = true_surface.moved(step, 5e-4)
    assert (moved.low, moved.high) == (true_surface.low, true_surface.high)
    np.testing.assert_allclose(moved.frame[:3, :3], true_surface.frame[:3, :3]
                               @ Rotation.from_rotvec([0.3, -0.2, 0]).as_matrix(), atol=1e-12)
