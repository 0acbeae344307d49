"""Contour maps without a part of what they tell."""

from dataclasses import replace

import numpy as np
from contour_maps import NUMBERS

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.ablations import ablated
from pmcl_ros.evidence.contour_map import ContourMap, harmonics
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole

RNG = np.random.default_rng(0)
SHAPE = 6, 8, 3
MAP = ContourMap(Header(), RNG.normal(size=(*SHAPE, 5)).astype(np.float32),
                 depth_labels(0.3, 0.6, 3), Pinhole(8, 6, 50.0, 50.0, 3.5, 2.5),
                 RNG.normal(size=SHAPE).astype(np.float32), NUMBERS)


def ratios(of: ContourMap, angles):
    return np.exp(of.tensor @ harmonics(angles).T)


def test_without_sides_opposite_normals_are_alike():
    angles = np.linspace(0, 2 * np.pi, 9)
    found = ratios(ablated(MAP, 'map-no-sides'), angles)
    np.testing.assert_allclose(found, ratios(ablated(MAP, 'map-no-sides'), angles + np.pi),
                               rtol=1e-5)
    # A weak direction is told exactly: the mean of the two sides.
    weak = replace(MAP, tensor=0.01 * MAP.tensor)
    mean = (ratios(weak, angles) + ratios(weak, angles + np.pi)) / 2
    np.testing.assert_allclose(ratios(ablated(weak, 'map-no-sides'), angles), mean, rtol=1e-3)


def test_without_directions_each_has_the_mean_ratio():
    found = ablated(MAP, 'map-no-directions')
    np.testing.assert_allclose(found.tensor[..., 1:], 0, atol=1e-5)
    even = 2 * np.pi * np.arange(64) / 64
    np.testing.assert_allclose(np.exp(found.tensor[..., 0]), ratios(MAP, even).mean(axis=-1),
                               rtol=1e-2)


def test_at_one_depth_the_middle_label_stands_for_all():
    found = ablated(MAP, 'map-one-depth')
    np.testing.assert_array_equal(found.tensor, MAP.tensor[:, :, 1:2])
    np.testing.assert_array_equal(found.inside, MAP.inside[:, :, 1:2])


def test_the_inside_counts_where_it_is_asked_for():
    without = replace(MAP, numbers=NUMBERS.model_copy(update={'inside_weight': 0.0}))
    assert not without.region.size
    assert ablated(without, 'map-inside').region.any()


def test_the_coarser_map_is_changed_too():
    large = replace(MAP, bin_side=2)
    whole = large.coarser.tensor
    np.testing.assert_array_equal(ablated(large, 'map-one-depth').coarser.tensor,
                                  whole[:, :, 1:2])
    for row, gone in (('map-no-sides', slice(1, 3)), ('map-no-directions', slice(1, 5))):
        found = ablated(large, row).coarser.tensor
        np.testing.assert_allclose(found[..., gone], 0, atol=1e-5)
        assert np.abs(whole[..., gone]).max() > 0.1


def test_other_rows_read_the_map_as_it_is():
    assert ablated(MAP, 'map') is MAP
