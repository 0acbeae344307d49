import lzma
import os
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from pmcl_ros.camera import files
from pmcl_ros.camera.files import list_pictures, read_raw_frame, write_raw_frame
from pmcl_ros.camera.packing import pack12
from pmcl_ros.geometry.header import Header
from pmcl_ros.runtime.errors import CameraError, OutputError

COUNTS = np.random.default_rng(0).integers(0, 4096, (6, 8)).astype(np.uint16)


@pytest.fixture
def picture(tmp_path, camera_text):
    """A function (name, text name) -> path of a picture of COUNTS with its metadata."""
    def write(name='IMG.RAW', text='IMG.TXT'):
        data = pack12(COUNTS)
        (tmp_path / text).write_text(camera_text(8, 6))
        path = tmp_path / name
        path.write_bytes(lzma.compress(data) if name.lower().endswith('.xz') else data)
        return path
    return write


@pytest.mark.parametrize('name', ['IMG.RAW', 'IMG.RAW.xz', 'IMG.raw', 'IMG.RAW.XZ'])
@pytest.mark.parametrize('text', ['IMG.TXT', 'IMG.txt'])
def test_a_picture_is_read(picture, camera_text, name, text):
    frame = read_raw_frame(picture(name, text))
    np.testing.assert_array_equal(frame.counts, COUNTS)
    assert frame.metadata.text == camera_text(8, 6)


def test_the_stamp_is_that_of_the_file_or_as_given(picture):
    path = picture()
    os.utime(path, ns=(0, 1_700_000_000_123_456_789))
    assert read_raw_frame(path).header == Header(path.stat().st_mtime_ns)
    header = Header(5, 'other')
    assert read_raw_frame(str(path), header).header is header


def test_every_cut_of_an_xz_file_is_refused(picture):
    path = picture('IMG.RAW.xz')
    data = path.read_bytes()
    for length in range(len(data)):
        path.write_bytes(data[:length])
        with pytest.raises(CameraError, match=r'IMG.RAW.xz: not a complete xz file'):
            read_raw_frame(path)
    path.write_bytes(data + bytes(4))  # padding, which the format allows
    np.testing.assert_array_equal(read_raw_frame(path).counts, COUNTS)
    path.write_bytes(data + b'more')
    with pytest.raises(CameraError, match=r'IMG.RAW.xz: not a complete xz file \(more follows'):
        read_raw_frame(path)


def test_another_picture_of_its_name_is_replaced_by_force_only(picture):
    path = picture()
    frame = read_raw_frame(path)
    write_raw_frame(path, frame)  # the same
    other = replace(frame, counts=COUNTS[::-1])
    with pytest.raises(OutputError):
        write_raw_frame(path, other)
    np.testing.assert_array_equal(read_raw_frame(path).counts, COUNTS)
    write_raw_frame(path, other, force=True)
    np.testing.assert_array_equal(read_raw_frame(path).counts, COUNTS[::-1])


@pytest.mark.parametrize('name', ['IMG.RAW', 'IMG.RAW.xz', 'IMG.LFP'])
def test_who_reads_a_picture_that_is_replaced_has_the_whole_old_one(picture, tmp_path, name):
    frame = replace(read_raw_frame(picture('OTHER.RAW', 'OTHER.TXT')))
    write_raw_frame(tmp_path / name, frame)
    before = (tmp_path / name).read_bytes()
    with (tmp_path / name).open('rb') as stream:
        write_raw_frame(tmp_path / name, replace(frame, counts=COUNTS[::-1]), force=True)
        assert stream.read() == before
    assert (tmp_path / name).read_bytes() != before
    assert not list(tmp_path.glob('*.part'))


def test_a_picture_that_cannot_be_written_leaves_no_part_of_it(picture, tmp_path):
    frame = read_raw_frame(picture('OTHER.RAW', 'OTHER.TXT'))
    (tmp_path / 'IMG.RAW').mkdir()
    with pytest.raises(OutputError, match=r'cannot write .*IMG\.RAW: Is a directory'):
        write_raw_frame(tmp_path / 'IMG.RAW', frame, force=True)
    assert not list(tmp_path.glob('*.part'))


