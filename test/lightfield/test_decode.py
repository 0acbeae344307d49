"""The decode of raw frames whose light field is known."""

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from synthetic_camera import SIDE, SyntheticCamera, spot, waves, whole_text

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.lightfield.light_field import nominal_positions
from pmcl_ros.runtime.errors import LightFieldError

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
        across, down = camera.disparity(depth) * light_field.grid.positions[row, column]
        error = light_field.views[row, column] - waves(x + across, y + down)
        worst, mean = np.abs(error[inside]).max(), np.sqrt((error[inside] ** 2).mean())
        radius = np.hypot(row - 4, column - 4)
        if radius < 3:
            assert worst < 0.02
            assert mean < 0.007
        elif (row, column) not in OUTSIDE:
            # Lenslets' phases differ, and with them where a sample at the rim looks from.
            assert mean < (0.02 if radius < 4 else 0.05)


@pytest.mark.parametrize('depth', [0.3, 0.5, np.inf])
def test_a_point_moves_as_the_grid_says(camera, decoder, depth):
    light_field = decoder.decode(camera.picture(spot(20.3, 18.6), depth))
    grid = light_field.grid
    y, x = np.indices((40, 40))
    for row, column in ((4, 4), (4, 1), (4, 7), (1, 4), (7, 4), (2, 6), (6, 3)):
        view = light_field.views[row, column, ..., 1]
        a, b = grid.positions[row, column]
        np.testing.assert_allclose((a, b), (column - 4, row - 4), atol=0.1)
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
    inner = np.hypot(a, b) < 2.9
    # A sample sums what is around it, and the light falls faster and faster.
    np.testing.assert_allclose(weights[inner], expected[inner], atol=0.07)
    np.testing.assert_allclose(weights[4, 7] / weights[4, 1], 1.06 / 0.94, rtol=0.02)
    np.testing.assert_allclose(weights[7, 4] / weights[1, 4], 0.91 / 1.09, rtol=0.02)


@pytest.mark.parametrize('pupil', [4.3, 3.2])
@pytest.mark.parametrize('depth', [0.25, np.inf])
def test_views_that_the_pupil_cuts_look_from_where_the_grid_says(text, pupil, depth):
    camera = SyntheticCamera(text, pupil=pupil)
    decoder = Decoder(camera.calibration, camera.white())
    light_field = decoder.decode(camera.picture(spot(20.3, 18.6, 2.5), depth))
    grid = light_field.grid
    y, x = np.indices((40, 40))
    cut = 0
    for row, column in np.argwhere(grid.weights > 0.15):
        view = light_field.views[row, column, ..., 1]
        found = np.array([(view * x).sum(), (view * y).sum()]) / view.sum()
        from_infinity = camera.disparity(depth)
        np.testing.assert_allclose(found, (20.3, 18.6) - from_infinity * grid.positions[
            row, column], atol=0.06)
        nominal = np.array([column - 4, row - 4])
        cut += np.hypot(*(grid.positions[row, column] - nominal)) > 0.3
        assert np.hypot(*grid.positions[row, column]) <= np.hypot(*nominal) + 0.01
    assert cut >= 8
    assert grid.weights.max() == 1
    # The pupil is seen to be as small as it is.
    assert np.hypot(*np.moveaxis(grid.positions[grid.weights > 0], -1, 0)).max() < pupil


def test_positions_and_weights_are_mirrored_as_the_light_is(decoder):
    positions, weights = decoder.grid.positions, decoder.grid.weights
    np.testing.assert_allclose(weights, weights[::-1, ::-1], atol=0.01)
    np.testing.assert_allclose(positions, -positions[::-1, ::-1], atol=0.03)
    np.testing.assert_array_equal(positions[4, 4], [0, 0])


@pytest.mark.parametrize(('views', 'size'), [(5, None), (7, (40, 40)), (9, (60, 35)),
                                             (11, (20, 24)), (1, None)])
def test_other_numbers_and_sizes_of_views(text, camera, views, size):
    decoder = Decoder(camera.calibration, camera.white(), views=views, size=size)
    light_field = decoder.decode(camera.picture(waves, 0.4))
    width, height = size or (40, 40)
    assert light_field.views.shape == (views, views, height, width, 3)
    pinhole, whole = decoder.grid.pinhole, camera.calibration.pinhole
    y, x = np.indices((height, width)).astype(float)
    # The same ray in the calibration's pixels.
    x = (x - pinhole.cx) / pinhole.fx * whole.fx + whole.cx
    y = (y - pinhole.cy) / pinhole.fy * whole.fy + whole.cy
    np.testing.assert_allclose([x[0, 0], x[0, -1]], [20 / width - 0.5, 39.5 - 20 / width])
    for row, column in np.argwhere(decoder.grid.weights > 0.6):
        across, down = camera.disparity(0.4) * decoder.grid.positions[row, column]
        error = light_field.views[row, column] - waves(x + across, y + down)
        assert np.sqrt((error[5:-5, 5:-5] ** 2).mean()) < 0.02
    if views == 11:  # the outermost are beyond the lenslets
        assert not decoder.grid.weights[0].any()
        assert not light_field.views[0].any()
    whole_weights = Decoder(camera.calibration, camera.white()).grid.weights
    shared = min(views, 9) // 2
    first, last = views // 2 - shared, views // 2 + shared + 1
    np.testing.assert_allclose(decoder.grid.weights[first:last, first:last],
                               whole_weights[4 - shared:5 + shared, 4 - shared:5 + shared],
                               atol=2e-3)


