"""Pictures too large for the memory have larger pixels; what cannot have them is refused."""

from dataclasses import replace

import numpy as np
import pytest

from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evidence.binning import (
    MOST_PIXELS,
    binned,
    binned_to_fit,
    check_memory,
    drawable,
)
from pmcl_ros.evidence.build_map import build_map
from pmcl_ros.evidence.edges import view_edges
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.runtime.errors import VolumeError

SETTINGS = DlvSettings()


def view(width, height):
    row = np.linspace(0, 1, width, dtype=np.float32)
    picture = np.repeat(np.repeat(row[None, :, None], height, axis=0), 3, axis=2)
    pinhole = Pinhole(width, height, 900.0, 900.0, 100.0, 50.0)
    return PosedView(Header(stamp_ns=7), picture, pinhole)


def test_a_picture_that_fits_is_left_as_it_is():
    seen = view(MOST_PIXELS // 1024, 1024)
    assert binned_to_fit(seen, SETTINGS) is seen


def test_a_larger_picture_shows_the_same_with_fewer_pixels():
    seen = view(2500, 1800)
    found = binned_to_fit(seen, SETTINGS)
    assert found.pinhole == seen.pinhole.resized(1250, 900)
    np.testing.assert_allclose(found.picture[7, :, 1], seen.picture[0].mean(axis=1).reshape(
        -1, 2).mean(axis=1), atol=1e-6)
    assert binned_to_fit(found, SETTINGS) is found
    point = np.array([[0.1, 0.2, 0.9]])
    np.testing.assert_allclose(found.pinhole.project(point) + 0.5,
                               (seen.pinhole.project(point) + 0.5) / 2)


def test_each_of_several_views_is_made_to_fit():
    small, large, between = view(640, 480), view(4032, 3024), view(2500, 1800)
    found = binned_to_fit(PosedViews((small, large, between)), SETTINGS)
    assert found.views[0] is small
    assert found.views[2].pinhole == binned_to_fit(between, SETTINGS).pinhole
    assert found.views[1].pinhole == binned(large, 3).pinhole


def test_many_views_are_made_to_fit_together():
    one = view(1280, 960)
    assert binned_to_fit(PosedViews((one,) * 13), SETTINGS).views == (one,) * 13
    found = binned_to_fit(PosedViews((one,) * 14), SETTINGS)
    assert [each.pinhole for each in found.views] == [one.pinhole.resized(640, 480)] * 14


def test_a_part_that_was_cut_out_keeps_its_pixels():
    seen = view(2500, 1800)
    assert binned_to_fit(seen, SETTINGS.model_copy(update={'crop': (10, 20, 640, 480)})) is seen


def test_what_does_not_fit_is_refused_before_it_is_made():
    seen = view(6000, 3000)
    for build in (build_map, view_edges):
        with pytest.raises(VolumeError, match=r'6000x3000 px at 2 depths needs 3\.4 GiB, more '
                           r'than 3: make pixels 2 times as large'):
            build(seen, SETTINGS)
    part = SETTINGS.model_copy(update={'crop': (0, 0, 64, 64)})
    assert build_map(seen, part).tensor.shape == (64, 64, 1, 5)
    check_memory(replace(PixelGrid.from_crop(seen.pinhole, (0, 0, 0, 0), 1), width=3000), 3)


@pytest.mark.parametrize('side', [100, 101, 196, 1000, 1001])
def test_a_part_that_begins_within_a_pixel_is_drawable_too(side):
    seen = view(1100, 1000)
    found = drawable(seen, side, 100)
    larger = round(seen.pinhole.fx / found.pinhole.fx)
    assert (found is seen) == (side <= 100)
    assert larger == 1 or side / larger + 2 <= 100
