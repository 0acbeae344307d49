"""Pictures are decoded with the white image of their camera and zoom."""

import json
import logging
from functools import cache

import numpy as np
import pytest
from synthetic_camera import SIDE, SyntheticCamera, waves

from pmcl_ros.camera.files import write_raw_frame
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.runtime.errors import CameraError, LightFieldError


@pytest.fixture(scope='module')
def camera(camera_text):
    """A function zoom, serial -> a camera; its vignetting tells the zoom."""
    @cache
    def camera(zoom=600, serial='A1', focus=700):
        frame = json.loads(camera_text(SIDE, SIDE))
        frame['devices'] = {'lens': {'zoomStep': zoom, 'focusStep': focus}}
        return SyntheticCamera(json.dumps(frame), serial=serial, tilt=(zoom / 1e4, 0))
    return camera


@pytest.fixture(scope='module')
def folder(camera, tmp_path_factory):
    """White images of camera A1 at two zooms."""
    folder = tmp_path_factory.mktemp('whites')
    for number, zoom in enumerate((100, 600)):
        write_raw_frame(folder / f'MOD_{number:04d}.RAW', camera(zoom).white())
    return folder


def test_each_picture_gets_the_white_image_of_its_zoom(camera, folder, caplog):
    calibration = camera().calibration
    told = []
    decoders = Decoders(calibration, folder, told.append)
    with caplog.at_level(logging.INFO, 'pmcl_ros'):
        for zoom, nearest in ((590, 600), (130, 100), (620, 600)):
            picture = camera(nearest).picture(waves)
            found = decoders.decode(type(picture)(picture.header, picture.counts,
                                                  camera(zoom).metadata))
            expected = Decoder(calibration, camera(nearest).white()).decode(picture)
            np.testing.assert_array_equal(found.views, expected.views)
    assert ['MOD_0001' in why for why in told] == [True, False, True]
    logged = [each for each in caplog.messages if 'white image' in each]
    assert logged == [f'white image: {why}' for why in told]


def test_views_have_the_number_and_the_size_that_are_asked_for(camera, folder):
    calibration, picture = camera().calibration, camera().picture(waves)
    found = Decoders(calibration, folder, views=5, size=(40, 32)).decode(picture)
    assert found.views.shape == (5, 5, 32, 40, 3)
    expected = Decoder(calibration, camera().white(), 5, (40, 32)).decode(picture)
    np.testing.assert_array_equal(found.views, expected.views)


def test_the_decoder_is_made_again_only_for_another_white_image(camera, folder):
    decoders = Decoders(camera().calibration, folder)
    first = decoders.decoder_for(camera(600, focus=1).metadata)
    assert decoders.decoder_for(camera(600, focus=900).metadata) is first
    assert decoders.decoder_for(camera(560, focus=900).metadata) is first
    assert decoders.decoder_for(camera(90).metadata) is not first


def test_a_picture_as_white_image_is_told(camera_text, tmp_path, caplog):
    camera = SyntheticCamera(camera_text(SIDE, SIDE))
    for name, frame in (('white', camera.white()), ('picture', camera.picture(waves))):
        write_raw_frame(tmp_path / f'{name}.RAW', frame)
        caplog.clear()
        Decoders(camera.calibration, tmp_path / f'{name}.RAW')
        assert ('seems to be no white image' in caplog.text) == (name == 'picture')


def test_one_file_is_checked_at_once(camera, folder):
    path = folder / 'MOD_0001.RAW'
    with pytest.raises(LightFieldError, match=r'calibration is for views of 80x80'):
        Decoders(camera().calibration.model_copy(update={'width': 80, 'height': 80}), path)
    decoders = Decoders(camera().calibration, path)
    with pytest.raises(CameraError, match=r'zoom step 100, the nearest .* zoom step 600'):
        decoders.decoder_for(camera(100).metadata)
    with pytest.raises(CameraError, match=r'camera A2, .* of A1'):
        decoders.decoder_for(camera(600, 'A2').metadata)


def test_white_images_of_another_camera_than_the_calibration(camera, folder):
    for path in (folder, folder / 'MOD_0001.RAW'):
        with pytest.raises(LightFieldError, match='of camera A1, the calibration is for A2'):
            Decoders(camera(serial='A2').calibration, path)


def test_another_zoom_or_focus_than_the_calibration_s_is_told(camera, folder, caplog):
    known = camera().calibration.model_copy(update={'zoom': 600.0, 'focus': 650.0})
    decoders = Decoders(known, folder)
    decoders.decoder_for(camera(zoom=600, focus=650).picture(waves, 0.4).metadata)
    assert not [each for each in caplog.records if each.levelname == 'WARNING']
    decoders.decoder_for(camera(zoom=600, focus=700).picture(waves, 0.4).metadata)
    assert 'at focus step 700, the calibration is for 650' in caplog.text
    assert 'at zoom step' not in caplog.text
