import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmcl_ros.lightfield.lenslets import sample_lenslets

RADIUS = 5.0
CENTRE = np.array([[[15.3, 14.8]]])  # a lenslet in the middle of a sensor of 30 x 32 px
OFFSETS = np.array([(x, y) for x in range(-4, 5) for y in range(-4, 5) if x * x + y * y < 22],
                   float)
V, U = np.indices((32, 30))


def mosaic_of(red, green, blue):
    """BGGR of three values or images."""
    mosaic = np.where((V + U) % 2 == 1, green, np.where(V % 2 == 1, red, blue))
    return mosaic.astype(np.float32)


def test_a_constant_colour_is_reproduced_and_each_colour_read_at_its_own_pixels():
    # Centres all over the sensor and around it.
    centres = np.stack(np.meshgrid(np.arange(-12, 42, 1.7), np.arange(-12, 44, 1.3)), axis=-1)
    samples = sample_lenslets(mosaic_of(0.25, 0.5, 2), centres, OFFSETS, RADIUS)
    assert samples.shape == (len(OFFSETS), *centres.shape[:2], 3)
    assert samples.dtype == np.float32
    known = np.isfinite(samples)
    assert (known.all(-1) == known.any(-1)).all()
    colour = np.broadcast_to(np.float32([0.25, 0.5, 2]), samples.shape)
    np.testing.assert_allclose(samples[known], colour[known], rtol=1e-6)
    # Known wherever the sensor reaches a pixel around the sample, unknown wherever 2 px away.
    place = centres + OFFSETS[:, None, None]
    beyond = np.maximum(-place, place - np.array([29, 31])).max(-1)
    assert known[beyond <= -1].all()
    assert not known[beyond >= 2].any()


@settings(max_examples=50, deadline=None)
@given(x=st.floats(14, 16), y=st.floats(14, 16))
def test_only_the_lenslets_own_disc_is_read(x, y):
    distance = np.hypot(U - x, V - y)
    neighbours = np.where(distance > RADIUS + 0.5, 1e6, 0.5).astype(np.float32)
    samples = sample_lenslets(neighbours, np.array([[[x, y]]]), OFFSETS, RADIUS)
    np.testing.assert_allclose(samples, 0.5, rtol=1e-6)


def test_the_disc_is_read_up_to_its_edge():
    rim = np.where(np.hypot(*(np.stack([U, V], -1) - CENTRE[0, 0]).T).T > RADIUS - 0.5, 1, 0)
    samples = sample_lenslets(rim.astype(np.float32), CENTRE, OFFSETS, RADIUS)[:, 0, 0]
    outer = np.linalg.norm(OFFSETS, axis=1) > 3.9
    assert (samples[outer].max(-1) > 0.1).all()
    assert not samples[np.linalg.norm(OFFSETS, axis=1) < 1.5].any()


@given(st.tuples(*[st.floats(-1, 1)] * 9), st.floats(14, 16), st.floats(14, 16))
@settings(max_examples=50, deadline=None)
def test_linear_functions_are_reproduced_where_all_around_is_in_the_disc(slopes, x, y):
    level, across, down = np.reshape(slopes, (3, 3))
    planes = [level[k] + across[k] * U + down[k] * V for k in range(3)]
    inner = OFFSETS[np.linalg.norm(OFFSETS, axis=1) <= RADIUS + 0.5 - 2 * np.sqrt(2)]
    assert len(inner) >= 21
    samples = sample_lenslets(mosaic_of(*planes), np.array([[[x, y]]]), inner, RADIUS)[:, 0, 0]
    place = inner + np.array([x, y])
    expected = level + np.outer(place[:, 0], across) + np.outer(place[:, 1], down)
    np.testing.assert_allclose(samples, expected, atol=2e-5)


@pytest.mark.parametrize('corner', [(0, 0), (29, 0), (0, 31), (29, 31)])
def test_nothing_is_read_from_the_other_side_of_the_sensor(corner):
    far = np.where(np.hypot(U - corner[0], V - corner[1]) > 10, 1e6, 0.5).astype(np.float32)
    centres = np.array([[[corner[0] + 0.2, corner[1] - 0.3]]])
    samples = sample_lenslets(far, centres, OFFSETS, RADIUS)
    known = np.isfinite(samples)
    assert known.any()
    assert not known.all()
    np.testing.assert_allclose(samples[known], 0.5, rtol=1e-6)
