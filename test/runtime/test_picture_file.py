"""Pictures are decoded as OpenCV does, when their headers and checksums allow."""

import struct
import subprocess
import sys
import zlib

import cv2
import numpy as np
import pytest

from pmcl_ros.runtime.errors import PictureError
from pmcl_ros.runtime.picture_file import (
    MOST_PIXELS,
    decoded,
    log_orientation,
    read_picture_file,
    read_picture_size,
)

FLAGS = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
COLOURS = np.random.default_rng(0).integers(0, 256, (19, 31, 3)).astype(np.uint8)


def encoded(kind, pixels=COLOURS):
    plain = [cv2.IMWRITE_TIFF_COMPRESSION, 1]  # else old OpenCV loses digits of floats
    return cv2.imencode(kind, pixels, plain if kind == '.tif' else [])[1].tobytes()


def png(width, height, data, colour=2, interlaced=0):
    parts = ((b'IHDR', struct.pack('>IIBBBBB', width, height, 8, colour, 0, 0, interlaced)),
             (b'IDAT', data), (b'IEND', b''))
    return b'\x89PNG\r\n\x1a\n' + b''.join(
        struct.pack('>I', len(content)) + name + content
        + struct.pack('>I', zlib.crc32(name + content)) for name, content in parts)


@pytest.mark.parametrize('kind', ['.png', '.jpg', '.tif', '.bmp', '.webp', '.ppm'])
@pytest.mark.parametrize('pixels', [COLOURS, COLOURS[..., 0], COLOURS[:1, :1]],
                         ids=['colours', 'grey', 'one'])
def test_what_opencv_writes_is_decoded(kind, pixels, tmp_path):
    if kind == '.ppm' and pixels.ndim == 2:
        kind = '.pgm'
    data = encoded(kind, pixels)
    np.testing.assert_array_equal(
        decoded(data, FLAGS), cv2.imdecode(np.frombuffer(data, np.uint8), FLAGS))
    (tmp_path / 'a').write_bytes(data)
    assert read_picture_size(tmp_path / 'a') == pixels.shape[1::-1]


def test_a_tiff_of_several_pages_is_refused(tmp_path):
    path = tmp_path / 'stack.tif'
    assert cv2.imwritemulti(str(path), [COLOURS, COLOURS[::-1]])
    for read in (lambda: read_picture_file(path, FLAGS), lambda: read_picture_size(path)):
        with pytest.raises(PictureError, match=r'stack.tif: it has several pages: save the one'):
            read()


@pytest.mark.parametrize('orientation', range(1, 9))
def test_pixels_stay_as_they_are_stored_whatever_exif_tells(orientation, caplog):
    """Intrinsics and poses are those of the sensor, as of COLMAP."""
    log_orientation.cache_clear()
    plain = encoded('.jpg')
    one_tag = b'II*\0' + struct.pack('<IHHHIII', 8, 1, 0x112, 3, 1, orientation, 0)
    exif = b'Exif\0\0' + one_tag
    told = plain[:2] + struct.pack('>HH', 0xffe1, 2 + len(exif)) + exif + plain[2:]
    turned = cv2.imdecode(np.frombuffer(told, np.uint8), FLAGS)  # OpenCV does follow the tag
    assert np.array_equal(turned, decoded(plain, FLAGS)) == (orientation == 1)
    np.testing.assert_array_equal(decoded(told, FLAGS), decoded(plain, FLAGS))
    assert (f'EXIF orientation {orientation}, which is not applied' in caplog.text) == (
        orientation != 1)


@pytest.mark.parametrize(('kind', 'dtype'), [('.png', np.uint16), ('.tif', np.uint16),
                                             ('.tif', np.float32), ('.ppm', np.uint16)])
def test_deep_pictures_keep_their_depth(kind, dtype):
    found = decoded(encoded(kind, COLOURS.astype(dtype) * dtype(100)), FLAGS)
    assert found.dtype == dtype
    np.testing.assert_array_equal(found, COLOURS.astype(dtype) * dtype(100))


def test_every_flipped_bit_of_a_png_is_noticed():
    data = encoded('.png')
    for bit in range(8 * len(data)):
        place = bit // 8
        with pytest.raises(PictureError):
            decoded(data[:place] + bytes([data[place] ^ 1 << bit % 8]) + data[place + 1:], FLAGS)