@pytest.mark.parametrize('views', [0, 4, -1, 23])
def test_impossible_numbers_of_views_are_refused(camera, views):
    with pytest.raises(LightFieldError, match=f'{views} views of a row: .*odd, from 1 to 21'):
        Decoder(camera.calibration, camera.white(), views=views)


@pytest.mark.parametrize(('size', 'reason'), [((4, 40), '9x9 views of 4x40 px .* 8 px or more'),
                                              ((1100, 1100), 'take 1122 MiB; .* 768 MiB at most')])
def test_impossible_sizes_of_views_are_refused(camera, size, reason):
    with pytest.raises(LightFieldError, match=reason):
        Decoder(camera.calibration, camera.white(), size=size)


@pytest.mark.parametrize(('k1', 'k2'), [(-3.0, 0), (1.5, 6.0)])
def test_radial_distortion_is_undone(text, k1, k2):
    camera = SyntheticCamera(text, k1=k1, k2=k2)
    decoder = Decoder(camera.calibration, camera.white())
    light_field = decoder.decode(camera.picture(waves, 0.4))
    straight = camera.calibration.model_copy(update={'k1': 0, 'k2': 0})
    bent = Decoder(straight, camera.white()).decode(camera.picture(waves, 0.4))
    y, x = np.indices((40, 40)).astype(float)
    for row, column in ((4, 4), (4, 1), (7, 4), (2, 6)):
        across, down = camera.disparity(0.4) * decoder.grid.positions[row, column]
        right = waves(x + across, y + down)
        wrong = np.abs(bent.views[row, column] - right)[5:-5, 5:-5].max()
        assert np.abs(light_field.views[row, column] - right)[5:-5, 5:-5].max() < 0.03 < wrong / 2


def test_a_view_goes_on_beyond_the_sensor_with_what_is_at_its_edge(camera, decoder):
    views = decoder.decode(camera.from_colours(np.full((SIDE, SIDE, 3), 0.5))).views
    lit = views[decoder.grid.weights > 0]
    np.testing.assert_allclose(lit, 0.5, rtol=0.08)


def test_a_map_of_light_serves_as_well_as_a_white_image(camera, decoder):
    frame = camera.picture(waves, 0.4)
    expected = decoder.decode(frame)
    other = Decoder(camera.calibration, decoder.light).decode(frame)
    np.testing.assert_array_equal(other.views, expected.views)
    np.testing.assert_array_equal(other.grid.positions, expected.grid.positions)
    with pytest.raises(LightFieldError, match='white image or the light has 400x398'):
        Decoder(camera.calibration, decoder.light[:-2])


def test_raw_pixels_beyond_the_last_view_pixel_change_nothing(camera, decoder, camera_text):
    """Of a sensor whose sides are no multiple of the pitch."""
    frame = camera.picture(waves, 0.4)
    wider = RawFrame(frame.header, np.pad(frame.counts, ((0, 4), (0, 6)), 'edge'),
                     CameraMetadata.parse(camera_text(SIDE + 6, SIDE + 4)))
    light = np.pad(decoder.light, ((0, 4), (0, 6)), 'edge')
    views = Decoder(camera.calibration, light).decode(wider).views
    inside = np.s_[2:-2, 2:-2, :-3, :-3]  # others look beyond the edge
    np.testing.assert_allclose(views[inside], decoder.decode(frame).views[inside], atol=0.01)


def test_a_light_field_stays_what_it_is_when_the_next_is_decoded(camera, decoder):
    first = decoder.decode(camera.picture(waves, 0.4))
    copy = first.views.copy()
    decoder.decode(camera.picture(spot(20, 20), 0.4))
    np.testing.assert_array_equal(first.views, copy)


def test_pictures_that_are_decoded_at_once_do_not_mix(camera, decoder):
    frames = [camera.picture(waves, 0.4), camera.picture(spot(20, 20), 0.4)] * 4
    expected = [decoder.decode(frame).views for frame in frames[:2]] * 4
    with ThreadPoolExecutor(4) as pool:
        for found, views in zip(pool.map(decoder.decode, frames), expected, strict=True):
            np.testing.assert_array_equal(found.views, views)


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
    assert views[4, 8, 5:-5, 5:-5].min() > 1.1
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
    with pytest.raises(LightFieldError, match='white image or the light has 400x390'):
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
