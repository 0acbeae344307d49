"""Contour maps: readings by direction, blur, and the log odds' weight."""

import weakref
from dataclasses import replace

import numpy as np
import pytest
from contour_maps import NUMBERS
from scipy.ndimage import gaussian_filter

from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_map import ContourMap, harmonics
from pmcl_ros.evidence.energies import evidence_across, region_across
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import VolumeError

CAMERA = Pinhole(40, 30, 50.0, 50.0, 19.5, 14.5)
RNG = np.random.default_rng(0)
MAP = ContourMap(Header(), RNG.normal(size=(30, 40, 3, 5)).astype(np.float32),
                 depth_labels(0.3, 0.6, 3), CAMERA,
                 RNG.normal(size=(30, 40, 3)).astype(np.float32), NUMBERS)


def test_a_reading_is_the_weighted_series_of_the_normals_angle():
    angles = np.linspace(0, 2 * np.pi, 7)
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    pixels, depths = np.tile([[12.0, 9.0]], (7, 1)), np.full(7, MAP.depths[1])
    a0, c1, s1, c2, s2 = MAP.tensor[9, 12, 1].astype(float)
    expected = (a0 + c1 * np.cos(angles) + s1 * np.sin(angles) + c2 * np.cos(2 * angles)
                + s2 * np.sin(2 * angles))
    found = evidence_across(MAP, pixels, normals, depths, MAP.profile, np.zeros(1))[:, 0]
    np.testing.assert_allclose(found, NUMBERS.contour_weight * expected, atol=1e-6)
    # Halfway between two pixels and two labels it is their mean.
    depth = 2 / (1 / MAP.depths[0] + 1 / MAP.depths[1])
    mean = MAP.tensor[9, 12:14, :2].astype(float).mean(axis=(0, 1)) @ harmonics(angles[1:2])[0]
    found = evidence_across(MAP, np.array([[12.5, 9.0]]), normals[1:2], np.array([depth]),
                            MAP.profile, np.zeros(1))
    assert found[0, 0] == pytest.approx(NUMBERS.contour_weight * mean, abs=1e-6)


def test_what_a_silhouette_covers_is_the_integral_along_its_normal():
    inside = np.zeros((30, 40, 3), np.float32)
    inside[:, :20, 1], inside[:, 20:, 1] = 25, -12.5  # times the weight 0.02, at one depth
    shifts = np.arange(-4, 4.5, 0.5)
    pixels = np.array([[19.5, 10.0], [500, 10], [-500, 10], [20, 30], [20, -1], [20, 10]])
    depths = MAP.depths[[1, 1, 1, 1, 1, 2]]
    found = region_across(replace(MAP, inside=inside), pixels, np.tile([1.0, 0.0], (6, 1)), depths,
                          shifts)
    expected = np.where(shifts < 0, 0.5 * shifts, -0.25 * shifts)
    np.testing.assert_allclose(found[0], expected, atol=0.2)
    assert not found[1:].any()  # out of view nothing is covered
    assert found.shape == (6, 17)
    assert found[0, 8] == 0


def test_blurred_log_odds_are_those_of_a_contour_somewhere_near():
    same = replace(MAP, tensor=np.broadcast_to(MAP.tensor[5, 5, 1], MAP.tensor.shape).copy())
    np.testing.assert_allclose(same.blurred(2.0).tensor, same.tensor, atol=1e-5)
    # A line that is 6 nat likely, seen from where it is within a blur, and from far off.
    line = np.zeros_like(MAP.tensor)
    line[..., 0], line[:, 20, :, 0] = -2, 6
    blurred = replace(MAP, tensor=line).blurred(2.0).tensor
    ratio = gaussian_filter(np.exp(line[..., 0].astype(float)), (2, 2, 0), mode='mirror')
    np.testing.assert_allclose(blurred[..., 0], np.log(ratio), atol=0.03)
    np.testing.assert_allclose(blurred[..., 1:], 0, atol=1e-4)
    assert 0 < blurred[15, 17, 1, 0] < blurred[15, 20, 1, 0] < 6
    assert blurred[15, 2, 1, 0] == pytest.approx(-2, abs=0.01)


@pytest.mark.parametrize('box', [(10, 8, 25, 20), (-5, -4, 12, 9), (30, 20, 60, 50)], ids=str)
def test_in_a_box_what_is_around_it_counts_too(box):
    whole, part = replace(MAP).blurred(2.0), replace(MAP)
    left, top, right, bottom = box
    inside = np.s_[max(top, 0):bottom, max(left, 0):right]
    np.testing.assert_allclose(part.blurred(2.0, box).tensor[inside], whole.tensor[inside],
                               atol=1e-5)
    np.testing.assert_array_equal(part.blurred(2.0).tensor, whole.tensor)  # and not the box's


def test_a_box_out_of_view_is_no_error():
    for box in ((-40, 5, -20, 9), (5, -40, 9, -20), (90, 5, 95, 9)):
        np.testing.assert_array_equal(replace(MAP).blurred(2.0, box).tensor, MAP.tensor)


