"""The network that the package ships: what it finds, what it takes, what it refuses."""

import logging

import cv2
import numpy as np
import onnx
import pytest

from pmcl_ros.evidence.contour_net import MOST_PIXELS, contour_net, read_network
from pmcl_ros.evidence.learned import learned_file
from pmcl_ros.runtime.errors import PictureError, SettingsError
from pmcl_ros.simulation.labelled_pictures import PictureSettings, labelled_picture

# All that is used; OpenCV 4.6's dnn has these.
OPERATORS = {'Conv': {'kernel_shape', 'strides', 'pads'}, 'Relu': set(), 'Concat': {'axis'},
             'MaxPool': {'kernel_shape', 'strides'}, 'ConvTranspose': {'kernel_shape', 'strides'}}
# None of those it was trained on; a mean of odds ratios needs some.
SEEDS = 1_000_000, 1_000_001, 1_000_003


# [nat] by which the map may depend on the number of threads: OpenCV divides the work among them
# from 4.7 on so that it does not.
ROUNDING = 0 if tuple(map(int, cv2.__version__.split('.')[:2])) >= (4, 7) else 1e-5

# Of the shipped network, by OpenCV 5.0 [nat]: in a disc, on its contour, at two corners.
ROWS, COLUMNS = [52, 17, 52, 87, 80, 60, 3, 111], [70, 70, 106, 70, 95, 60, 3, 143]
STORED = [[-7.39632, 0.53632, -0.36714, -1.30909, 0.39245, 13.69446],
          [-1.85867, 0.16732, -2.21867, -3.68333, -0.46563, 2.97173],
          [-0.56695, 2.50100, -0.36632, 6.88825, 0.12026, 0.94987],
          [-1.36385, -0.44038, 1.51850, -4.95038, -0.20706, 5.85855],
          [-4.58930, 1.83869, 2.82093, -0.93488, 3.31848, -1.70340],
          [-7.97045, 0.27619, -0.23312, -0.69667, -0.74165, 16.03715],
          [-0.74232, 0.16602, -0.78390, -1.01219, 2.30193, -0.11519],
          [-3.18915, 0.64476, -0.19169, -0.38864, 0.00320, -1.40065]]


@pytest.fixture(scope='module')
def pictures():
    of = PictureSettings(largest=192, clutter=3)
    return [labelled_picture(seed, of) for seed in SEEDS]


def ratio(out, angle):
    """Log odds ratio of a contour at (..., 6) outputs, for angles of the outward normal."""
    basis = [np.ones_like(angle), np.cos(angle), np.sin(angle), np.cos(2 * angle),
             np.sin(2 * angle)]
    return (out[..., :5] * np.stack(basis, -1)).sum(-1)


def test_contours_of_generated_pictures_light_up_on_the_right_side(pictures):
    at, behind, elsewhere, inside, outside = ([] for _ in range(5))
    for each in pictures:
        out = contour_net()(each.picture)
        there = each.direction >= 0
        angle = 2 * np.pi * each.direction[there] / 32
        at.append(ratio(out[there], angle))
        behind.append(ratio(out[there], angle + np.pi))
        elsewhere.append(ratio(out[~there], np.zeros((~there).sum())))
        inside.append(out[..., 5][each.inside])
        outside.append(out[..., 5][~each.inside])
    at, behind, elsewhere, inside, outside = map(np.concatenate, (at, behind, elsewhere, inside,
                                                                  outside))
    assert np.median(at) > 3
    assert np.median(at) > np.median(behind) + 2
    assert np.median(elsewhere) < -2
    assert np.median(inside) > np.median(outside) + 1
    # Odds ratios of nothing but chance have the mean 1 where there is no contour.
    assert np.exp(elsewhere).mean() < 2


