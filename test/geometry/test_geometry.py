import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import ViewGrid, nominal_positions
from pmcl_ros.runtime.errors import LightFieldError

PINHOLE = Pinhole(40, 30, 200.0, 100.0, 19.5, 14.5)
POINTS = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.1, 9)).map(np.array)


def test_project_by_example():
    np.testing.assert_allclose(PINHOLE.project(np.array([[0.1, -0.2, 2], [0, 0, 5]])),
                               [[29.5, 4.5], [19.5, 14.5]])


@settings(deadline=None)
@given(POINTS)
def test_project_is_the_matrix(point):
    x, y, w = PINHOLE.matrix @ point
    np.testing.assert_allclose(PINHOLE.project(point), [x / w, y / w], atol=1e-9)


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


def test_positions_grow_with_column_and_row():
    np.testing.assert_array_equal(nominal_positions(3, 5)[..., 0], [[-2, -1, 0, 1, 2]] * 3)
    np.testing.assert_array_equal(nominal_positions(3, 5)[..., 1], [[-1] * 5, [0] * 5, [1] * 5])


def test_the_centre_is_where_the_position_is_zero():
    grid = ViewGrid(PINHOLE, 0.001, nominal_positions(3, 5), np.ones((3, 5), np.float32))
    assert (grid.shape, grid.centre) == ((3, 5), (1, 2))
    np.testing.assert_array_equal(grid.positions[grid.centre], [0, 0])


def grid_of(baseline=0.001, positions=None, weights=None):
    positions = nominal_positions(3, 3) if positions is None else positions
    return ViewGrid(PINHOLE, baseline, positions, np.ones((3, 3)) if weights is None else weights)


@pytest.mark.parametrize(('change', 'reason'), [
    ({'positions': nominal_positions(3, 5)}, r'\(3, 5, 2\) do not match weights \(3, 3\)'),
    ({'positions': np.zeros((3, 3, 3))}, 'do not match'),
    ({'weights': np.ones(9)}, 'do not match'),
    ({'weights': np.full((3, 3), np.nan)}, 'must be finite'),
    ({'weights': np.full((3, 3), -0.1)}, 'not negative'),
    ({'positions': np.full((3, 3, 2), np.inf)}, 'must be finite'),
    ({'baseline': 0}, 'baseline 0 m'),
    ({'baseline': -0.1}, 'must be positive'),
    ({'baseline': np.nan}, 'must be positive'),
])
def test_impossible_grids_are_refused(change, reason):
    with pytest.raises(LightFieldError, match=reason):
        grid_of(**change)
