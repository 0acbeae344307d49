"""The gateway's cache of pictures on disk, and one camera behind many requests."""

import pytest

from pmcl_ros.camera.gateway.service import Cache
from pmcl_ros.runtime.errors import CameraError


def content(size, byte=b'x'):
    return {'raw': size * byte, 'txt': b'{}'}


def read(cache, picture, kind='raw'):
    found = cache.open(picture, kind)
    if found is None:
        return None
    with found[1] as stream:
        return stream.read()


@pytest.fixture
def cache(tmp_path):
    """With room for two pictures of 100 bytes and their texts."""
    cache = Cache(tmp_path, 2 * 102)
    yield cache
    cache.close()
    assert not list(tmp_path.iterdir())


def files(tmp_path):
    return sorted(each.read_bytes() for each in tmp_path.glob('*/*'))


def test_the_picture_that_was_not_asked_for_longest_is_forgotten(cache, tmp_path):
    for name in 'ab':
        cache.put(name, content(100, name.encode()))
    assert read(cache, 'a') == 100 * b'a'
    cache.put('c', content(100, b'c'))
    assert [read(cache, name) is not None for name in 'abc'] == [True, False, True]
    assert cache.files('b') is None
    assert files(tmp_path) == [100 * b'a', 100 * b'c', b'{}', b'{}']


def test_the_newest_is_kept_whatever_its_size_and_who_reads_another_reads_on(cache, tmp_path):
    cache.put('a', content(100, b'a'))
    with cache.open('a', 'raw')[1] as stream:
        cache.put('b', content(1000, b'b'))
        assert cache.files('a') is None
        assert stream.read() == 100 * b'a'
    assert read(cache, 'b') == 1000 * b'b'
    assert files(tmp_path) == [1000 * b'b', b'{}']


def test_a_picture_that_comes_again_takes_the_place_of_what_was_kept_of_it(cache, tmp_path):
    for byte in (b'a', b'b'):
        cache.put('a', content(100, byte))
    assert read(cache, 'a') == 100 * b'b'
    assert files(tmp_path) == [100 * b'b', b'{}']


def test_files_that_are_gone_are_asked_for_again(cache, tmp_path):
    cache.put('a', content(100))
    for each in tmp_path.glob('*/*'):
        each.unlink()
    assert cache.open('a', 'raw') is None
    assert cache.files('a') is None


def test_nothing_is_kept_once_it_is_closed(tmp_path):
    cache = Cache(tmp_path)
    cache.put('a', content(100))
    cache.close()
    assert cache.open('a', 'raw') is None
    with pytest.raises(CameraError, match='cannot keep b in '):
        cache.put('b', content(100))
    assert not list(tmp_path.iterdir())
    cache.close()
