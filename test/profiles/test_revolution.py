from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import PINHOLE, camera
from scipy.spatial import cKDTree

from pmcl_ros.profiles.revolution import AXIS, ENDS


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


@pytest.mark.parametrize('number', [3, 20, 37, 40, 41, 42, 43, 44, 45, 46, 47])
def test_motion_is_the_derivative_of_the_contour(true_surface, number):
    of = np.zeros(len(true_surface.radii) + ENDS + AXIS)
    of[number] = 1e-3 if number >= len(of) - 2 else 1e-4
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


def test_radii_stay_positive(true_surface):
    thin = np.zeros(len(true_surface.radii) + ENDS + AXIS)
    thin[:len(true_surface.radii)] = -0.05
    thin[len(true_surface.radii) + 2:][:2] = 0.02  # edges wider than what is left
    surface = true_surface.moved(thin, 5e-4)
    assert surface.wall[:, 0].min() > 0
    assert (np.diff(surface.wall[:, 1]) > 0).all()
