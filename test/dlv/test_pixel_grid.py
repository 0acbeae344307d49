import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import VolumeError

WHOLE = Pinhole(40, 30, 100.0, 110.0, 19.2, 14.9)
CROPS = st.tuples(st.integers(0, 39), st.integers(0, 29), st.integers(0, 40), st.integers(0, 30))


def lattices():
    return st.builds(
        lambda crop, stride: PixelGrid.from_crop(
            WHOLE, (crop[0], crop[1], min(crop[2], 40 - crop[0]), min(crop[3], 30 - crop[1])),
            stride), CROPS, st.integers(1, 8))


@given(lattices(), st.tuples(*[st.floats(-0.2, 0.2)] * 2, st.floats(0.3, 2)))
def test_its_camera_sees_a_point_at_the_pixel_that_is_there(lattice, point):
    pinhole = lattice.pinhole
    assert (pinhole.width, pinhole.height) == (len(lattice.columns), len(lattice.rows))
    u, v = WHOLE.project(np.array(point))
    i, j = pinhole.project(np.array(point))
    assert lattice.left + lattice.stride * i == pytest.approx(u)
    assert lattice.top + lattice.stride * j == pytest.approx(v)


@given(lattices(), st.integers(0, 5))
def test_a_grown_lattice_has_the_same_pixels_and_more_around(lattice, steps):
    more = lattice.grown(steps)
    rows, columns = lattice.within(more)
    np.testing.assert_array_equal(more.columns[columns], lattice.columns)
    np.testing.assert_array_equal(more.rows[rows], lattice.rows)
    assert more.columns[0] >= 0
    assert more.columns[-1] < WHOLE.width
    # as many as asked for, or up to the image's end
    assert columns.start == steps or more.left < lattice.stride
    missing = WHOLE.height - 1 - more.rows[-1]
    assert len(more.rows) - rows.stop == steps or missing < lattice.stride


def test_the_whole_image_is_its_own_camera():
    assert PixelGrid.from_crop(WHOLE, (0, 0, 0, 0), 1).pinhole == WHOLE


@pytest.mark.parametrize('crop', [(40, 0, 0, 0), (0, 31, 0, 0), (30, 0, 11, 0), (0, 0, 0, 31)])
def test_a_crop_outside_the_image_is_refused(crop):
    with pytest.raises(VolumeError, match=r'crop .* reaches out of views of 40x30 px'):
        PixelGrid.from_crop(WHOLE, crop, 1)
