"""Pinhole cameras: projection, crops, other pixels, impossible values."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import LightFieldError

PINHOLE = Pinhole(40, 30, 200.0, 100.0, 19.5, 14.5)
POINTS = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.1, 9)).map(np.array)


def test_project_by_example():
    np.testing.assert_allclose(PINHOLE.project(np.array([[0.1, -0.2, 2], [0, 0, 5]])),
                               [[29.5, 4.5], [19.5, 14.5]])


@pytest.mark.parametrize(('cx', 'cy', 'off'), [
    (19.5, 14.5, 0), (-0.5, 14.5, 0.5), (19.5, 29.5, 0.5), (39.5, 8.5, 0.5), (29.5, 8.5, 0.25)])
def test_the_principal_point_is_as_far_off_as_the_picture_s_side_tells(cx, cy, off):
    assert Pinhole(40, 30, 200.0, 100.0, cx, cy).off_middle == off


@settings(deadline=None)
@given(POINTS)
def test_project_is_the_matrix(point):
    x, y, w = PINHOLE.matrix @ point
    np.testing.assert_allclose(PINHOLE.project(point), [x / w, y / w], atol=1e-9)


@settings(deadline=None)
@given(POINTS)
def test_the_ray_of_a_point_s_pixel_leads_to_it(point):
    np.testing.assert_allclose(point[2] * PINHOLE.rays(PINHOLE.project(point)), point, atol=1e-9)


@pytest.mark.parametrize('z', [0, -1, np.nan])
def test_what_is_not_in_front_has_no_pixel(z):
    found = PINHOLE.project(np.array([[[0.1, 0.2, z], [0.1, 0.2, 1]]]))
    assert found.shape == (1, 2, 2)
    assert np.isnan(found[0, 0]).all()
    assert np.isfinite(found[0, 1]).all()


@settings(deadline=None)
@given(POINTS, st.integers(-20, 20), st.integers(-20, 20))
def test_a_crop_sees_the_same_in_its_own_pixels(point, left, top):
    cropped = PINHOLE.crop(left, top, 7, 5)
    assert (cropped.width, cropped.height) == (7, 5)
    moved = PINHOLE.project(point) - np.array([left, top])
    np.testing.assert_allclose(cropped.project(point), moved, atol=1e-9)


@settings(deadline=None)
@given(POINTS, st.integers(1, 50))
def test_every_so_manyth_pixel_sees_what_it_saw(point, step):
    fewer = PINHOLE.subsample(step)
    assert (fewer.width, fewer.height) == (len(range(0, 40, step)), len(range(0, 30, step)))
    np.testing.assert_allclose(step * fewer.project(point), PINHOLE.project(point), atol=1e-9)


@settings(deadline=None)
@given(POINTS, st.integers(1, 200), st.integers(1, 200))
def test_other_pixels_see_the_same_part_of_the_image(point, width, height):
    resized = PINHOLE.resized(width, height)
    assert (resized.width, resized.height) == (width, height)
    # Places measured from the image's corner, in parts of its size.
    np.testing.assert_allclose((resized.project(point) + 0.5) / [width, height],
                               (PINHOLE.project(point) + 0.5) / [40, 30], atol=1e-9)


@pytest.mark.parametrize('values', [
    (0, 30, 200, 100, 0, 0), (40, -1, 200, 100, 0, 0), (40, 30, 0, 100, 0, 0),
    (40, 30, 200, -1, 0, 0), (40, 30, np.nan, 100, 0, 0), (40, 30, 200, 100, np.inf, 0),
    (40, 30, 200, 100, 0, np.nan)])
def test_impossible_cameras_are_refused(values):
    with pytest.raises(LightFieldError, match='impossible camera Pinhole'):
        Pinhole(*values)
