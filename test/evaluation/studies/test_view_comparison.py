"""The decode's fidelity: against exact views of a made-up camera, and of a simulated capture."""

import math
from pathlib import Path

import numpy as np
import pytest
from synthetic_camera import SIDE, SyntheticCamera

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.evaluation.studies.view_comparison import IdealViews, compare_views, table
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.runtime.errors import LightFieldError

CAPTURES = Path(__file__).parents[4] / 'shared' / 'captures'
STEPS = 3 * nominal_positions(3, 3)
Y, X = np.indices((40, 40)).astype(float)


def texture(x, y):
    """Linear RGB in [0.2, 0.8] that varies in every direction."""
    phase = 2 * np.pi * np.stack([0.06 * x + 0.03 * y, 0.07 * y - 0.02 * x,
                                  0.05 * (x - y)], axis=-1)
    return 0.5 + 0.3 * np.sin(phase + np.arange(3))


def ideal_of(disparity):
    """Exact lattice-aligned views of a plane."""
    views = [[texture(X - a * disparity, Y - b * disparity) for a, b in row] for row in STEPS]
    return IdealViews(np.array(views, np.float32) ** np.float32(1 / 2.2), STEPS)


def field_of(disparity, positions, displaced=(0, 0)):
    """A light field whose views look from `positions`, and are displaced besides."""
    grid = ViewGrid(Pinhole(40, 40, 100, 100, 20, 20), 0.001, positions,
                    np.ones((9, 9), np.float32))
    views = [[texture(X - a * disparity - displaced[0], Y - b * disparity - displaced[1])
              for a, b in row] for row in positions]
    return LightField(Header(), np.array(views, np.float32), grid)


@pytest.mark.parametrize('disparity', [-0.4, 0.0, 0.3])
def test_the_disparity_of_a_plane(disparity):
    found = ideal_of(disparity).disparity()[8:-8, 8:-8]
    np.testing.assert_allclose(found, disparity, atol=0.015)


@pytest.mark.parametrize('disparity', [-0.4, 0.3])
@pytest.mark.parametrize('displaced', [(0, 0), (0.05, -0.03)])
def test_displacements_are_told_apart_from_positions(disparity, displaced):
    positions = nominal_positions(9, 9) * 0.9
    errors = compare_views(field_of(disparity, positions, displaced), ideal_of(disparity))
    assert [each.place for each in errors] == [(r, c) for r in (1, 4, 7) for c in (1, 4, 7)]
    for each in errors:
        row, column = each.place
        moved = -0.1 * disparity * np.array([column - 4, row - 4])
        np.testing.assert_allclose(each.expected, moved, atol=0.004)
        np.testing.assert_allclose(each.shift, moved + displaced, atol=0.005)
        assert each.residual == pytest.approx(np.hypot(*displaced), abs=0.005)
        if displaced == (0, 0):
            assert each.psnr_there > 50


@pytest.mark.parametrize('sigma', [0.01, 0.04])
def test_psnr_is_that_of_the_noise_after_the_blur(sigma):
    field = field_of(0.2, nominal_positions(9, 9))
    noise = np.random.default_rng(0).normal(0, sigma, field.views.shape)
    clean = np.clip(field.views, 0, None) ** (1 / 2.2)
    views = (np.clip(clean + noise, 0, None) ** 2.2).astype(np.float32)
    errors = compare_views(LightField(Header(), views, field.grid), ideal_of(0.2))
    # A Gaussian of 1 px leaves 1 / (4 pi) of white noise's variance.
    expected = -10 * math.log10(sigma ** 2 / (4 * math.pi))
    assert np.mean([each.psnr for each in errors]) == pytest.approx(expected, abs=0.6)


@pytest.mark.parametrize('depth', [0.35, 0.8])
def test_a_decode_of_a_vignetted_noisy_picture_is_faithful(camera_text, depth):
    camera = SyntheticCamera(camera_text(SIDE, SIDE), pupil=4.4)
    aligned = camera.calibration.model_copy(update={'focus_distance': math.inf})
    decoder = Decoder(aligned, camera.white())
    disparity = camera.shift - camera.disparity(depth)
    frame = camera.picture(texture, depth)
    signal = np.clip(frame.counts - 168.0, 0, None)
    noise = np.random.default_rng(1).normal(0, np.sqrt(6 + 0.4 * signal))
    counts = np.clip(np.rint(frame.counts + noise), 0, 4095).astype(np.uint16)
    light_field = decoder.decode(RawFrame(Header(), counts, frame.metadata))
    views = [[texture(X - a * disparity[0], Y - b * disparity[1]) for a, b in row]
             for row in STEPS]
    ideal = IdealViews(np.array(views, np.float32) ** np.float32(1 / 2.2), STEPS)
    for each in compare_views(light_field, ideal):
        diagonal = 4 not in each.place
        assert each.residual < 0.05
        assert each.psnr_there > (35 if diagonal else 38)
        if diagonal:  # where such a view looks from is no small matter
            assert np.hypot(*each.position) < 3.7


@pytest.mark.skipif(not (CAPTURES / 'wine_glass' / 'views.npz').exists(),
                    reason='no captures with ideal views here')
def test_a_decode_of_a_simulated_capture_is_faithful():
    root = Path(__file__).parents[3]
    calibration = Calibration.load(root / 'config/cameras/demo.yaml').model_copy(
        update={'focus_distance': math.inf})
    decoder = Decoder(calibration, read_raw_frame(root / 'config/cameras/demo_white.RAW.xz'))
    light_field = decoder.decode(read_raw_frame(CAPTURES / 'wine_glass' / 'IMG.RAW.xz'))
    errors = compare_views(light_field, IdealViews.load(CAPTURES / 'wine_glass' / 'views.npz'))
    for each in errors:
        centre, diagonal = each.place == (4, 4), 4 not in each.place
        assert each.residual < 0.04
        assert each.psnr >= (40 if centre else 36 if diagonal else 39)
    text = table(errors)
    assert len(text.splitlines()) == 2 + 9


def test_what_cannot_be_compared_is_refused(tmp_path):
    dark = field_of(0, nominal_positions(9, 9))
    weights = np.ones((9, 9), np.float32)
    weights[1, 1] = 0
    grid = ViewGrid(dark.grid.pinhole, 0.001, dark.grid.positions, weights)
    with pytest.raises(LightFieldError, match=r'no view \(1, 1\)'):
        compare_views(LightField(Header(), dark.views, grid), ideal_of(0))
    small = IdealViews(ideal_of(0).views[:, :, :-1], STEPS)
    with pytest.raises(LightFieldError, match='cannot be compared'):
        compare_views(dark, small)
    np.savez(tmp_path / 'other.npz', pictures=np.zeros(3))
    with pytest.raises(LightFieldError, match='holds no ideal views'):
        IdealViews.load(tmp_path / 'other.npz')
    np.save(tmp_path / 'bare.npy', np.zeros(3))
    (tmp_path / 'cut.npz').write_bytes((tmp_path / 'other.npz').read_bytes()[:40])
    for name in ('bare.npy', 'cut.npz'):
        with pytest.raises(LightFieldError, match='holds no ideal views'):
            IdealViews.load(tmp_path / name)
    np.savez(tmp_path / 'even.npz', views=np.zeros((2, 3, 8, 8, 3), np.uint16))
    with pytest.raises(LightFieldError, match=r'expected .* with a centre view'):
        IdealViews.load(tmp_path / 'even.npz')
