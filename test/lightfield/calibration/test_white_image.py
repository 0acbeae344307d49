import json
from pathlib import Path

import numpy as np
import pytest
from lattice_frames import discs, frame_of, make_lattice, mosaic, texture

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.lightfield.calibration.white_image import is_white_image, unevenness

CAMERA = Path(__file__).parents[3] / 'config/cameras'
SIDE = 800


def test_the_shipped_white_image_by_its_light_alone():
    assert unevenness(read_raw_frame(CAMERA / 'demo_white.RAW.xz')) < 0.02


def test_vignetting_and_colour_are_no_scene(camera_text):
    light = discs(make_lattice(), SIDE) * mosaic([0.4, 0.8, 0.8, 0.3], SIDE)
    light *= 1 - 0.9 * ((np.indices(light.shape) / SIDE - 0.45) ** 2).sum(axis=0)
    assert is_white_image(frame_of(light, camera_text))


@pytest.mark.parametrize('size', [10, 100])
def test_a_scene_is_no_white_image(camera_text, size):
    light = discs(make_lattice(), SIDE) * texture(SIDE, size, strength=0.3)
    assert not is_white_image(frame_of(light, camera_text))


@pytest.mark.parametrize('light', [np.zeros((SIDE, SIDE)), np.full((100, 100), 0.5)])
def test_nothing_to_see_is_no_white_image(camera_text, light):
    assert not is_white_image(frame_of(light, camera_text, noise=0))


@pytest.mark.parametrize('mark', [True, False])
def test_the_cameras_own_mark_decides(camera_text, mark):
    tags = {'vendorContent': {'com.lytro.tags': {'modulationFrame': mark}}}

    def text(width, height):
        frame = {'frame': {'metadata': json.loads(camera_text(width, height))}}
        picture = {'frameArray': [frame], 'parameters': tags}
        return json.dumps({'master': {'picture': picture}})

    scenes = (np.ones((SIDE, SIDE)), texture(SIDE, 30))
    for scene in scenes:
        assert is_white_image(frame_of(0.5 * scene * discs(make_lattice(), SIDE), text)) is mark
