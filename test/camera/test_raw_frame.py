import json

import numpy as np
import pytest

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.runtime.errors import CameraError


@pytest.fixture
def metadata(camera_text):
    return CameraMetadata.parse(camera_text(8, 6))


@pytest.mark.parametrize(('shape', 'size'), [((8, 6), '6x8'), ((48,), '48'), ((6, 8, 1), '1x8x6')])
def test_another_size_than_the_metadata_says_is_refused(metadata, shape, size):
    with pytest.raises(CameraError, match=f'is {size} pixels, its metadata says 8x6'):
        RawFrame(Header(), np.zeros(shape, np.uint16), metadata)


def test_more_than_12_bits_are_refused(metadata):
    counts = np.full((6, 8), 4095, np.uint16)
    RawFrame(Header(), counts, metadata)
    with pytest.raises(CameraError, match='count of 4096'):
        RawFrame(Header(), counts + 1, metadata)


@pytest.mark.parametrize(('name', 'value'), [
    ('tile', 'gr,r:b,gb'), ('upperLeftPixel', 'r')])
def test_another_mosaic_is_refused(camera_text, name, value):
    data = json.loads(camera_text(8, 6))
    data['image']['rawDetails']['mosaic'][name] = value
    with pytest.raises(CameraError, match=f'{value}.*not supported'):
        RawFrame(Header(), np.zeros((6, 8), np.uint16), CameraMetadata.parse(json.dumps(data)))
