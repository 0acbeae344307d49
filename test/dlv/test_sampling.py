"""Interpolation weights: constants and ramps are kept, and so is the power of noise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.dlv.sampling import SMOOTHER, bilinear_taps, neutral_taps, smoothed

PIXELS = np.arange(-1, 3)
FRACTIONS = np.linspace(0, 1, 41)


@given(st.floats(0, 1))
def test_taps_keep_constants_and_ramps_and_are_symmetric(fraction):
    for taps in (bilinear_taps, neutral_taps):
        found = taps(np.array(fraction))
        assert found.sum() == pytest.approx(1)
        assert found @ PIXELS == pytest.approx(fraction)
        np.testing.assert_allclose(taps(np.array(1 - fraction)), found[::-1], atol=1e-9)


def test_at_a_pixel_the_pixel_is_read():
    for taps in (bilinear_taps, neutral_taps):
        np.testing.assert_allclose(taps(np.array([0.0, 1.0])), [[0, 1, 0, 0], [0, 0, 1, 0]],
                                   atol=1e-12)


def test_noise_keeps_its_power_only_through_neutral_taps():
    # of the whole chain: smoothed white noise, then the taps
    def power(kernel):
        return (np.apply_along_axis(np.convolve, -1, kernel, SMOOTHER) ** 2).sum(axis=-1)

    np.testing.assert_allclose(power(neutral_taps(FRACTIONS)), (SMOOTHER ** 2).sum(), rtol=1e-12)
    # not smoothed, half of it is left half-way: what bilinear sampling does
    assert (bilinear_taps(np.array(0.5)) ** 2).sum() == 0.5


@pytest.mark.parametrize('cycles', [0.05, 0.1, 0.2, 0.25])
def test_neutral_taps_err_less_than_bilinear_ones_at_every_frequency_of_a_view(cycles):
    wave = np.exp(2j * np.pi * cycles * PIXELS)
    truth = np.exp(2j * np.pi * cycles * FRACTIONS)
    error = [np.abs(taps(FRACTIONS) @ wave - truth).max() for taps in (neutral_taps,
                                                                       bilinear_taps)]
    assert error[0] < 0.55 * error[1]


def test_smoothing_keeps_ramps_and_takes_away_what_alternates():
    y, x = np.mgrid[:12, :15].astype(float)
    np.testing.assert_allclose(smoothed(0.3 * x - 0.2 * y)[2:-2, 2:-2],
                               (0.3 * x - 0.2 * y)[2:-2, 2:-2], atol=1e-12)
    checks = smoothed((-1) ** x)
    np.testing.assert_allclose(checks[:, 2:-2], 0, atol=1e-12)
    # level up to where lenslets resolve: a wave of 8 pixels keeps 98 % of its amplitude
    wave = np.cos(2 * np.pi * x / 8)
    np.testing.assert_allclose(smoothed(wave)[:, 2:-2], (1 - np.sin(np.pi / 8) ** 4)
                               * wave[:, 2:-2], atol=1e-9)
