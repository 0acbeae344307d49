"""What an ordinary camera makes of light: where it is, and what each step leaves in it."""

import cv2
import numpy as np
import pytest
from scipy import ndimage

from pmcl_ros.simulation.photograph import MARGIN, photograph

SIDE = 160
DRAWS = 60
MIDDLE = (SIDE - 1) / 2
PLACE = np.indices((SIDE, SIDE)) - MIDDLE
OFF_AXIS = (np.hypot(*PLACE) / np.hypot(MIDDLE, MIDDLE)).astype(np.float32)


def texture(sigma):
    """(SIDE + 2 MARGIN, the same, 3) grey light in which structures have a size [px]."""
    size = SIDE + 2 * MARGIN
    noise = cv2.GaussianBlur(np.random.default_rng(0).normal(size=(size, size)), (0, 0), sigma)
    light = 0.3 * np.exp(0.7 * noise / noise.std())
    return np.repeat(light[..., None], 3, axis=-1).astype(np.float32)


def taken(light, off_axis=None):
    """`DRAWS` cameras' pictures of light; nothing is far from the axis, unless it is told."""
    near = np.zeros((SIDE, SIDE), np.float32)
    return [photograph(np.random.default_rng(seed), light, near if off_axis is None else off_axis)
            for seed in range(DRAWS)]


@pytest.fixture(scope='module')
def pictures():
    return taken(texture(1.0))


def shift(seen, picture):
    """(right, down) by which a grey picture shows what is seen beside its place [px].

    Least squares: any cubic polynomial of what is seen, and its gradient. Phase correlation is off
    by several pixels where noise and blur leave its highest frequencies nothing.
    """
    seen, picture = (cv2.GaussianBlur(each, (0, 0), 2) for each in (seen, picture))
    down, right = np.gradient(seen)
    inner = (slice(12, -12),) * 2  # of no border
    terms = np.stack([np.ones_like(seen), seen, seen ** 2, seen ** 3, right, down], axis=-1)
    of = np.linalg.lstsq(terms[inner].reshape(-1, 6), picture[inner].ravel(), rcond=None)[0]
    return -of[4:] / (of[1] + 2 * of[2] * seen + 3 * of[3] * seen ** 2).mean()


def test_nothing_moves_the_picture():
    light = texture(2.0)
    seen = np.log(light[..., 1]).astype(float)
    inner = (slice(MARGIN, -MARGIN),) * 2
    moved = ndimage.shift(seen, (-0.1, 0.25))[inner]
    np.testing.assert_allclose(shift(seen[inner], moved), [0.25, -0.1], atol=0.01)
    off = [shift(seen[inner], each.mean(axis=-1)) for each in taken(light)]
    assert np.hypot(*np.transpose(off)).max() < 0.1


def test_some_cameras_are_grey(pictures):
    grey = [np.ptp(each, axis=-1).max() == 0 for each in pictures]
    assert np.mean(grey) == pytest.approx(0.15, abs=0.1)
    for each in pictures:
        assert (each.shape, each.dtype) == ((SIDE, SIDE, 3), np.uint8)


def along_one_direction(picture):
    """How much more a grey picture changes along one direction than across it, 0 to 1."""
    grey = picture.mean(axis=-1)
    rows, columns = np.gradient(grey)
    tensor = np.array([[(columns ** 2).mean(), (columns * rows).mean()],
                       [(columns * rows).mean(), (rows ** 2).mean()]])
    low, high = np.linalg.eigvalsh(tensor)
    return (high - low) / (high + low)


def test_some_pictures_are_blurred_by_motion(pictures):
    assert np.mean([along_one_direction(each) > 0.2 for each in pictures]) == pytest.approx(
        0.15, abs=0.1)


def blocks(picture):
    """How many times larger steps are between JPEG's blocks of 8x8 px than within them."""
    step = np.abs(np.diff(picture.mean(axis=-1), axis=1)).mean(axis=0)
    last = np.arange(SIDE - 1) % 8 == 7
    return step[last].mean() / step[~last].mean()


def test_jpeg_leaves_its_blocks_in_most_pictures(pictures):
    found = np.array([blocks(each) for each in pictures])
    assert found.min() > 0.95
    assert (found > 1.05).mean() == pytest.approx(0.5, abs=0.12)  # the best 10 % show none
    assert found.max() > 1.3


def test_half_of_the_pictures_fall_off_towards_the_corners():
    even = np.full((SIDE + 2 * MARGIN, SIDE + 2 * MARGIN, 3), 0.3, np.float32)
    ring = (8 * OFF_AXIS).astype(int).clip(max=7).ravel()
    fall = np.array([np.bincount(ring, each.mean(axis=-1).ravel()) / np.bincount(ring)
                     for each in taken(even, OFF_AXIS)])
    fall /= fall[:, :1]  # from the middle to the corners
    assert np.diff(fall, axis=1).max() < 0.01
    assert (fall[:, -1] < 0.98).mean() == pytest.approx(0.45, abs=0.12)  # some hardly
    assert 0.5 < fall[:, -1].min() < 0.8
