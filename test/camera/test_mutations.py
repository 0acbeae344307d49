"""Damaged files end in the package's own errors, with little memory, whatever the damage."""

import hashlib
import json
import lzma
import struct
import tracemalloc
import zlib
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mutations import MUTATIONS, mutated

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.camera.lfp import container_bytes, picture_to_lfp
from pmcl_ros.camera.packing import pack12
from pmcl_ros.runtime.errors import CameraError

RAW = pack12(np.random.default_rng(0).integers(0, 4096, (6, 8)).astype(np.uint16))
MEMORY = 20_000_000  # bytes, of files of some thousand
QUICK = settings(deadline=None, max_examples=150,
                 suppress_health_check=[HealthCheck.function_scoped_fixture])
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
    | st.sampled_from([2 ** 70, -1, 0, 8192, 1e308, 'sha1-' + 40 * '0']),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(
        st.text(max_size=5) | st.sampled_from(['picture', 'frame', 'name']), inner, max_size=3),
    max_leaves=5)


def paths(value, before=()):
    """Of every value within a JSON value."""
    yield before
    for name, each in (value.items() if isinstance(value, dict)
                       else enumerate(value) if isinstance(value, list) else ()):
        yield from paths(each, (*before, name))


def replaced(value, path, other):
    if not path:
        return other
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[path[0]] = replaced(value[path[0]], path[1:], other)
    return copy


@contextmanager
def little_memory():
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < MEMORY
    finally:
        tracemalloc.stop()


def read_or_refuse(path):
    """The frame, or None where it was refused by the package's own error that names the file."""
    with little_memory():
        try:
            frame = read_raw_frame(path)
        except CameraError as error:
            frame, message = None, str(error)
    if frame is None:
        assert path.stem in message
        assert len(message) < 5000
        return None
    assert frame.counts.shape == (frame.metadata.image.height, frame.metadata.image.width)
    return frame


@pytest.fixture(scope='module')
def text(camera_text):
    frame = {'metadata': json.loads(camera_text(8, 6)),
             'privateMetadata': {'camera': {'serialNumber': 'A1'}}}
    return json.dumps({'master': {'picture': {'frameArray': [{'frame': frame}]}}})


@pytest.fixture
def picture(tmp_path, text):
    """A function (raw, text beside it, name) -> path of a picture on disk."""
    def write(raw=RAW, beside=None, name='IMG.RAW'):
        (tmp_path / 'IMG.TXT').write_bytes(text.encode() if beside is None else beside)
        (tmp_path / name).write_bytes(raw)
        return tmp_path / name
    read_raw_frame(write())  # compiled here, which takes memory of its own
    assert read_or_refuse(write()) is not None
    return write


@QUICK
@given(MUTATIONS)
def test_a_raw(picture, steps):
    raw = mutated(RAW, steps)
    frame = read_or_refuse(picture(raw))
    assert (frame is not None) == (len(raw) == len(RAW))
    assert frame is None or pack12(frame.counts) == raw


@QUICK
@given(MUTATIONS)
def test_a_text(picture, text, steps):
    read_or_refuse(picture(beside=mutated(text.encode(), steps)))


@QUICK
@given(st.data())
def test_a_text_that_is_still_json(picture, text, data):
    value = json.loads(text)
    path = data.draw(st.sampled_from(list(paths(value))))
    read_or_refuse(picture(beside=json.dumps(replaced(value, path, data.draw(JSON))).encode()))


@QUICK
@given(MUTATIONS)
def test_an_xz(picture, steps):
    frame = read_or_refuse(picture(mutated(lzma.compress(RAW), steps), name='IMG.RAW.xz'))
    assert frame is None or pack12(frame.counts) == RAW  # it has checksums


def test_an_xz_that_wants_gigabytes_to_be_unpacked(picture):
    data = bytearray(lzma.compress(RAW))
    # The size of the dictionary is one byte of the block's header, whose CRC-32 is at its end.
    header = slice(12, 12 + 4 * data[12])
    data[16] = 36  # 1 GiB
    data[header.stop:header.stop + 4] = struct.pack('<I', zlib.crc32(data[header]))
    with pytest.raises(CameraError, match=r'not a complete xz file .*[Mm]emory'):
        read_raw_frame(picture(bytes(data), name='IMG.RAW.xz'))


@QUICK
@given(MUTATIONS)
def test_a_container(picture, text, steps):
    frame = read_or_refuse(picture(mutated(picture_to_lfp(RAW, text), steps), name='IMG.LFP'))
    assert frame is None or (pack12(frame.counts), frame.metadata.serial) == (RAW, 'A1')


@QUICK
@given(st.data())
def test_a_container_whose_table_says_something_else(picture, text, data):
    """The SHA-1 is right, as of a file that was made so."""
    value = json.loads(text)
    frame = value['master']['picture']['frameArray'][0]['frame']
    parts = [json.dumps(frame[name]).encode() for name in ('metadata', 'privateMetadata')]
    names = [f'sha1-{hashlib.sha1(each).hexdigest()}' for each in (*parts, RAW)]
    table = {'picture': {'frameArray': [{'frame': dict(zip(
        ('metadataRef', 'privateMetadataRef', 'imageRef'), names, strict=True))}]}}
    path = data.draw(st.sampled_from(list(paths(table))))
    other = data.draw(JSON | st.sampled_from(names))
    table = replaced(table, path, other)
    if isinstance(table, dict):
        lfp = container_bytes(table, [*parts, RAW])
        frame = read_or_refuse(picture(lfp, name='IMG.LFP'))
        assert frame is None or pack12(frame.counts) == RAW
