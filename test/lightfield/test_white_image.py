"""White images: recognition, and vignetting removed with them."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lattice_frames import discs, frame_of, make_lattice, mosaic, texture

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.white_image import devignette, is_white_image, relative_light, unevenness
from pmcl_ros.runtime.errors import LightFieldError

SIDE = 40


@pytest.fixture(scope='module')
def frame(camera_text):
    """A function linear values (SIDE, SIDE) -> their frame."""
    metadata = CameraMetadata.parse(camera_text(SIDE, SIDE))

    def make(values):
        counts = np.clip(np.rint(168 + (4095 - 168) * values), 0, 4095).astype(np.uint16)
        return RawFrame(Header(), counts, metadata)
    return make


def test_light_is_relative_to_the_brightest_of_each_colour(frame):
    values = np.empty((SIDE, SIDE))
    falling = np.repeat(np.linspace(1, 0.1, SIDE // 2), SIDE // 2).reshape(-1, SIDE // 2)
    falling[:3] = 1  # more than a hundredth
    for k, (row, column) in enumerate(np.ndindex(2, 2)):
        values[row::2, column::2] = falling * (0.9, 0.5, 0.6, 0.3)[k]
    white = frame(values)
    counts = white.counts.copy()
    light = relative_light(white)
    assert light.dtype == np.float32
    for row, column in np.ndindex(2, 2):
        np.testing.assert_allclose(light[row::2, column::2], falling, atol=1e-3)
    np.testing.assert_array_equal(white.counts, counts)


@pytest.mark.parametrize(('level', 'percent'), [(0, 0), (0.019, 2), (0.992, 99), (1.5, 100)])
@pytest.mark.parametrize('phase', [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_one_dark_or_saturated_colour_is_enough_to_refuse(frame, level, percent, phase):
    values = np.full((SIDE, SIDE), 0.5)
    relative_light(frame(values))
    values[phase[0]::2, phase[1]::2] = level
    with pytest.raises(LightFieldError, match=f'white image is at {percent} % of the range'):
        relative_light(frame(values))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_devignetting_gives_back_the_scene(frame, seed):
    rng = np.random.default_rng(seed)
    scene = rng.uniform(0, 2, (SIDE, SIDE))
    light = rng.uniform(0.05, 1, (SIDE, SIDE)).astype(np.float32)
    unclipped = scene * light < 1
    linear = devignette(frame(scene * light), light)
    assert linear.dtype == np.float32
    half_a_count = 0.5 / (4095 - 168) / light
    assert (np.abs(linear - scene) <= half_a_count + 1e-6)[unclipped].all()
    np.testing.assert_allclose(linear[~unclipped], 1 / light[~unclipped], rtol=1e-6)


def test_what_got_next_to_no_light_is_not_brightened_beyond_twenty_times(frame):
    for light in (0.05, 0.01, 0, -0.1):
        field = np.full((SIDE, SIDE), light, np.float32)
        linear = devignette(frame(np.full((SIDE, SIDE), 0.04)), field)
        np.testing.assert_allclose(linear, 0.8, rtol=5e-3)


def test_below_black_is_negative(frame):
    dark = -100 / (4095 - 168)
    linear = devignette(frame(np.full((SIDE, SIDE), dark)), np.ones((SIDE, SIDE), np.float32))
    np.testing.assert_allclose(linear, dark, rtol=1e-5)


def test_another_size_is_refused(frame):
    with pytest.raises(LightFieldError, match=r'\(40, 40\) and white image \(40, 38\) differ'):
        devignette(frame(np.zeros((SIDE, SIDE))), np.ones((SIDE, SIDE - 2), np.float32))


CAMERA = Path(__file__).parents[2] / 'config/cameras'
WIDTH = 800


def test_the_shipped_white_image_by_its_light_alone():
    assert unevenness(read_raw_frame(CAMERA / 'demo_white.RAW.xz')) < 0.02


def test_vignetting_and_colour_are_no_scene(camera_text):
    light = discs(make_lattice(), WIDTH) * mosaic([0.4, 0.8, 0.8, 0.3], WIDTH)
    light *= 1 - 0.9 * ((np.indices(light.shape) / WIDTH - 0.45) ** 2).sum(axis=0)
    assert is_white_image(frame_of(light, camera_text))


@pytest.mark.parametrize('size', [10, 100])
def test_a_scene_is_no_white_image(camera_text, size):
    light = discs(make_lattice(), WIDTH) * texture(WIDTH, size, strength=0.3)
    assert not is_white_image(frame_of(light, camera_text))


@pytest.mark.parametrize('light', [np.zeros((WIDTH, WIDTH)), np.full((100, 100), 0.5)])
def test_nothing_to_see_is_no_white_image(camera_text, light):
    assert not is_white_image(frame_of(light, camera_text, noise=0))


@pytest.mark.parametrize('mark', [True, False])
def test_the_cameras_own_mark_decides(camera_text, mark):
    tags = {'vendorContent': {'com.lytro.tags': {'modulationFrame': mark}}}

    def text(width, height):
        frame = {'frame': {'metadata': json.loads(camera_text(width, height))}}
        picture = {'frameArray': [frame], 'parameters': tags}
        return json.dumps({'master': {'picture': picture}})

    scenes = (np.ones((WIDTH, WIDTH)), texture(WIDTH, 30))
    for scene in scenes:
        assert is_white_image(frame_of(0.5 * scene * discs(make_lattice(), WIDTH), text)) is mark
