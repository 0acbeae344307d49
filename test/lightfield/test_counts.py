"""Counts against numpy, and there and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.lightfield.counts import VIEW_WHITE, linear_views, mosaic_of_views, views_of_mosaic

SIZES = st.tuples(*[st.integers(1, 5)] * 4)


@pytest.mark.parametrize('kind', [np.uint8, np.uint16])
def test_linear_values_are_parts_of_white(kind):
    counts = np.random.default_rng(0).integers(0, np.iinfo(kind).max, (2, 3, 5, 4, 3), kind)
    np.testing.assert_allclose(linear_views(counts, 255), counts / 255, rtol=3e-7)
    np.testing.assert_array_equal(linear_views(counts[:, ::2, :, 1:], 255),
                                  linear_views(counts, 255)[:, ::2, :, 1:])


@given(SIZES)
def test_a_mosaic_has_each_view_in_its_place(size):
    rows, columns, height, width = size
    mosaic = np.random.default_rng(1).integers(0, 65535, (rows * height, columns * width, 3),
                                               np.uint16)
    views = views_of_mosaic(mosaic, rows, columns)
    assert (views.dtype, views.shape) == (np.float32, (*size, 3))
    for row, column in np.ndindex(rows, columns):
        tile = mosaic[row * height:(row + 1) * height, column * width:(column + 1) * width]
        np.testing.assert_array_equal(views[row, column], tile / np.float32(VIEW_WHITE))
    np.testing.assert_array_equal(mosaic_of_views(views), mosaic)


def test_what_counts_cannot_hold_is_clipped():
    views = np.array([-0.1, 0.0, 1.0, 2.5, 1.0, 1.0], np.float32).reshape(1, 1, 1, 2, 3)
    assert mosaic_of_views(views).ravel().tolist() == [0, 0, VIEW_WHITE, 65535, VIEW_WHITE,
                                                       VIEW_WHITE]
