"""NPZ files are read as NumPy does, by several threads too."""

import gc
import sys
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from pmcl_ros.runtime.errors import FileError
from pmcl_ros.runtime.npz_file import read_arrays

MOST = 10 ** 6
RNG = np.random.default_rng(0)


@pytest.fixture
def slow_collector():
    """The garbage collector, often, lets other threads run, also within the parser of Python."""
    def pause(_phase, _info):
        time.sleep(1e-4)

    thresholds, interval = gc.get_threshold(), sys.getswitchinterval()
    gc.callbacks.append(pause)
    gc.set_threshold(5)
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval)
    gc.set_threshold(*thresholds)
    gc.callbacks.remove(pause)


@pytest.mark.parametrize('save', [np.savez, np.savez_compressed])
@pytest.mark.parametrize('kind', ['?', 'u1', '<i2', '>i4', '<f2', '<f4', '>f8', '<c8', 'S3', 'U4'])
@pytest.mark.parametrize('shape', [(), (0,), (3,), (2, 3), (4, 1, 2)])
@pytest.mark.parametrize('order', ['C', 'F'])
def test_what_numpy_writes_is_read(tmp_path, save, kind, shape, order):
    values = np.asarray(RNG.integers(0, 100, shape)).astype(kind, order=order)
    save(tmp_path / 'a.npz', values=values, more=np.arange(3))
    with np.load(tmp_path / 'a.npz') as expected:
        found = read_arrays(tmp_path / 'a.npz', MOST)
        assert list(found) == list(expected) == ['values', 'more']
        for name in expected:
            np.testing.assert_array_equal(found[name], expected[name])
            assert found[name].dtype == expected[name].dtype
            assert found[name].flags.f_contiguous == expected[name].flags.f_contiguous


def test_headers_of_the_second_version_are_read(tmp_path):
    values = np.arange(6.).reshape(2, 3)
    with zipfile.ZipFile(tmp_path / 'a.npz', 'w') as file, file.open('values.npy', 'w') as stream:
        np.lib.format.write_array(stream, values, version=(2, 0))
    np.testing.assert_array_equal(read_arrays(tmp_path / 'a.npz', MOST)['values'], values)


@pytest.mark.parametrize(('values', 'told'), [
    (np.array([None]), r'holds object of shape \(1,\), expected numbers'),
    (np.array(['2020-01-01'], 'M8[D]'), r'holds datetime64\[D\] of shape \(1,\)'),
    (np.zeros(2, [('x', 'f4')]), 'values.npy is no array of numbers: its header is '
                                 r'"\{\'descr\': \[\(\'x\''),
])
def test_what_is_no_number_is_told(tmp_path, values, told):
    np.savez(tmp_path / 'a.npz', values=values)
    with pytest.raises(FileError, match=told):
        read_arrays(tmp_path / 'a.npz', MOST)


@pytest.mark.parametrize(('header', 'told'), [
    (b"{'descr': '<f4', 'fortran_order': False, 'shape': (-3,), }", 'is no array of numbers'),
    (b"{'descr': '<f4', 'fortran_order': False, 'shape': (3 4), }", 'is no array of numbers'),
    (b"{'descr': 'zz', 'fortran_order': False, 'shape': (3,), }", 'data type .zz. not understood'),
    (b'(' * 9000, r'is no array of numbers: its header is .\(\(\('),
    (b' ' * 20_000, 'has a header of 20000 bytes, at most 10000 are read'),
    (b'', 'is no array of numbers'),
])
def test_damaged_headers_are_told_in_one_line(tmp_path, header, told):
    with zipfile.ZipFile(tmp_path / 'a.npz', 'w') as file:
        file.writestr('values.npy', b'\x93NUMPY\x01\x00' + len(header).to_bytes(2, 'little')
                      + header + bytes(12))
    with pytest.raises(FileError, match=told) as raised:
        read_arrays(tmp_path / 'a.npz', MOST)
    assert len(str(raised.value)) < 400
    assert '\n' not in str(raised.value)


def test_threads_read_at_the_same_time(tmp_path, slow_collector):
    """NumPy's parser of headers fails here, once in some 1,000 arrays, with CPython 3.11."""
    arrays = {f'values{each}': np.full((3, 4), each) for each in range(5)}
    np.savez(tmp_path / 'a.npz', **arrays)

    def read(_):
        return all(np.array_equal(found, arrays[name]) for _ in range(100)
                   for name, found in read_arrays(tmp_path / 'a.npz', MOST).items())

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(read, range(4))) == [True] * 4
