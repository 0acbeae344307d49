from pathlib import Path

import cv2
import numpy as np
import pytest

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.mosaic_image import is_mosaic_image, read_mosaic_image
from pmcl_ros.geometry.header import Header
from pmcl_ros.runtime.errors import CameraError

REAL = Path(__file__).parents[1] / 'data/real_mosaics'


@pytest.fixture
def levels():
    values = np.random.default_rng(0).integers(20, 200, (60, 40), np.uint8)
    values[:5] = 12  # dark
    values[10, 10] = 255
    return values


@pytest.fixture
def path(levels, tmp_path):
    assert cv2.imwrite(str(tmp_path / 'mosaic.png'), levels)
    return tmp_path / 'mosaic.png'


@pytest.mark.parametrize('gain', [1, 1.5, 2.25])
def test_counts_are_the_levels_without_the_gain(path, levels, gain):
    frame = read_mosaic_image(path, gain)
    np.testing.assert_allclose(frame.counts, levels * 16.0 / gain, atol=0.5)
    assert frame.metadata.white == round(255 * 16 / gain) == frame.counts.max()
    assert frame.metadata.black == round(12 * 16 / gain)
    assert frame.metadata.image.width == 40


def test_a_gain_below_one_stays_in_twelve_bits(path):
    frame = read_mosaic_image(path, 0.5)
    assert frame.metadata.white == frame.counts.max() == 4095


def test_metadata_are_marked_as_derived(path):
    metadata = read_mosaic_image(path, 1.5).metadata
    assert CameraMetadata.parse(metadata.text) == metadata
    assert '"derived"' in metadata.text
    assert '"mosaic.png"' in metadata.text
    assert metadata.serial == ''
    colour = metadata.image.color
    # Of a real F01's metadata: grey stays grey.
    np.testing.assert_allclose(np.reshape(colour.ccmRgbToSrgbArray, (3, 3)).sum(axis=1), 1,
                               atol=1e-4)
    assert colour.gamma == 0.41666
    gains = colour.whiteBalanceGain
    assert (gains.r, gains.gr, gains.gb, gains.b) == (1, 1, 1, 1)


def test_the_stamp_is_the_files(path):
    assert read_mosaic_image(path).header == Header(path.stat().st_mtime_ns)


def test_a_real_mosaic():
    frame = read_mosaic_image(REAL / 'IMG_2.jpg', 1.5)
    assert frame.counts.shape == (3280, 3280)
    # Between lenslets that see a dark scene; the camera's own black level is 168.
    assert 100 < frame.metadata.black < 180
    assert (frame.counts < frame.metadata.black).mean() < 0.02


@pytest.mark.parametrize(('name', 'expected'), [
    ('a.png', True), ('a.JPG', True), ('a.jpeg', True), ('a.RAW', False), ('a.RAW.xz', False)])
def test_which_files_are_mosaic_images(name, expected):
    assert is_mosaic_image(Path('somewhere') / name) is expected


@pytest.mark.parametrize(('image', 'told'), [
    (np.zeros((20, 20, 3), np.uint8), '3 channels of uint8'),
    (np.zeros((20, 20), np.uint16), '1 channels of uint16'),
    (np.full((20, 20), 255, np.uint8), 'black level of 255'),
])
def test_other_images_are_refused(tmp_path, image, told):
    cv2.imwrite(str(tmp_path / 'other.png'), image)
    with pytest.raises(CameraError, match=told):
        read_mosaic_image(tmp_path / 'other.png')


@pytest.mark.parametrize(('data', 'told'), [
    (b'', 'it is no picture: PNG'), (b'no image', 'it is no picture: PNG'),
    (b'\x89PNG\r\n\x1a\n', 'the picture is cut short')])
def test_what_is_no_image_is_refused(tmp_path, data, told):
    (tmp_path / 'broken.png').write_bytes(data)
    with pytest.raises(CameraError, match=told):
        read_mosaic_image(tmp_path / 'broken.png')


def test_a_missing_file_and_an_impossible_gain(path):
    with pytest.raises(CameraError, match='cannot read'):
        read_mosaic_image(path.with_name('none.png'))
    with pytest.raises(CameraError, match='gain of 0'):
        read_mosaic_image(path, 0)