@pytest.mark.parametrize('kind', ['.png', '.jpg', '.bmp', '.webp', '.tif'])
def test_a_picture_that_was_cut_short(kind):
    data = encoded(kind)
    for kept in (0, 1, 4, 10, 20, 30, len(data) // 2, len(data) - 1):
        if kind in ('.bmp', '.tif', '.webp') and kept == len(data) - 1:
            continue  # padding, or what no pixel needs
        with pytest.raises(PictureError):
            decoded(data[:kept], FLAGS)


@pytest.mark.parametrize(('data', 'told'), [
    (png(60000, 60000, b''), 'says that it has 60000x60000 px; 1 to 67 million'),
    (png(20000, 20000, b''), '20000x20000 px'),
    (png(0, 5, b''), '0x5 px'),
    (png(2, 2, zlib.compress(bytes(2 ** 26))), 'damaged: its pixels unpack to'),
    (png(2, 2, zlib.compress(bytes(13))), 'unpack to 13 bytes, 14 are needed'),
    (png(2, 2, b'xxxxxx'), 'damaged: Error -3'),
    (b'BM' + bytes(12) + struct.pack('<Iii', 40, 60000, -60000), '60000x60000 px'),
    (b'P6 60000 # width\n60000 255 ', '60000x60000 px'),
    (b'\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff\x03' + bytes(9) + b'\xff\xd9', '65535x65535'),
    (b'RIFF\x1e\0\0\0WEBPVP8X\x0a\0\0\0' + bytes(4) + b'\xff' * 6, '16777216x16777216 px'),
    (b'II*\0\x08\0\0\0\2\0' + struct.pack('<HHII', 256, 4, 1, 99999)
     + struct.pack('<HHII', 257, 4, 1, 99999), '99999x99999 px'),
    (b'GIF89a' + bytes(20), 'it is no picture: PNG, JPEG'), (b'', 'it is no picture')])
def test_what_a_header_says_is_looked_at_first(data, told):
    with pytest.raises(PictureError, match=told):
        decoded(data, FLAGS)


def test_an_interlaced_picture_is_decoded():
    """A pixel: one pass of one row, and six without any."""
    data = png(1, 1, zlib.compress(b'\0abc'), interlaced=1)
    assert decoded(data, FLAGS).tolist() == [[[99, 98, 97]]]


def test_a_large_picture_takes_little_more_than_its_pixels(tmp_path):
    """Of 8192 x 8192 px of zeros, 200 kB: in a process of its own, which says what it took."""
    side = int(MOST_PIXELS ** 0.5)
    rows = zlib.compress(bytes(side * (3 * side + 1)), 1)
    (tmp_path / 'a.png').write_bytes(png(side, side, rows))
    script = ('import re, sys, cv2; from pathlib import Path; '
              'from pmcl_ros.runtime.picture_file import read_picture_file; '
              'read_picture_file(Path(sys.argv[1]), cv2.IMREAD_COLOR); '
              'print(re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1])')
    done = subprocess.run([sys.executable, '-c', script, tmp_path / 'a.png'],
                          stdout=subprocess.PIPE, check=True)
    assert int(done.stdout) < 600_000  # kB


def test_a_size_is_told_without_the_pixels(tmp_path):
    (tmp_path / 'a.png').write_bytes(png(40, 30, b'none'))
    assert read_picture_size(tmp_path / 'a.png') == (40, 30)
    with pytest.raises(PictureError, match=r'a\.png: the picture is damaged'):
        read_picture_file(tmp_path / 'a.png', FLAGS)
    (tmp_path / 'b.png').write_bytes(png(60000, 60000, b''))
    with pytest.raises(PictureError, match=r'b\.png: .* 60000x60000 px; 1 to 67 million'):
        read_picture_size(tmp_path / 'b.png')


def test_files_are_named(tmp_path):
    with pytest.raises(PictureError, match=r'cannot read .*none.png: No such file'):
        read_picture_file(tmp_path / 'none.png', FLAGS)
    (tmp_path / 'a.png').write_bytes(b'text')
    with pytest.raises(PictureError, match=r'a.png: it is no picture'):
        read_picture_file(tmp_path / 'a.png', FLAGS)
