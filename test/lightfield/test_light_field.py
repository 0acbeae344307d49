import numpy as np
import pytest

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.colour import Colour
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.view_grid import ViewGrid, nominal_positions
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