def test_versions_of_opencv_give_the_same_numbers():
    """The numbers are stored, as no environment has two versions; another network has others.

    The picture is made of integers alone, so that it is the same everywhere.
    """
    y, x = np.mgrid[:112, :144]
    disc = (x - 70) ** 2 + (y - 52) ** 2 < 36 ** 2
    shades = np.stack([60 + x // 3, 70 + y // 2, 50 + (x + y) // 4], axis=-1)
    around = (150 + (7 * x + 13 * y + x * y // 9) % 61)[..., None] - [0, 20, 45]
    picture = np.where(disc[..., None], shades, around).astype(np.uint8)
    found = contour_net()(picture)[ROWS, COLUMNS]
    np.testing.assert_allclose(found, STORED, rtol=0, atol=1e-4)


def test_one_colour_shows_no_contour():
    out = contour_net()(np.full((200, 240, 3), 120, np.uint8))
    assert out[..., 0].max() < 1


@pytest.mark.parametrize('shape', [(200, 300), (328, 328), (241, 333)])
def test_forms_of_one_picture_give_one_map(shape):
    grey = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    expected = contour_net()(grey)
    assert (expected.shape, expected.dtype) == ((*shape, 6), np.float32)
    np.testing.assert_array_equal(contour_net()(np.repeat(grey[..., None], 3, -1)), expected)
    np.testing.assert_allclose(contour_net()(grey / 255), expected, atol=1e-4)
    np.testing.assert_array_equal(contour_net()(np.asfortranarray(grey)), expected)


def test_the_digits_do_not_depend_on_threads_or_earlier_pictures(pictures):
    picture = pictures[0].picture
    expected = contour_net()(picture)
    threads = cv2.getNumThreads()
    try:
        for number in (1, 2, 3):
            cv2.setNumThreads(number)
            np.testing.assert_allclose(contour_net()(picture), expected, rtol=0, atol=ROUNDING)
            contour_net()(picture[:150])
    finally:
        cv2.setNumThreads(threads)


def test_a_large_picture_is_reduced_and_its_map_enlarged():
    rng = np.random.default_rng(2)
    small = cv2.GaussianBlur(rng.integers(0, 256, (512, 1024, 3), np.uint8), (0, 0), 2)
    large = np.repeat(np.repeat(small, 2, 0), 2, 1)
    assert small.shape[0] * small.shape[1] * 2 == MOST_PIXELS
    half = cv2.resize(large, (1448, 724), interpolation=cv2.INTER_AREA)
    out = contour_net()(large)
    assert out.shape == (1024, 2048, 6)
    again = cv2.resize(out[..., 0], (1448, 724))
    assert np.corrcoef(again.ravel(), contour_net()(half)[..., 0].ravel())[0, 1] > 0.95


@pytest.mark.parametrize(('picture', 'reason'), [
    (np.zeros((0, 0, 3), np.uint8), 'must have 32 to 8192 px a side, it has 0x0'),
    (np.zeros((300, 8), np.uint8), 'must have 32 to 8192 px a side, it has 8x300'),
    (np.zeros((64, 64, 4), np.uint8), r'must be \(height, width, 3\) or .* it is \(64, 64, 4\)'),
    (np.zeros(64, np.uint8), r'it is \(64,\)'),
    (np.zeros((64, 64), np.uint16), 'must be uint8, or float of 0 to 1; it is uint16'),
    (np.full((64, 64), np.nan), 'values must be 0 to 1, they are nan to nan'),
    (np.full((64, 64, 3), 200.0), 'values must be 0 to 1, they are 200 to 200'),
])
def test_what_is_no_picture_gets_one_line(picture, reason):
    with pytest.raises(PictureError, match=reason) as caught:
        contour_net()(picture)
    assert '\n' not in str(caught.value)


def test_the_log_says_which_network_once(caplog):
    contour_net.cache_clear()
    with caplog.at_level(logging.INFO):
        net = contour_net()
        assert contour_net() is net
    lines = [each.getMessage() for each in caplog.records]
    assert lines == [f'contour map: network {net.learned.version} of {net.path}']


def test_the_file_has_operators_of_opencv_4_6_alone():
    path = learned_file('contour_map.onnx')
    assert path.stat().st_size < 3e6
    model = onnx.load(path)
    assert (model.ir_version, [each.version for each in model.opset_import]) == (6, [11])
    for node in model.graph.node:
        attributes = {each.name: list(each.ints) for each in node.attribute}
        assert set(attributes) <= OPERATORS[node.op_type], node.name
        assert len(set(attributes.get('pads', [0]))) == 1  # the same on all sides


def test_bytes_that_are_no_network_are_refused():
    with pytest.raises(SettingsError, match='cannot read the network of the contour map'):
        read_network(b'no network')
