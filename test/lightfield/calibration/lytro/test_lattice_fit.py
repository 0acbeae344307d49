from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from lattice_frames import discs, frame_of, make_lattice, marked, mosaic

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice, predicted_lattice
from pmcl_ros.lightfield.calibration.lytro.lattice_fit import fit_lattice
from pmcl_ros.runtime.errors import LightFieldError

CAMERA = Path(__file__).parents[4] / 'config/cameras'
SIDE = 600


def worst(lattice, truth, side=SIDE):
    """95th percentile of the centres' errors over the sensor, px."""
    return np.percentile(lattice.difference(truth, side, side), 95)


def test_the_shipped_white_image():
    truth = Calibration.load(CAMERA / 'demo.yaml').lattice
    fit = fit_lattice(read_raw_frame(CAMERA / 'demo_white.RAW.xz'))
    assert worst(fit.lattice, truth, 3280) < 0.01
    assert fit.median_px < fit.p95_px < 0.05
    cells = 3280 ** 2 / (truth.pitch_px * truth.row_step_px)
    assert 0.8 * cells < fit.lenslets <= cells


# Discs of 6 px in rows of exactly whole pixels alias: `discs` does not integrate over pixels.
@settings(max_examples=25, deadline=None)
@example(6.1, 1.01, 0.03, 0.2, 0.7, 0.46, 1)
@given(st.floats(7, 20), st.floats(0.98, 1.02), st.floats(-0.06, 0.06), st.floats(0, 1),
       st.floats(0, 1), st.floats(0.42, 0.5), st.integers(0, 99))
def test_any_lattice(camera_text, pitch, ratio, rotation, x, y, radius, seed):
    truth = make_lattice(pitch, ratio * 3 ** 0.5 / 2, rotation, (SIDE * x, SIDE * y))
    levels = np.random.default_rng(seed).uniform(0.2, 0.9, 4)
    light = discs(truth, SIDE, radius) * mosaic(levels, SIDE)
    light *= 1 - 0.3 * ((np.indices(light.shape) / SIDE - 0.5) ** 2).sum(axis=0)
    fit = fit_lattice(frame_of(light + 0.02, camera_text, seed=seed))
    # No more is asked than of a whole sensor, which has a hundred times as many lenslets.
    assert worst(fit.lattice, truth) < 0.05
    centre = np.array(fit.lattice.centre_px)
    assert np.hypot(*(centre - SIDE / 2)) < 2 * truth.pitch_px


@pytest.mark.parametrize('cut', [0.15, 0.2])
def test_the_rim_of_the_main_lens_does_not_move_the_lattice(camera_text, cut):
    side = 1600
    truth = make_lattice(centre=(side / 2 + 1.3, side / 2 - 2.1))
    light = discs(truth, side, 0.48, cut) * mosaic([0.5, 0.8, 0.8, 0.4], side)
    fit = fit_lattice(frame_of(light, camera_text))
    # In the corners the discs' centres of light are farther off than that.
    corner = (np.abs(fit.places - side / 2) > 0.4 * side).all(axis=1)
    assert np.hypot(*fit.errors[corner].T).mean() > 0.1
    assert worst(fit.lattice, truth, side) < 0.03
    assert not fit.used[corner].any()


def test_a_shear_is_told_and_left_out(camera_text):
    truth = make_lattice(rotation=0.01, centre=(SIDE / 2, SIDE / 2))
    light = 0.8 * discs(truth, SIDE, shear=0.002)
    fit = fit_lattice(frame_of(light, camera_text))
    # x of the discs changes by -0.002 y: rows stay, columns lean.
    assert fit.shear == pytest.approx(-0.002, abs=2e-4)
    assert fit.lattice.rotation == pytest.approx(0.01 + 0.001, abs=2e-4)


@pytest.mark.parametrize('mla', [
    {}, {'lensPitch': 1.3e-5, 'rotation': 0.3, 'sensorOffset': {'x': 1e-3, 'y': 2, 'z': 0}}])
def test_metadata_change_nothing(camera_text, mla):
    light = 0.7 * discs(make_lattice(), SIDE)
    told = marked(camera_text, devices={'mla': mla, 'sensor': {'pixelPitch': 1.4e-6}})
    one, other = (fit_lattice(frame_of(light, text)) for text in (camera_text, told))
    assert one.lattice == other.lattice


def test_residuals_tell_of_noise(camera_text):
    light = 0.7 * discs(make_lattice(), SIDE)
    still, loud = (fit_lattice(frame_of(light, camera_text, noise)) for noise in (0.01, 0.3))
    assert 3 * still.median_px < loud.median_px
    for fit in (still, loud):
        distances = np.hypot(*fit.errors[fit.used].T)
        assert fit.median_px == pytest.approx(np.median(distances))
        assert fit.p95_px == pytest.approx(np.percentile(distances, 95))


def test_a_lattice_is_saved_and_loaded(camera_text, tmp_path):
    lattice = fit_lattice(frame_of(0.7 * discs(make_lattice(), SIDE), camera_text)).lattice
    lattice.save(tmp_path / 'lattice.yaml', 'a comment')
    assert Lattice.load(tmp_path / 'lattice.yaml') == lattice


RANDOM = np.random.default_rng(1)
WAVES = np.sin(0.7 * np.arange(SIDE))


@pytest.mark.parametrize(('light', 'told'), [
    (np.zeros((SIDE, SIDE)), 'too dark .* 0.0 %'),
    (0.003 * RANDOM.random((SIDE, SIDE)), 'too dark'),
    (np.ones((SIDE, SIDE)), 'saturated'),
    (np.full((SIDE, SIDE), 0.4), 'no lattice'),
    (0.4 + 0.2 * RANDOM.random((SIDE, SIDE)), r'no lattice .* [0-9.]+ times the power'),
    (0.4 + 0.3 * np.tile(WAVES, (SIDE, 1)), 'no lattice'),
    (0.4 + 0.3 * WAVES * WAVES[:, None], 'no lattice'),
    (np.full((64, 3000), 0.4), '3000x64 is too small'),
    (0.7 * discs(make_lattice(14), 200), '200x200 holds too few lenslets of 14.'),
])
def test_what_shows_no_lattice_is_refused(camera_text, light, told):
    with pytest.raises(LightFieldError, match=told):
        fit_lattice(frame_of(light, camera_text, 0.001))


def test_dark_discs_on_light_are_no_lenslets(camera_text):
    with pytest.raises(LightFieldError, match='phases of its waves'):
        fit_lattice(frame_of(0.8 - 0.7 * discs(make_lattice(), SIDE), camera_text))


def test_the_metadata_of_a_real_camera_by_example(camera_text):
    devices = {'sensor': {'pixelPitch': 1.4e-6}, 'lens': {'exitPupilOffset': {'z': 0.17375}},
               'mla': {'lensPitch': 1.4e-5, 'rotation': -0.0065129,
                       'scaleFactor': {'x': 1.0, 'y': 1.000188},
                       'sensorOffset': {'x': 2.8e-6, 'y': -1.4e-6, 'z': 2.5e-5}}}
    text = marked(camera_text, devices=devices)(3280, 3280)
    lattice = predicted_lattice(CameraMetadata.parse(text))
    assert lattice.pitch_px == pytest.approx(10 * (1 + 2.5e-5 / 0.17375))
    assert lattice.row_step_px == pytest.approx(lattice.pitch_px * 1.000188 * 3 ** 0.5 / 2)
    assert lattice.rotation == -0.0065129
    assert lattice.centre_px == pytest.approx((1641.5, 1638.5))
    assert predicted_lattice(CameraMetadata.parse(camera_text())) is None
