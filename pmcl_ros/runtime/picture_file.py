"""Pictures of any camera: what their headers say is looked at before they are decoded.

OpenCV's decoders believe a header of 68 bytes that asks for gigabytes, print lines of their own,
and give what they have of a damaged picture: a PNG is checked whole, as it has checksums.
"""

import logging
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.binary_file import read_bytes
from pmcl_ros.runtime.errors import FileError, PictureError, told_as

_Read = TypeVar('_Read')
_LOG = logging.getLogger(__name__)
MOST_PIXELS = 2 ** 26  # 67 million: more than the sensors of most cameras have
_MOST_BYTES = 2 ** 28  # of a file
_MOST_DECODED = 3 * 2 ** 27  # bytes of its pixels: 16 bits a colour of the most
_PNG = b'\x89PNG\r\n\x1a\n'
_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # of a PNG's colour type
_BLOCK = 2 ** 20  # bytes that are decompressed at once
_EXIF = 2 ** 16  # bytes, in which a JPEG's EXIF begins
_ORIENTATION = 0x0112  # tag of EXIF
_BITS = 258  # tag of a TIFF
_TOKEN = re.compile(rb'(?:\s|#[^\n]*\n)*(\d{1,9})\s')
_KNOWN = 'PNG, JPEG, TIFF, BMP, WebP, PPM'


def read_picture_file(path: Path, flags: int) -> NDArray[Any]:
    """The pixels of a file, as `decoded`. PictureError, which names it, where there are none."""
    return _of_file(path, lambda data: decoded(data, flags))


def read_picture_size(path: Path) -> tuple[int, int]:
    """(width, height) [px] by a file's header, all that is looked at; PictureError as above."""
    return _of_file(path, lambda data: _checked_size(data, whole=False))


def _of_file(path: Path, read: Callable[[bytes], _Read]) -> _Read:
    with told_as(PictureError, FileError):
        data = read_bytes(path, _MOST_BYTES)
    with told_as(PictureError, name=path):
        return read(data)


def decoded(data: bytes, flags: int) -> NDArray[Any]:
    """The pixels of a PNG, JPEG, TIFF, BMP, WebP or PPM, by cv2.imdecode with `flags`.

    They are as they are stored, whatever orientation EXIF tells; of a JPEG that is said once.
    Cameras are calibrated, and their poses are told, for the pixels of the sensor (COLMAP does not
    turn pictures either).
    Raises PictureError when it is none, is damaged, or has more than `MOST_PIXELS`.
    """
    _checked_size(data, whole=True)
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise PictureError(f'the picture cannot be decoded: {error.err}') from None
    if 1 < (turned := _orientation(data)) <= 8:
        log_orientation(turned)
    if pixels is None:
        raise PictureError(f'it is no complete picture that OpenCV reads ({_KNOWN})')
    return np.asarray(pixels)


@cache
def log_orientation(orientation: int) -> None:
    """Warn, once for each orientation."""
    _LOG.warning('pictures have the EXIF orientation %d, which is not applied: intrinsics and '
                 'poses must be those of the pixels as they are stored', orientation)


def _orientation(data: bytes) -> int:
    """Of a JPEG, as EXIF tells it; 1, which is upright, where it tells none."""
    start = data.find(b'Exif\0\0', 0, _EXIF) + 6
    if start < 6 or not data.startswith(b'\xff\xd8'):
        return 1
    order = '<' if data[start:start + 2] == b'II' else '>'
    try:
        first, = struct.unpack_from(f'{order}I', data, start + 4)
        count, = struct.unpack_from(f'{order}H', data, start + first)
        for entry in range(start + first + 2, start + first + 2 + 12 * count, 12):
            tag, _, _, value = struct.unpack_from(f'{order}HHIH', data, entry)
            if tag == _ORIENTATION:
                return int(value)
    except struct.error:
        pass  # EXIF that is damaged tells nothing
    return 1


def _checked_size(data: bytes, whole: bool) -> tuple[int, int]:
    """(width, height) by the header, of no more than is read. whole: a PNG is checked to its end.
    """
    try:
        width, height = _size(data, whole)
    except struct.error:
        raise PictureError('the picture is cut short') from None
    except (ValueError, zlib.error) as error:
        raise PictureError(f'the picture is damaged: {error}') from None
    if not 0 < width * height <= MOST_PIXELS or min(width, height) < 1:
        raise PictureError(f'the picture says that it has {width}x{height} px; 1 to '
                           f'{MOST_PIXELS / 1e6:.0f} million are read')
    return width, height


def _size(data: bytes, whole: bool) -> tuple[int, int]:
    if data.startswith(_PNG):
        return _png(data, whole)
    if data.startswith(b'\xff\xd8'):
        return _jpeg(data)
    if data[:4] in (b'II*\0', b'MM\0*'):
        return _tiff(data, '<' if data[:1] == b'I' else '>')
    if data.startswith(b'BM'):
        old = struct.unpack_from('<I', data, 14)[0] == 12
        width, height = struct.unpack_from('<HH' if old else '<ii', data, 18)
        return abs(width), abs(height)
    if data[:4] == b'RIFF' and data[8:12] == b'WEBP':
        return _webp(data)
    if re.match(rb'P[1-6]\s', data):
        first = _TOKEN.match(data, 2)
        second = _TOKEN.match(data, first.end() - 1) if first else None
        if first and second:
            return int(first[1]), int(second[1])
    raise PictureError(f'it is no picture: {_KNOWN} are read')