def test_every_flipped_byte_of_an_xz_file_is_refused(picture):
    path = picture('IMG.RAW.xz')
    data = path.read_bytes()
    for place in range(len(data)):
        path.write_bytes(data[:place] + bytes([data[place] ^ 255]) + data[place + 1:])
        with pytest.raises(CameraError, match=r'IMG.RAW.xz: not a complete xz file'):
            read_raw_frame(path)


@pytest.mark.parametrize('name', ['IMG.RAW', 'IMG.RAW.xz'])
def test_a_file_that_unpacks_to_too_much_is_refused(picture, monkeypatch, name):
    path = picture(name)
    monkeypatch.setattr(files, 'LARGEST_RAW', 10_000)
    read_raw_frame(path)
    zeros = bytes(30_000_000)
    path.write_bytes(lzma.compress(zeros, preset=0) if name.endswith('xz') else zeros)
    tracemalloc.start()
    with pytest.raises(CameraError, match='more than 10000 bytes'):
        read_raw_frame(path)
    assert tracemalloc.get_traced_memory()[1] < 10_000_000  # never unpacked
    tracemalloc.stop()


@pytest.mark.parametrize('length', [0, 71, 73])
def test_a_raw_of_the_wrong_size_is_refused(picture, length):
    path = picture()
    path.write_bytes(bytes(length))
    with pytest.raises(CameraError, match=rf'IMG.RAW: .*holds {length} bytes, expected 72 \(8x6'):
        read_raw_frame(path)


def test_the_text_of_another_picture_is_refused(picture, camera_text):
    path = picture()
    path.with_suffix('.TXT').write_text(camera_text(10, 6))
    with pytest.raises(CameraError, match=r'IMG.RAW: .*holds 72 bytes, expected 90 \(10x6'):
        read_raw_frame(path)


@pytest.mark.parametrize(('content', 'reason'), [
    (b'{', 'IMG.TXT: metadata is not JSON'),
    (b'{}', 'IMG.TXT: metadata: image: Field required'),
    (b'\xff\xfe{', 'IMG.TXT is not text'),
])
def test_a_broken_text_is_named(picture, content, reason):
    path = picture()
    path.with_suffix('.TXT').write_bytes(content)
    with pytest.raises(CameraError, match=rf'IMG\.RAW: {reason}'):
        read_raw_frame(path)


def test_missing_files_are_named(picture, tmp_path):
    path = picture('IMG.RAW.xz')
    path.with_name('IMG.TXT').unlink()
    with pytest.raises(CameraError, match=r'IMG.RAW.xz: no IMG.TXT beside it'):
        read_raw_frame(path)
    path = picture()
    path.unlink()
    with pytest.raises(CameraError, match=r'cannot read .*IMG.RAW: No such file'):
        read_raw_frame(path)
    path.mkdir()
    with pytest.raises(CameraError, match=r'cannot read .*IMG.RAW: Is a directory'):
        read_raw_frame(path)


@pytest.mark.parametrize('name', ['IMG.JPG', 'IMG.xz', 'RAW'])
def test_other_kinds_of_file_are_refused(picture, name):
    with pytest.raises(CameraError, match=rf'/{name}: not a \.RAW'):
        read_raw_frame(picture(name))


def test_pictures_of_a_folder(picture, tmp_path):
    (tmp_path / 'a').mkdir()
    (tmp_path / 'c.RAW').mkdir()  # a folder is no picture
    expected = [picture(f'a{os.sep}IMG.RAW', f'a{os.sep}IMG.TXT'), picture('b.raw.xz', 'b.TXT'),
                picture('d.RAW', 'd.TXT')]
    assert list_pictures(tmp_path) == expected
    assert list_pictures(str(expected[1])) == [expected[1]]


def test_no_pictures(tmp_path):
    (tmp_path / 'IMG.TXT').touch()
    with pytest.raises(CameraError, match=r'no .RAW, .RAW.xz or .LFP picture in'):
        list_pictures(tmp_path)
    with pytest.raises(CameraError, match=r'there is no .*nowhere'):
        list_pictures(tmp_path / 'nowhere')
