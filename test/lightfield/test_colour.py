"""Colours of screens, and white balance."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.lightfield.colour import Colour, shades_of_grey
from pmcl_ros.runtime.errors import LightFieldError

GAMMA = 0.41666
GAINS = (1.1484, 1.0, 1.2)
MATRIX = ((3.1116, -1.9394, -0.1722), (-0.3629, 1.6409, -0.278), (0.079, -1.1558, 2.0768))
F01 = Colour(GAINS, MATRIX)
LEVELS = st.floats(0, 0.875, width=32)


def test_the_cameras_own_words_are_read(camera_text):
    data = json.loads(camera_text(20, 20))
    data['image']['color'] = {
        'ccmRgbToSrgbArray': [each for row in MATRIX for each in row], 'gamma': GAMMA,
        'whiteBalanceGain': {'r': 1.1484, 'gr': 0.98, 'gb': 1.02, 'b': 1.2}}
    assert Colour.from_metadata(CameraMetadata.parse(json.dumps(data))) == F01
    assert Colour.from_metadata(CameraMetadata.parse(camera_text(20, 20))) == Colour()


@settings(deadline=None)
@given(arrays(np.float32, (4, 5, 3), elements=LEVELS))
def test_below_saturation_it_is_gains_matrix_and_gamma(linear):
    expected = np.einsum('ij,...j->...i', MATRIX, linear.astype(float) * GAINS)
    expected = 255 * np.clip(expected, 0, 1) ** GAMMA
    shown = F01.displayed(linear, GAMMA)
    assert shown.dtype == np.uint8
    # The encoding is steep at black.
    clear = (expected == 0) | (expected > 5)
    assert (np.abs(shown - expected) <= 0.51)[clear].all()


@given(st.floats(0.01, 0.85))
def test_a_grey_in_the_pictures_light_is_grey(level):
    red, green, blue = F01.displayed(level / np.float32(GAINS), 1.0).astype(int)
    assert max(red, green, blue) - min(red, green, blue) <= 1
    assert green == pytest.approx(255 * level, abs=2)


@given(st.tuples(*[st.floats(1, 20)] * 3))
def test_what_saturates_is_white_not_of_the_colour_of_the_gains(values):
    np.testing.assert_array_equal(F01.displayed(np.array(values), GAMMA), [255, 255, 255])


def test_a_grey_stays_neutral_while_its_channels_saturate_one_after_the_other():
    scene = np.linspace(0.5, 2, 300)[:, None] / np.array(GAINS)
    shown = F01.displayed(np.minimum(scene, 1), 1.0).astype(int)
    assert np.ptp(shown, axis=1).max() <= 3
    assert (np.diff(shown, axis=0) >= -1).all()


def test_a_lamp_whose_one_channel_saturates_keeps_its_hue():
    red, green, blue = F01.displayed(np.array([1.0, 0.1, 0.0]), GAMMA)
    assert red == 255
    assert max(green, blue) < 60


def test_what_is_shown_is_not_changed():
    linear = np.full((2, 3), 1.5, np.float32)
    F01.displayed(linear, GAMMA)
    assert (linear == 1.5).all()


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