def _png(data: bytes, whole: bool) -> tuple[int, int]:
    chunks = _png_chunks(data)
    name, head = next(chunks)
    if name != b'IHDR':
        raise ValueError('a PNG begins with IHDR')
    width, height, bits, colour, _, _, interlaced = struct.unpack('>IIBBBBB', head)
    if not whole or not 0 < width * height <= MOST_PIXELS:
        return width, height  # refused, before anything is unpacked
    expected = height * (1 + (width * bits * _CHANNELS.get(colour, 0) + 7) // 8)
    most = 2 * expected + 2 ** 16 if interlaced else expected
    stream, found = zlib.decompressobj(), 0
    for content in (content for name, content in chunks if name == b'IDAT'):
        part = stream.decompress(content, _BLOCK)
        while part and found <= most:
            found += len(part)
            part = stream.decompress(stream.unconsumed_tail, _BLOCK)
    if not stream.eof or found > most or (not interlaced and found != expected):
        raise ValueError(f'its pixels unpack to {found} bytes, {expected} are needed')
    return width, height


def _png_chunks(data: bytes) -> Iterator[tuple[bytes, memoryview]]:
    """Names and contents of the parts, up to the last; ValueError for a wrong checksum."""
    whole, place = memoryview(data), len(_PNG)
    name = b''
    while name != b'IEND':
        length, name = struct.unpack_from('>I4s', data, place)
        content = whole[place + 8:place + 8 + length]
        crc, = struct.unpack_from('>I', data, place + 8 + length)
        if zlib.crc32(content, zlib.crc32(name)) != crc:
            raise ValueError(f'the checksum of its part {name!r} at byte {place} is wrong')
        yield name, content
        place += 12 + length


def _jpeg(data: bytes) -> tuple[int, int]:
    place = 2
    while place < len(data):
        marker, length = struct.unpack_from('>HH', data, place)
        if marker & 0xfff0 == 0xffc0 and marker not in (0xffc4, 0xffc8, 0xffcc):
            height, width = struct.unpack_from('>HH', data, place + 5)
            if data.rfind(b'\xff\xd9', place) < 0:
                raise ValueError('a JPEG has an end mark')
            return width, height
        if marker == 0xffff:  # fills
            place += 1
            continue
        if marker >> 8 != 0xff or length < 2:
            raise ValueError(f'no part of a JPEG at byte {place}')
        place += 2 + length
    raise ValueError('a JPEG has a size')


def _tiff(data: bytes, order: str) -> tuple[int, int]:
    """Of the only picture; a tile or a strip is no larger than pictures may be."""
    place, = struct.unpack_from(f'{order}I', data, 4)
    count, = struct.unpack_from(f'{order}H', data, place)
    end = place + 2 + 12 * count
    if any(data[end:end + 4]):  # where the next picture begins
        raise PictureError('it has several pages: save the one that is meant as a file of its own')
    found = {}
    for entry in range(place + 2, end, 12):
        tag, kind, number = struct.unpack_from(f'{order}HHI', data, entry)
        if number == 1 and kind in (3, 4):
            found[tag], = struct.unpack_from(order + 'HI'[kind - 3], data, entry + 8)
        elif tag == _BITS and kind == 3:  # of each channel: elsewhere, if there are many
            at = entry + 8 if number == 2 else struct.unpack_from(f'{order}I', data, entry + 8)[0]
            found[tag], = struct.unpack_from(f'{order}H', data, at)
    width, height = found.get(256, 0), found.get(257, 0)
    bits = found.get(_BITS, 1)
    size = 3 * width * height * bits // 8
    if size > _MOST_DECODED:
        raise PictureError(f'the picture says that it has {width}x{height} px of {bits} bits '
                           f'a colour: {size / 2 ** 20:.0f} MiB, at most '
                           f'{_MOST_DECODED // 2 ** 20} are read')
    tile = found.get(322, 1) * found.get(323, 1)
    if tile > MOST_PIXELS or found.get(277, 1) > 4:
        raise ValueError(f'tiles of {tile} pixels of {found.get(277, 1)} channels')
    return width, height


def _webp(data: bytes) -> tuple[int, int]:
    kind = data[12:16]
    if kind == b'VP8X':
        width, height = (int.from_bytes(data[place:place + 3], 'little') + 1
                         for place in (24, 27))
        return width, height
    if kind == b'VP8L':
        bits, = struct.unpack_from('<I', data, 21)
        return (bits & 0x3fff) + 1, (bits >> 14 & 0x3fff) + 1
    width, height = struct.unpack_from('<HH', data, 26)
    return width & 0x3fff, height & 0x3fff
