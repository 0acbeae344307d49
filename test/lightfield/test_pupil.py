import numpy as np
import pytest
from synthetic_camera import SIDE, SyntheticCamera

from pmcl_ros.lightfield.lenslets import Lenslets
from pmcl_ros.lightfield.pupil import Pupil
from pmcl_ros.runtime.errors import LightFieldError


@pytest.fixture(scope='module')
def text(camera_text):
    return camera_text(SIDE, SIDE)


def measure(camera, light, views=9):
    lenslets = Lenslets.covering(camera.calibration.lattice, 0, SIDE - 1, 0, SIDE - 1)
    return Pupil.measure(np.asarray(light, np.float32), lenslets, views)


@pytest.mark.parametrize('slope', [(0, 0), (0.02, -0.015)])
def test_a_uniform_or_sloping_light_has_its_moments(text, slope):
    camera = SyntheticCamera(text)
    pupil = measure(camera, 0.5 * (1 + camera.offset @ slope))
    b, a = np.mgrid[-4:5, -4:5]
    inner = np.hypot(a, b) <= 1.5
    light = 1 + a * slope[0] + b * slope[1]
    np.testing.assert_allclose(pupil.weights[inner], light[inner], rtol=2e-3)
    # The tent on the pixels of a colour has a variance between 1/2 and 1, by its phase.
    for axis, nominal in ((0, a), (1, b)):
        moved = pupil.positions[..., axis] - nominal
        centre = slope[axis] / light
        expected = (centre - slope[axis]) * 2 / 3
        np.testing.assert_allclose(moved[inner], expected[inner], atol=0.005)


def test_light_within_a_disc_only(text):
    camera = SyntheticCamera(text)
    light = (np.hypot(*np.moveaxis(camera.offset, -1, 0)) < 3).astype(float)
    pupil = measure(camera, light)
    radius = np.hypot(*np.moveaxis(pupil.positions, -1, 0))
    assert (radius[pupil.weights > 0] < 3).all()
    assert pupil.weights[4, 4] == 1
    assert pupil.weights[4, 7] < 0.6
    assert (np.diff(pupil.weights[4, 4:]) < 0.01).all()
    assert pupil.weights[4, 8] > 0  # nominally outside: what little it gets is from the rim


@pytest.mark.parametrize('pitch', [9.93, 9.95, 10.0, 10.004])
def test_views_half_outside_their_lenslet_are_outside_the_pupil(text, pitch):
    camera = SyntheticCamera(text, pitch)
    lit = measure(camera, camera.light).weights > 0
    assert lit.sum() == 69
    assert not lit[0, :2].any()
    assert not lit[1, 0]
    assert lit[0, 2:7].all()
    assert lit[1, 1]
    more = measure(camera, camera.light, 11).weights > 0
    np.testing.assert_array_equal(more[1:-1, 1:-1], lit)
    assert more.sum() == 69


def test_where_the_light_is_a_twentieth_a_view_is_dark(text):
    camera = SyntheticCamera(text)
    distance = np.hypot(*np.moveaxis(camera.offset, -1, 0))
    pupil = measure(camera, np.where(distance < 1, 1, 0.01))
    assert pupil.weights[4, 4] == 1
    assert not pupil.weights[:2].any()
    np.testing.assert_array_equal(pupil.positions[0], [[a, -4] for a in range(-4, 5)])


def test_light_around_the_centres_is_of_another_lattice(text):
    camera = SyntheticCamera(text)
    distance = np.hypot(*np.moveaxis(camera.offset, -1, 0))
    with pytest.raises(LightFieldError, match=r'bright under the centres .* up to'):
        measure(camera, np.clip(distance / 5, 0.1, 1))


def test_a_lattice_that_misses_the_sensor_is_refused():
    lenslets = Lenslets((0, 0), np.full((1, 1, 2), -50.0), 5.0)
    with pytest.raises(LightFieldError, match='no lenslet lies wholly on a sensor of 400x400'):
        Pupil.measure(np.ones((SIDE, SIDE), np.float32), lenslets, 9)
