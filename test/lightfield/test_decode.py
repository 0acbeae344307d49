"""The decode of raw frames whose light field is known."""

import json

import numpy as np
import pytest
from synthetic_camera import SIDE, SyntheticCamera, spot, waves, whole_text

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.errors import LightFieldError
from pmcl_ros.header import Header
from pmcl_ros.lightfield.calibration import Calibration
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.lightfield.geometry import nominal_positions

OUTSIDE = {(row, column) for row in (0, 8) for column in (0, 1, 7, 8)} | {
    (row, column) for row in (1, 7) for column in (0, 8)}  # corners and their neighbours


@pytest.fixture(scope='module')
def text(camera_text):
    return camera_text(SIDE, SIDE)


@pytest.fixture(scope='module')
def camera(text):
    return SyntheticCamera(text)


@pytest.fixture(scope='module')
def decoder(camera):
    return Decoder(camera.calibration, camera.white())


@pytest.mark.parametrize('depth', [0.3, 0.5, np.inf])
def test_views_are_those_of_the_light_field(camera, decoder, depth):
    light_field = decoder.decode(camera.picture(waves, depth))
    y, x = np.indices((40, 40)).astype(float)
    inside = np.s_[5:-5, 5:-5]
    for row, column in np.ndindex(9, 9):
        across, down = camera.disparity(depth) * (column - 4, row - 4)
        error = light_field.views[row, column] - waves(x + across, y + down)
        worst, mean = np.abs(error[inside]).max(), np.sqrt((error[inside] ** 2).mean())
        radius = np.hypot(row - 4, column - 4)
        if radius < 3:
            assert worst < 0.02
            assert mean < 0.007
        elif (row, column) not in OUTSIDE:
            # Near the rim a sample holds light of the next lenslet, which shows the same a pixel
            # away at the depth of focus, elsewhere another part of the scene.
            assert mean < (0.012 if depth == 0.5 else 0.03 if radius < 4 else 0.08)


@pytest.mark.parametrize('depth', [0.3, 0.5, np.inf])
def test_a_point_moves_as_the_grid_says(camera, decoder, depth):
    light_field = decoder.decode(camera.picture(spot(20.3, 18.6), depth))
    grid = light_field.grid
    y, x = np.indices((40, 40))
    for row, column in ((4, 4), (4, 1), (4, 7), (1, 4), (7, 4), (2, 6), (6, 3)):
        view = light_field.views[row, column, ..., 1]
        a, b = grid.positions[row, column]
        assert (a, b) == (column - 4, row - 4)
        found = np.array([(view * x).sum(), (view * y).sum()]) / view.sum()
        pinhole = grid.pinhole
        expected = (20.3 - pinhole.fx * grid.baseline * a / depth,
                    18.6 - pinhole.fy * grid.baseline * b / depth)
        np.testing.assert_allclose(found, expected, atol=0.03)


@pytest.mark.parametrize('pitch', [9.93, 9.95, 10.004])
def test_views_beyond_the_pupil_are_black(text, pitch):
    camera = SyntheticCamera(text, pitch)
    decoder = Decoder(camera.calibration, camera.white())
    light_field = decoder.decode(camera.picture(waves))
    assert light_field.grid is decoder.grid
    weights = light_field.grid.weights
    assert {tuple(place) for place in np.argwhere(weights == 0).tolist()} == OUTSIDE
    assert weights[4, 4] == 1
    assert weights.max() == 1
    for place in OUTSIDE:
        assert not light_field.views[place].any()


def test_weights_are_the_light_relative_to_the_centre_view(text):
    camera = SyntheticCamera(text, tilt=(0.02, -0.03))
    weights = Decoder(camera.calibration, camera.white()).grid.weights
    a, b = np.moveaxis(nominal_positions(9, 9), -1, 0)
    expected = (1 - 0.5 * (a ** 2 + b ** 2) ** 2 / 5 ** 4) * (1 + 0.02 * a - 0.03 * b)
    inner = np.hypot(a, b) < 3.7
    # A sample is a mean of what is around it, and the light falls faster and faster.
    np.testing.assert_allclose(weights[inner], expected[inner], atol=0.07)
    np.testing.assert_allclose(weights[4, 7] / weights[4, 1], 1.06 / 0.94, rtol=0.02)
    np.testing.assert_allclose(weights[7, 4] / weights[1, 4], 0.91 / 1.09, rtol=0.02)


