import numpy as np
import pytest

from pmcl_ros.lightfield.white_balance import shades_of_grey
from pmcl_ros.runtime.errors import LightFieldError

RANDOM = np.random.default_rng(3)


def test_a_grey_scene_in_coloured_light():
    grey = RANDOM.uniform(0.05, 0.6, (40, 40, 1))
    light = np.array([0.8, 1, 0.6])
    np.testing.assert_allclose(shades_of_grey(grey * light), 1 / light, rtol=1e-9)


def test_bright_colours_count_most():
    view = np.concatenate([np.full((500, 3), 0.7), np.tile([0.02, 0.2, 0.02], (500, 1))])
    np.testing.assert_allclose(shades_of_grey(view), 1, atol=0.001)


def test_saturated_pixels_tell_nothing():
    view = np.concatenate([np.tile([0.2, 0.4, 0.2], (500, 1)), np.ones((500, 3))])
    np.testing.assert_allclose(shades_of_grey(view), [2, 1, 2])


def test_too_little_light_is_refused():
    with pytest.raises(LightFieldError, match='only 0 pixels'):
        shades_of_grey(np.zeros((20, 20, 3)))
