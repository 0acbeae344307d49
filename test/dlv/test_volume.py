import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import VolumeError

PINHOLE = Pinhole(4, 3, 100.0, 100.0, 1.5, 1.0)
DEPTHS = depth_labels(0.3, 0.9, 5)


@settings(deadline=None)
@given(near=st.floats(0.01, 10), times=st.floats(1.01, 100), count=st.integers(2, 200))
def test_labels_are_from_far_to_near_uniform_in_inverse_depth(near, times, count):
    depths = depth_labels(near, times * near, count)
    assert len(depths) == count
    np.testing.assert_allclose(depths[[0, -1]], [times * near, near])
    steps = np.diff(1 / depths)
    np.testing.assert_allclose(steps, (1 / near - 1 / (times * near)) / (count - 1), rtol=1e-6)


@pytest.mark.parametrize('values', [
    (0.9, 0.3, 5), (0.3, 0.3, 5), (0, 0.9, 5), (-1, 0.9, 5), (0.3, 0.9, 1), (0.3, np.inf, 5),
    (np.nan, 0.9, 5), (0.3, np.nan, 5)])
def test_impossible_labels_are_refused(values):
    with pytest.raises(VolumeError, match='need 0 < near < far and two labels'):
        depth_labels(*values)


def likelihood_of(values=None, depths=DEPTHS):
    values = np.zeros((3, 4, 5), np.float32) if values is None else values
    return DepthLikelihoodVolume(Header(), values, np.asarray(depths, float), PINHOLE)


def edges_of(values=None, depths=DEPTHS):
    values = np.zeros((3, 4, 5, 3), np.float32) if values is None else values
    return EdgeVolume(Header(), values, np.asarray(depths, float), PINHOLE)


@pytest.mark.parametrize('make', [likelihood_of, edges_of])
@pytest.mark.parametrize(('depths', 'reason'), [
    (DEPTHS[::-1], 'far to near'),
    (np.linspace(0.9, 0.3, 5), 'uniform in inverse depth'),
    ([0.9, 0.7, 0.7, 0.5, 0.3], 'far to near'), ([0.5] * 5, 'far to near'),
    ([0.9, 0.7, 0, 0.5, 0.3], 'positive finite'),
    ([0.9, 0.7, -0.5, 0.5, 0.3], 'positive finite'),
    ([np.inf, 0.7, 0.6, 0.5, 0.3], 'positive finite'),
    ([np.nan, 0.7, 0.6, 0.5, 0.3], 'positive finite'),
])
def test_other_labels_are_refused(make, depths, reason):
    with pytest.raises(VolumeError, match=reason):
        make(depths=depths)


def test_one_label_is_refused():
    with pytest.raises(VolumeError, match='at least two'):
        likelihood_of(np.zeros((3, 4, 1), np.float32), [0.5])
    with pytest.raises(VolumeError, match='at least two'):
        edges_of(np.zeros((3, 4, 1, 3), np.float32), [0.5])


@pytest.mark.parametrize(('make', 'shape'), [
    (likelihood_of, (4, 3, 5)), (likelihood_of, (3, 4, 6)), (likelihood_of, (3, 4)),
    (likelihood_of, (3, 4, 1)), (likelihood_of, (3, 4, 5, 3)), (edges_of, (3, 4, 5)),
    (edges_of, (3, 4, 5, 2)), (edges_of, (5, 3, 4, 3))])
def test_another_shape_is_refused(make, shape):
    with pytest.raises(VolumeError, match=r'has shape .*expected \(3, 4, 5'):
        make(np.zeros(shape, np.float32))


@pytest.mark.parametrize('make', [likelihood_of, edges_of])
@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_refused(make, value):
    whole = np.zeros((3, 4, 5, 3) if make is edges_of else (3, 4, 5), np.float32)
    whole.flat[-1] = value
    with pytest.raises(VolumeError, match='NaN or infinity'):
        make(whole)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_depth_map_is_near_the_best_label_and_unknown_where_all_are_alike(seed, part):
    rng = np.random.default_rng(seed)
    likelihood = rng.random((3, 4, 5), np.float32) + 0.01
    flat = rng.random((3, 4)) < part
    likelihood[flat] = 0
    found = likelihood_of(likelihood).depth_map()
    assert found.dtype == np.float32
    np.testing.assert_array_equal(np.isnan(found), flat)
    label = (1 / found - 1 / DEPTHS[0]) / (1 / DEPTHS[1] - 1 / DEPTHS[0])
    assert (np.abs(label - likelihood.argmax(axis=2))[~flat] <= 0.5 + 1e-5).all()
