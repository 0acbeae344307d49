"""Maps of the evidence in cells: at any depth, of whole cells, of contours with a side."""

import numpy as np
import pytest

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.proposals.evidence_maps import CELL, maps_at
from pmcl_ros.pmcl.proposals.templates import DIRECTIONS

HEIGHT, WIDTH = 20 * CELL, 25 * CELL
DEPTHS = depth_labels(0.3, 0.6, 3)


def volume_of(tensor):
    return EdgeVolume(Header(), tensor.astype(np.float32), DEPTHS,
                      Pinhole(tensor.shape[1], tensor.shape[0], 300, 300, 50, 40))


@pytest.fixture
def tensor():
    rng = np.random.default_rng(0)
    energies = rng.random((HEIGHT, WIDTH, 3, 3))
    energies[..., 2] = 0.5 * np.sqrt(energies[..., 0] * energies[..., 1])
    return energies


def test_between_two_labels_is_their_mean_and_beyond_them_the_last(tensor):
    volume, depth = volume_of(tensor), 2 / (1 / DEPTHS[0] + 1 / DEPTHS[1])
    mean = volume_of(np.repeat(tensor[:, :, :2].mean(axis=2, keepdims=True), 3, axis=2))
    np.testing.assert_allclose(maps_at(volume, depth), maps_at(mean, depth), atol=1)
    for label, beyond in ((0, 0.9), (2, 0.2)):
        np.testing.assert_array_equal(maps_at(volume, beyond), maps_at(volume, DEPTHS[label]))


def test_cells_are_whole(tensor):
    more = np.pad(tensor, ((0, CELL - 1), (0, CELL - 1), (0, 0), (0, 0)), constant_values=0.7)
    np.testing.assert_array_equal(maps_at(volume_of(more), 0.4), maps_at(volume_of(tensor), 0.4))


def test_an_edge_outside_speaks_against_a_contour_and_one_inside_does_not():
    lines = np.zeros((HEIGHT, WIDTH, 3, 3))
    left, right = 10 * CELL, 12 * CELL
    lines[:, [left, left + 1, right, right + 1], :, 0] = 2
    maps = maps_at(volume_of(lines), 0.4)[:, 10]
    to_the_right, to_the_left = maps[0], maps[DIRECTIONS // 2]
    assert to_the_left[10] > 1.2 * to_the_right[10] > 0
    assert to_the_right[12] > 1.2 * to_the_left[12] > 0
