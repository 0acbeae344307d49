import lzma
from pathlib import Path

import imageio.v2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pmcl_ros.camera.packing import pack12, unpack12
from pmcl_ros.runtime.errors import CameraError

WHITE = Path(__file__).parents[2] / 'config' / 'cameras' / 'demo_white.RAW.xz'
EVEN_SIZES = st.tuples(st.integers(1, 9), st.sampled_from([2, 4, 8])) | st.just((8, 5))


@pytest.mark.parametrize(('data', 'counts'), [
    ('FFF000', [0xFFF, 0x000]),
    ('123456', [0x123, 0x456]),
    ('000FFF', [0x000, 0xFFF]),
    ('123456789ABC', [0x123, 0x456, 0x789, 0xABC]),
])
def test_examples(data, counts):
    found = unpack12(bytes.fromhex(data), len(counts), 1)
    assert found.dtype == np.uint16
    np.testing.assert_array_equal(found, [counts])
    assert pack12(found) == bytes.fromhex(data)


@settings(deadline=None)
@given(EVEN_SIZES.flatmap(lambda size: arrays(np.uint16, size, elements=st.integers(0, 4095))))
def test_counts_survive(counts):
    height, width = counts.shape
    np.testing.assert_array_equal(unpack12(pack12(counts), width, height), counts)


@settings(deadline=None)
@given(st.integers(1, 20).flatmap(lambda n: st.binary(min_size=3 * n, max_size=3 * n)))
def test_bytes_survive(data):
    assert pack12(unpack12(data, len(data) // 3, 2)) == data


def test_another_reader_finds_the_same_counts(tmp_path):
    data = lzma.decompress(WHITE.read_bytes())
    (tmp_path / 'IMG.RAW').write_bytes(data)
    theirs = imageio.v2.imread(tmp_path / 'IMG.RAW', format='LYTRO-F01-RAW')  # 1 is 4095
    np.testing.assert_array_equal(unpack12(data, 3280, 3280), np.rint(theirs * 4095))


@settings(deadline=None)
@given(st.integers(0, 60).filter(lambda length: length != 36))
def test_other_lengths_are_refused(length):
    with pytest.raises(CameraError, match=f'holds {length} bytes, expected 36 .6x4'):
        unpack12(bytes(length), 6, 4)


def test_an_odd_number_of_pixels_is_refused():
    with pytest.raises(CameraError, match='3x3 pixels cannot be packed'):
        unpack12(bytes(13), 3, 3)
    with pytest.raises(CameraError, match='even number'):
        pack12(np.zeros((3, 3), np.uint16))


def test_more_than_12_bits_are_refused():
    with pytest.raises(CameraError, match='up to 4096'):
        pack12(np.array([[4096, 0]], np.uint16))
