import json
from pathlib import Path

import pytest

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.runtime.errors import CameraError

SHIPPED = Path(__file__).parents[2] / 'config' / 'cameras' / 'demo_white.TXT'


@pytest.fixture
def data(camera_text):
    return json.loads(camera_text(8, 6))


def whole_text(data, private=None):
    """As in a .TXT of the camera: the frame's part among everything else."""
    frame = {'metadata': data, 'privateMetadata': private or {}}
    return json.dumps({'master': {'picture': {'frameArray': [{'frame': frame}]}}})


def changed(data, path, value):
    """`data` with another value at a path a.b.c, or without it (None)."""
    *parents, last = path.split('.')
    part = data
    for name in parents:
        part = part[name]
    if value is None:
        del part[last]
    else:
        part[last] = value
    return json.dumps(data)


def test_a_frame_alone_and_the_whole_text_say_the_same(data):
    alone = CameraMetadata.parse(json.dumps(data))
    whole = CameraMetadata.parse(whole_text(data, {'camera': {'serialNumber': 'A1'}}))
    assert alone.image == whole.image
    assert (alone.serial, whole.serial) == ('', 'A1')
    assert alone.text == json.dumps(data)


def test_the_shipped_white_image():
    metadata = CameraMetadata.parse(SHIPPED.read_text())
    assert (metadata.image.width, metadata.image.height) == (3280, 3280)
    assert (metadata.black, metadata.white, metadata.serial) == (168, 4095, 'A000000001')
    assert metadata.image.color.gamma == pytest.approx(1 / 2.4, rel=1e-3)


def test_levels_of_four_phases(data):
    data['image']['rawDetails']['pixelFormat'] = {
        'black': {'r': 160, 'gr': 168, 'gb': 170, 'b': 174},
        'white': {'r': 4095, 'gr': 4090, 'gb': 4080, 'b': 4085}}
    metadata = CameraMetadata.parse(json.dumps(data))
    assert (metadata.black, metadata.white) == (168, 4080)


@pytest.mark.parametrize(('path', 'value'), [
    ('image.color.whiteBalanceGain.r', 1e300), ('image.color.whiteBalanceGain.b', 1e-300),
    ('image.color.ccmRgbToSrgbArray', [1e300] * 9), ('image.color.gamma', 1e-300),
    ('image.rawDetails.mosaic.tile', 'x' * 300_000)])
def test_numbers_that_overflow_and_long_texts_are_refused(data, path, value):
    with pytest.raises(CameraError, match=path) as caught:
        CameraMetadata.parse(changed(data, path, value))
    assert len(str(caught.value)) < 2000


@pytest.mark.parametrize('serial', ['\ud800', 'A\x1b[31m', 'A\n', 'A' * 101])
def test_a_serial_number_is_one_that_a_terminal_can_show(data, serial):
    with pytest.raises(CameraError, match=r'camera.serialNumber') as caught:
        CameraMetadata.parse(whole_text(data, {'camera': {'serialNumber': serial}}))
    assert str(caught.value).isprintable()


@pytest.mark.parametrize('path', [
    'image', 'image.width', 'image.rawDetails', 'image.rawDetails.pixelFormat.black.gb',
    'image.rawDetails.mosaic.upperLeftPixel', 'image.color.gamma',
    'image.color.whiteBalanceGain.r'])
def test_a_missing_field_is_named(data, path):
    with pytest.raises(CameraError, match=f'^metadata: {path}: Field required$'):
        CameraMetadata.parse(changed(data, path, None))


@pytest.mark.parametrize(('path', 'value', 'reason'), [
    ('image.width', 0, r'greater than 0 \(got 0\)'),
    ('image.height', 8193, r'8192 \(got 8193\)'),
    ('image.width', 'wide', r"valid integer.*\(got 'wide'\)"),
    ('image.color.gamma', 0, r'greater than or equal to 0.01 \(got 0\)'),
    ('image.color.gamma', float('nan'), 'nan'),
    ('image.color.ccmRgbToSrgbArray', [1, 2], 'number 3 is missing'),
    ('image.rawDetails.pixelFormat.black.r', 4096, r'4095 \(got 4096\)'),
    ('image.rawDetails.pixelFormat.white.b', 168, 'black levels must be below the white levels'),
])
def test_an_impossible_value_is_named(data, path, value, reason):
    name = path.removesuffix('.white.b')
    with pytest.raises(CameraError, match=f'^metadata: {name}.*{reason}'):
        CameraMetadata.parse(changed(data, path, value))


def test_a_field_of_null_is_one_that_is_not_there(data):
    for fields in ({'devices': None}, {'devices': {'lens': None, 'sensor': {'pixelPitch': None}}}):
        metadata = CameraMetadata.parse(whole_text({**data, **fields}, {'camera': None}))
        assert (metadata.zoom, metadata.devices.mla.rotation, metadata.serial) == (None, 0.0, '')
    with pytest.raises(CameraError, match=r'^metadata: image: .*required'):
        CameraMetadata.parse(json.dumps({'image': None}))
    with pytest.raises(CameraError, match=r'^metadata: devices: .*\(got 3\)'):
        CameraMetadata.parse(json.dumps({**data, 'devices': 3}))


@pytest.mark.parametrize(('text', 'reason'), [
    ('', 'not JSON'),
    ('{"image": ', 'not JSON'),
    ('[' * 100_000, 'not JSON'),
    ('{"image": ' + 10_000 * '1' + '}', 'not JSON'),  # Python refuses integers of so many digits
    ('5', 'valid dictionary.*got 5'),
    ('[]', 'valid dictionary'),
    ('null', 'valid dictionary'),
    ('{"image": ' + '[' * 500 + ']' * 500 + '}', r'image: .*got \[\[\[\[...\]\]\]\]'),
    ('{"master": 3}', "no 'picture' on the way"),
    ('{"master": {"picture": {"frameArray": []}}}', 'no 0 on the way'),
    ('{"master": {"picture": {"frameArray": [{"frame": []}]}}}', "no 'metadata' in its frame"),
    ('{"master": {"picture": {"frameArray": [{"frame": {"metadata": 7}}]}}}',
     'valid dictionary.*got 7'),
])
def test_what_is_no_metadata_is_refused(text, reason):
    with pytest.raises(CameraError, match=reason):
        CameraMetadata.parse(text)
