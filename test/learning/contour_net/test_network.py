"""The network's loss is that of its definition; OpenCV computes what Keras does."""

import cv2
import keras
import numpy as np
import onnx
import pytest

from pmcl_ros.evidence.contour_map import harmonics
from pmcl_ros.evidence.contour_net import contour_net, network_input
from pmcl_ros.evidence.learned import learned_file
from pmcl_ros.learning.contour_net.directions import direction_targets
from pmcl_ros.learning.contour_net.network import (
    POSITIVE_WEIGHT,
    FusedNormalization,
    build,
    losses,
    normalise,
)
from pmcl_ros.learning.contour_net.onnx_file import read, write
from pmcl_ros.runtime.errors import SettingsError


@pytest.fixture(scope='module')
def network():
    keras.utils.set_random_seed(3)
    built = build()
    rng = np.random.default_rng(3)
    built.set_weights([rng.uniform(0.5, 1.5, each.shape) if each.ndim == 1 else each
                       for each in built.get_weights()])
    return built


@pytest.fixture(scope='module')
def file(network, tmp_path_factory):
    path = tmp_path_factory.mktemp('onnx') / 'map.onnx'
    write(network, path)
    return path


@pytest.mark.parametrize('shape', [(32, 48), (176, 160)])
def test_opencv_computes_what_keras_does(network, file, shape):
    rng = np.random.default_rng(0)
    picture = rng.random((1, *shape, 3), np.float32) - np.float32(0.5)
    expected = network.predict(picture, verbose=0)[0]
    net = cv2.dnn.readNetFromONNX(str(file))
    net.setInput(picture.transpose(0, 3, 1, 2).copy())
    out = net.forward()[0].transpose(1, 2, 0)
    assert out.shape == (*shape, 6)
    np.testing.assert_allclose(out, expected, atol=1e-4 * np.abs(expected).max())


def test_a_file_that_is_read_is_the_network_again(network, file, tmp_path):
    pictures = np.random.default_rng(0).random((3, 64, 96, 3), np.float32) - np.float32(0.5)
    expected = network.predict(pictures, verbose=0)
    close = {'atol': 1e-4 * np.abs(expected).max()}
    again = build()
    read(file.read_bytes(), again)
    np.testing.assert_allclose(again.predict(pictures, verbose=0), expected, **close)
    # Training normalises by the batch, whose statistics it has been told.
    apart = np.abs(again(pictures, training=True) - expected).max()
    read(file.read_bytes(), again)
    normalise(again, [pictures[:1], pictures[1:2], pictures[2:]])
    np.testing.assert_allclose(again.predict(pictures, verbose=0), expected, **close)
    assert np.abs(again(pictures, training=True) - expected).max() < 0.01 * apart
    write(again, tmp_path / 'again.onnx')
    third = build()
    read((tmp_path / 'again.onnx').read_bytes(), third)
    np.testing.assert_allclose(third.predict(pictures, verbose=0), expected, **close)


def test_the_shipped_network_can_be_trained_further():
    shipped = learned_file('contour_map.onnx')
    network = build()
    read(shipped.read_bytes(), network)
    picture = np.random.default_rng(0).random((64, 96, 3), np.float32)
    expected = contour_net().logits(picture)
    np.testing.assert_allclose(network.predict(network_input(picture)[None], verbose=0)[0],
                               expected, atol=1e-3)


def test_a_file_of_another_network_is_refused(file, tmp_path):
    other = tmp_path / 'other.onnx'
    write(build((8, 8, 16, 16)), other)
    data, network = file.read_bytes(), build()
    changed = onnx.load_from_string(data)
    changed.graph.node[1].op_type = 'Sigmoid'
    endless = onnx.load_from_string(data)
    endless.graph.initializer[0].raw_data = np.full(
        endless.graph.initializer[0].dims, np.nan, np.float32).tobytes()
    short = onnx.load_from_string(data)
    short.graph.initializer[0].raw_data = b'1234'
    untyped = onnx.load_from_string(data)
    untyped.graph.initializer[0].data_type = 0
    for bad, reason in ((other.read_bytes(), 'no network of the form'),
                        (changed.SerializeToString(), 'no network of the form'),
                        (untyped.SerializeToString(), 'no network of the form'),
                        (endless.SerializeToString(), 'no finite numbers'),
                        (short.SerializeToString(), 'cannot read the network: '),
                        (data[:1000], 'cannot read the network: '), (b'', 'no network of the')):
        with pytest.raises(SettingsError, match=reason):
            read(bad, network)


def test_the_normalisation_is_that_of_keras():
    inputs = np.random.default_rng(0).normal(3, 2, (4, 6, 5, 8)).astype(np.float32)
    layers = [kind(momentum=0.9) for kind in (FusedNormalization,
                                              keras.layers.BatchNormalization)]
    for training in (True, False):
        fused, plain = (layer(inputs, training=training).numpy() for layer in layers)
        np.testing.assert_allclose(fused, plain, atol=1e-4, rtol=0.01)
    for one, other in zip(*(layer.get_weights() for layer in layers), strict=True):
        np.testing.assert_allclose(one, other, rtol=0.01)  # n - 1 for n in the variance


def test_each_label_counts_twice_in_16_directions():
    shares = direction_targets(np.arange(0, 32, 2))
    np.testing.assert_array_equal(shares[0], 0)
    np.testing.assert_array_equal(shares[1:].sum(1), 2)
    assert shares[1 + 4].tolist()[:5] == [0, 0.5, 1, 0.5, 0]  # 45 degrees


def test_the_loss_is_the_weighted_cross_entropy_of_directions():
    rng = np.random.default_rng(1)
    out = rng.normal(size=(2, 3, 4, 6)).astype(np.float32)
    direction = rng.integers(-1, 32, (2, 3, 4)).astype(np.int8)
    inside = rng.random((2, 3, 4)) < 0.5
    contour, region = losses(out, direction, inside, 3)
    directions = np.arange(3, 32, 4)
    chance = 1 / (1 + np.exp(-out[..., :5] @ harmonics(2 * np.pi * directions / 32).T))
    share = direction_targets(directions)[direction + 1]
    expected = -(POSITIVE_WEIGHT * share * np.log(chance) + (1 - share) * np.log(1 - chance))
    assert float(contour) == pytest.approx(expected.sum(-1).mean(), rel=1e-5)
    chance = 1 / (1 + np.exp(-out[..., 5]))
    assert float(region) == pytest.approx(-np.log(np.where(inside, chance, 1 - chance)).mean(),
                                          rel=1e-5)
