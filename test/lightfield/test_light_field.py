"""The values of light fields, and their integer encoding."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.colour import Colour
from pmcl_ros.lightfield.light_field import (
    VIEW_WHITE,
    LightField,
    ViewGrid,
    nominal_positions,
    views_of_mosaic,
)
from pmcl_ros.runtime.errors import LightFieldError

GRID = ViewGrid(Pinhole(5, 4, 10, 10, 2, 1.5), 0.001, nominal_positions(1, 3), np.ones((1, 3)))
SHAPE = (1, 3, 4, 5, 3)


@pytest.mark.parametrize('shape', [(3, 1, 4, 5, 3), (1, 3, 5, 4, 3), (1, 3, 4, 5), (3, 4, 5, 3)])
def test_views_of_another_shape_are_refused(shape):
    with pytest.raises(LightFieldError, match=r'the grid says \(1, 3, 4, 5, 3\)'):
        LightField(Header(), np.zeros(shape, np.float32), GRID)


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
def test_views_that_are_not_finite_are_refused(value):
    views = np.zeros(SHAPE, np.float32)
    views[0, 2, 3, 4, 2] = value
    with pytest.raises(LightFieldError, match='NaN or infinity'):
        LightField(Header(), views, GRID)


@pytest.mark.parametrize('gamma', [0, -1, np.nan, np.inf])
def test_an_impossible_gamma_is_refused(gamma):
    with pytest.raises(LightFieldError, match='gamma'):
        LightField(Header(), np.zeros(SHAPE, np.float32), GRID, gamma)


def test_the_picture_is_the_centre_view_encoded():
    views = np.zeros(SHAPE, np.float32)
    views[0, 0] = views[0, 2] = 1
    views[0, 1, 0, :, 0] = -0.5, 0, 0.25, 1, 7
    light_field = LightField(Header(), views, GRID, gamma=0.5)
    np.testing.assert_array_equal(light_field.centre_view, views[0, 1])
    picture = light_field.picture()
    assert (picture.shape, picture.dtype) == ((4, 5, 3), np.uint8)
    np.testing.assert_array_equal(picture[0, :, 0], [0, 0, 128, 255, 255])
    assert not picture[..., 1:].any()
    assert not picture[1:].any()


def test_the_picture_has_the_cameras_colours():
    views = np.full(SHAPE, 0.2, np.float32)
    colour = Colour((2, 1, 1), ((0, 1, 0), (1, 0, 0), (0, 0, 1)))
    picture = LightField(Header(), views, GRID, 1, colour).picture()
    np.testing.assert_array_equal(picture[0, 0], [51, 102, 51])


@pytest.mark.parametrize('dtype', [np.float32, np.float64])
@pytest.mark.parametrize('place', [(0, 0, 0, 0, 0), (0, 1, 2, 3, 1), (0, 2, 3, 4, 2)])
@pytest.mark.parametrize('views', [np.zeros(SHAPE), np.zeros(SHAPE[::-1]).T])
def test_one_bad_number_anywhere_is_found(dtype, place, views):
    views = views.astype(dtype)
    views[:] = 3e38
    LightField(Header(), views, GRID)
    views[place] = np.nan
    with pytest.raises(LightFieldError, match='NaN'):
        LightField(Header(), views, GRID)


SIZES = st.tuples(*[st.integers(1, 5)] * 4)


@given(SIZES)
def test_a_mosaic_has_each_view_in_its_place(size):
    rows, columns, height, width = size
    mosaic = np.random.default_rng(1).integers(0, 65535, (rows * height, columns * width, 3),
                                               np.uint16)
    views = views_of_mosaic(np.asfortranarray(mosaic), rows, columns)  # any memory layout
    assert (views.dtype, views.shape) == (np.float32, (*size, 3))
    for row, column in np.ndindex(rows, columns):
        tile = mosaic[row * height:(row + 1) * height, column * width:(column + 1) * width]
        np.testing.assert_array_equal(views[row, column], tile / np.float32(VIEW_WHITE))


def test_positions_grow_with_column_and_row():
    np.testing.assert_array_equal(nominal_positions(3, 5)[..., 0], [[-2, -1, 0, 1, 2]] * 3)
    np.testing.assert_array_equal(nominal_positions(3, 5)[..., 1], [[-1] * 5, [0] * 5, [1] * 5])


def test_the_centre_is_where_the_position_is_zero():
    grid = ViewGrid(GRID.pinhole, 0.001, nominal_positions(3, 5), np.ones((3, 5), np.float32))
    assert (grid.shape, grid.centre) == ((3, 5), (1, 2))
    np.testing.assert_array_equal(grid.positions[grid.centre], [0, 0])


def grid_of(baseline=0.001, positions=None, weights=None):
    positions = nominal_positions(3, 3) if positions is None else positions
    return ViewGrid(GRID.pinhole, baseline, positions,
                    np.ones((3, 3)) if weights is None else weights)


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