def test_colours_are_those_of_the_scene(camera, decoder):
    # The white light is not white, and its tint is not the scene's.
    red = np.array([0.7, 0.1, 0.3])
    views = decoder.decode(camera.from_colours(np.broadcast_to(red, (SIDE, SIDE, 3)))).views
    lit = views[decoder.grid.weights > 0][:, 5:-5, 5:-5]
    np.testing.assert_allclose(lit, np.broadcast_to(red, lit.shape), rtol=0.02)


def test_highlights_are_kept(camera, decoder):
    # The sensor saturates at the lenslets' centres, but not on their rims with half the light.
    views = decoder.decode(camera.from_colours(np.full((SIDE, SIDE, 3), 1.4))).views
    np.testing.assert_allclose(views[4, 4, 5:-5, 5:-5], 1, rtol=0.06)
    assert views[4, 8, 5:-5, 5:-5].min() > 1.15
    assert views.max() < 1.43


def test_header_pinhole_and_gamma_are_handed_on(camera, decoder, text):
    header = Header(7, 'frame')
    frame = camera.picture(waves, header=header)
    light_field = decoder.decode(frame)
    assert light_field.header is header
    assert light_field.gamma == json.loads(text)['image']['color']['gamma']
    assert light_field.grid.pinhole == camera.calibration.pinhole
    assert light_field.grid.baseline == camera.calibration.baseline


def of_serial(frame, text, serial):
    metadata = CameraMetadata.parse(whole_text(text, serial))
    return RawFrame(frame.header, frame.counts, metadata)


def test_another_camera_is_refused(camera, decoder, text):
    with pytest.raises(LightFieldError, match='picture is from camera B2, the calibration is for'):
        decoder.decode(of_serial(camera.picture(waves), text, 'B2'))
    with pytest.raises(LightFieldError, match='white image is from camera B2, the calibration'):
        Decoder(camera.calibration, of_serial(camera.white(), text, 'B2'))


def test_an_unknown_serial_number_is_taken(camera, decoder, text):
    decoder.decode(of_serial(camera.picture(waves), text, ''))
    unknown = camera.calibration.model_copy(update={'serial': ''})
    Decoder(unknown, camera.white()).decode(of_serial(camera.picture(waves), text, 'B2'))


def test_another_size_is_refused(camera, decoder, camera_text):
    metadata = CameraMetadata.parse(camera_text(SIDE, SIDE - 10))
    frame = RawFrame(Header(), camera.white().counts[:-10], metadata)
    with pytest.raises(LightFieldError, match=r'\(390, 400\) and white image \(400, 400\) differ'):
        decoder.decode(frame)
    with pytest.raises(LightFieldError, match='raw frames of 400x400; the white image has 400x39'):
        Decoder(camera.calibration, frame)


@pytest.mark.parametrize('level', [0.005, 1.2])
def test_a_dark_or_saturated_white_image_is_refused(camera, level):
    with pytest.raises(LightFieldError, match=r'white image is at .* well above black and below'):
        Decoder(camera.calibration, camera.white([level] * 4))


def test_a_white_image_of_another_lattice_is_refused(camera):
    x, y = camera.calibration.lattice.centre_px
    lattice = camera.calibration.lattice.model_copy(update={'centre_px': (x + 5, y)})
    calibration = camera.calibration.model_copy(update={'lattice': lattice})
    assert isinstance(calibration, Calibration)
    with pytest.raises(LightFieldError, match='lattice of the calibration belongs to another'):
        Decoder(calibration, camera.white())