def test_a_contour_of_the_coarser_map_is_somewhere_in_a_square_of_pixels():
    assert MAP.coarser is None
    even = MAP.tensor * [1, 0, 0, 0, 0]  # the same in all directions
    off = NUMBERS.model_copy(update={'contour_offset': 0.6})
    coarser = replace(MAP, tensor=even.astype(np.float32), bin_side=3, numbers=off).coarser
    assert coarser.pinhole == CAMERA.crop(0, 0, 39, 30).resized(13, 10)
    assert coarser.coarser is None
    assert coarser.profile.offsets * 3 == pytest.approx([0.6])
    squares = even[:, :39].reshape(10, 3, 13, 3, 3, 5)
    np.testing.assert_allclose(coarser.tensor[..., 0],
                               np.log(np.exp(squares[..., 0]).mean(axis=(1, 3))), atol=1e-5)
    np.testing.assert_allclose(coarser.tensor[..., 1:], 0, atol=1e-5)
    np.testing.assert_allclose(coarser.inside, MAP.inside[:, :39].reshape(
        10, 3, 13, 3, 3).mean(axis=(1, 3)), atol=1e-6)
    # A weak direction is told exactly: by the mean of the square.
    weak = replace(MAP, tensor=0.01 * MAP.tensor, bin_side=3).coarser.tensor
    np.testing.assert_allclose(
        weak, 0.01 * MAP.tensor[:, :39].reshape(10, 3, 13, 3, 3, 5).mean(axis=(1, 3)), atol=3e-4)


def test_of_many_pixels_bands_are_made_one_after_the_other():
    wide = Pinhole(150000, 4, 50.0, 50.0, 0.0, 0.0)
    tensor = np.zeros((4, 150000, 1, 5), np.float32)
    tensor[:, :, 0, 0] = np.arange(4)[:, None] // 2  # a band is of two rows, or of one
    whole = ContourMap(Header(), tensor, MAP.depths[:2], wide,
                       np.zeros((4, 150000, 1), np.float32), NUMBERS, 2)
    np.testing.assert_allclose(whole.coarser.tensor[:, :, 0, 0],
                               np.broadcast_to([[0.0], [1.0]], (2, 75000)), atol=1e-5)
    narrow = replace(whole, tensor=tensor[:, :50], inside=whole.inside[:, :50],
                     pinhole=replace(wide, width=50))
    np.testing.assert_allclose(whole.blurred(0.6).tensor[:, 25], narrow.blurred(0.6).tensor[:, 25],
                               atol=1e-5)


def test_a_part_of_the_pixels_and_suppression():
    grid = PixelGrid.from_crop(CAMERA, (3, 4, 21, 12), 2)
    part = MAP.on(grid)
    np.testing.assert_array_equal(part.tensor, MAP.tensor[4:16:2, 3:24:2])
    np.testing.assert_array_equal(part.inside, MAP.inside[4:16:2, 3:24:2])
    assert part.pinhole == grid.pinhole
    kept = RNG.random((30, 40)).astype(np.float32)
    np.testing.assert_array_equal(MAP.suppressed(kept).tensor[..., 1, 3],
                                  MAP.tensor[..., 1, 3] * kept)


def test_one_label_is_as_the_same_at_each():
    one = replace(MAP, tensor=MAP.tensor[:, :, :1], inside=MAP.inside[:, :, :1])
    each = replace(MAP, tensor=np.repeat(one.tensor, 3, axis=2),
                   inside=np.repeat(one.inside, 3, axis=2))
    angles = RNG.uniform(0, 2 * np.pi, 50)
    points = (RNG.uniform(-2, 42, (50, 2)), np.stack([np.cos(angles), np.sin(angles)], axis=-1),
              RNG.uniform(0.2, 0.8, 50))  # out of view and beyond the labels too
    shifts = np.linspace(-3, 3, 7)
    np.testing.assert_allclose(evidence_across(one, *points, MAP.profile, shifts),
                               evidence_across(each, *points, MAP.profile, shifts), atol=1e-6)
    np.testing.assert_allclose(region_across(one, *points, shifts),
                               region_across(each, *points, shifts), atol=1e-6)
    np.testing.assert_allclose(one.blurred(2.0).tensor[:, :, 0], each.blurred(2.0).tensor[:, :, 2],
                               atol=1e-6)


@pytest.mark.parametrize(('wrong', 'message'), [
    ({'tensor': MAP.tensor[:, :, :2]}, 'contour map has shape'),
    ({'tensor': MAP.tensor[..., :3]}, 'contour map has shape'),
    ({'tensor': MAP.tensor * np.float32(np.nan)}, 'NaN'),
    ({'inside': MAP.inside[:-1]}, 'inside must be finite, of shape'),
    ({'inside': MAP.inside * np.float32(np.inf)}, 'inside must be finite')])
def test_values_that_do_not_fit_are_refused(wrong, message):
    with pytest.raises(VolumeError, match=message):
        replace(MAP, **wrong)


def test_what_is_made_again_is_kept_and_no_more_than_that():
    whole, depths = replace(MAP), depth_labels(0.35, 0.5, 3)
    grids = [PixelGrid.from_crop(CAMERA, (left, 2, 20, 20), 1) for left in (3, 5)]
    first = whole.part(grids[0], depths)
    np.testing.assert_array_equal(first.tensor, whole.on(grids[0]).tensor)
    np.testing.assert_array_equal(first.depths, depths)
    assert whole.part(grids[0], depths) is first
    assert whole.part(grids[0], depth_labels(0.3, 0.5, 3)) is not first
    assert whole.part(grids[0], depths) is not first  # one part at a time
    blurs = [first.blurred(sigma) for sigma in range(1, 9)]
    assert all(first.blurred(sigma) is blurs[sigma - 1] for sigma in range(1, 9))
    kept = weakref.ref(blurs[0])
    del blurs
    assert kept() is not None
    first.blurred(9)
    assert kept() is None  # the oldest went
    assert replace(first).blurred(9) is not first.blurred(9)
