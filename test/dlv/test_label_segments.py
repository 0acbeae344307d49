"""LabelSegments: every label is in one, and their quadratics are what they claim to be."""

import numpy as np
import pytest
from dlv_fields import Texture, make_grid
from hypothesis import given, settings
from hypothesis import strategies as st

from pmcl_ros.dlv.label_segments import LabelSegments
from pmcl_ros.dlv.volume import depth_labels


def shifts_of(labels=75, scale=0.5, near=0.3):
    positions = make_grid((3, 7), jitter=0.05).positions.reshape(-1, 1, 2)
    return -scale * positions / depth_labels(near, 0.9, labels)[:, None]


def lagrange(t):
    """Weights of the three nodes at time t."""
    return np.stack([(2 * t - 1) * (t - 1), 4 * t * (1 - t), t * (2 * t - 1)], axis=-1)


@settings(max_examples=50, deadline=None)
@given(labels=st.integers(3, 90), scale=st.floats(0, 3), near=st.floats(0.1, 0.89),
       make=st.sampled_from([LabelSegments.bilinear, LabelSegments.neutral]))
def test_every_label_is_once_in_a_run_and_between_its_nodes(labels, scale, near, make):
    shifts = shifts_of(labels, scale, near)
    runs = make(shifts)
    seen = np.zeros(shifts.shape[:2], int)
    for pair, first, end, node in runs.where:
        seen[pair, first:end] += 1
        t = runs.time[pair, first:end].astype(float)
        assert (t > -1e-5).all()
        assert (t < 1 + 1e-5).all()
        np.testing.assert_allclose(lagrange(t) @ runs.places[node:node + 3],
                                   shifts[pair, first:end], atol=1e-5)
    assert (seen == 1).all()
    assert (np.abs(runs.taps.sum(axis=2) - 1) < 1e-6).all()


def test_bilinear_runs_stay_in_a_cell_and_neutral_ones_are_a_pixel_at_most():
    shifts = shifts_of()
    bilinear, neutral = LabelSegments.bilinear(shifts), LabelSegments.neutral(shifts)
    for _, _, _, node in bilinear.where:
        place = bilinear.places[node:node + 3] - bilinear.cells[node:node + 3]
        assert (place > -1e-9).all()
        assert (place < 1 + 1e-9).all()
    for _, _, _, node in neutral.where:
        steps = np.linalg.norm(np.diff(neutral.places[node:node + 3], axis=0), axis=1)
        assert (steps <= 0.5 + 1e-9).all()
    # Neighbouring runs of a pair share a node.
    pair, node = neutral.where[:, 0], neutral.where[:, 3]
    assert (np.diff(node)[np.diff(pair) == 0] == 2).all()


@pytest.mark.parametrize(('make', 'tolerance'),
                         [(LabelSegments.bilinear, 0.06), (LabelSegments.neutral, 0.02)])
def test_taps_and_quadratics_read_a_texture_where_it_is(make, tolerance):
    texture = Texture(3, highest=0.15)
    shifts = shifts_of(31)
    runs = make(shifts)
    offsets = np.arange(-1, 3)
    for pair, first, end, node in runs.where:
        x = (40 + runs.cells[node:node + 3, 0])[:, None, None] + offsets
        y = (40 + runs.cells[node:node + 3, 1])[:, None, None] + offsets[:, None]
        pixels = texture(*np.broadcast_arrays(x.astype(float), y.astype(float)))
        nodes = np.einsum('nyxc,nx,ny->nc', pixels, runs.taps[node:node + 3, 0],
                          runs.taps[node:node + 3, 1])
        read = lagrange(runs.time[pair, first:end].astype(float)) @ nodes
        truth = texture(*(40 + shifts[pair, first:end].T))
        assert np.abs(read - truth).max() < tolerance
