"""The LFP container (lytro_f01.md, B1): sections, each named by the SHA-1 of what it holds.

A header, then sections aligned to 16 bytes: one table of contents (JSON) and any number of
components that the table refers to by 'sha1-' and 40 hex digits. Integers are big-endian.
"""

import hashlib
import json
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from pmcl_ros.runtime.errors import CameraError

LARGEST_TEXT = 4_000_000  # bytes; the camera's JSON has some ten thousand

_MAGIC = '89 4C 46 {:02X} 0D 0A 1A 0A'
_FILE, _TABLE, _COMPONENT = (bytes.fromhex(_MAGIC.format(ord(kind))) for kind in 'PMC')
_HEAD = struct.Struct('>8sII')  # magic, version, length
_REFERENCE_SIZE = 80
_MOST_SECTIONS = 10_000
_BLOCK = 1 << 20


@dataclass(frozen=True)
class Section:
    """Where a section's body lies in the file, bytes."""

    is_table: bool
    reference: str
    offset: int
    length: int


@dataclass(frozen=True)
class Container:
    """An LFP file whose every section was found whole, with the SHA-1 that it claims."""

    path: Path
    table: dict[str, Any]
    sections: tuple[Section, ...]

    @classmethod
    def open(cls, path: Path | str) -> 'Container':
        """Index a file; CameraError says what is wrong with it, and at which byte."""
        path = Path(path)
        try:
            with path.open('rb') as stream:
                sections = tuple(_verified(stream, path.stat().st_size))
                tables = [each for each in sections if each.is_table]
                if len(tables) != 1:
                    raise CameraError(f'{len(tables)} tables of contents, expected one; the file '
                                      'was cut short, or is no LFP')
                body = _read(stream, tables[0], LARGEST_TEXT)
            return cls(path, json_object(body, 'table of contents'), sections)
        except OSError as error:
            raise CameraError(f'cannot read {path}: {error.strerror or error}') from None
        except CameraError as error:
            raise CameraError(f'{path}: {error}') from None

    def component(self, reference: str, largest: int) -> bytes:
        """The body of a component.

        Raises CameraError when there is none of that name, or it has more than `largest` bytes.
        """
        found = [each for each in self.sections
                 if each.reference == reference and not each.is_table]
        if not found:
            raise CameraError(f'{self.path}: no component {reference[:60]!r}, which the table of '
                              'contents names; the file was cut short')
        try:
            with self.path.open('rb') as stream:
                return _read(stream, found[0], largest)
        except OSError as error:
            raise CameraError(f'cannot read {self.path}: {error.strerror or error}') from None
        except CameraError as error:
            raise CameraError(f'{self.path}: {error}') from None


def reference_of(body: bytes) -> str:
    """The name of a section: 'sha1-' and the 40 hex digits of its body."""
    return f'sha1-{hashlib.sha1(body, usedforsecurity=False).hexdigest()}'


def container_bytes(table: Mapping[str, Any], components: Sequence[bytes]) -> bytes:
    """An LFP file of a table of contents and components, none of them empty."""
    if not all(components):
        raise CameraError('an LFP component cannot be empty: it would have no name')
    text = json_bytes(table, 'table of contents')
    # imageio's reader expects five zero bytes after the table, as after Lytro's own: white space
    # at its end, which JSON allows, brings the length there.
    text += b'\n' * ((11 - len(text)) % 16)
    return b''.join([_HEAD.pack(_FILE, 1, 0), *_section(_TABLE, text),
                     *(part for body in components for part in _section(_COMPONENT, body))])


def json_bytes(value: Any, what: str) -> bytes:
    """JSON in ASCII; CameraError names `what` it is when it is nested too deeply to be written."""
    try:
        return json.dumps(value, indent=1).encode('ascii')
    except RecursionError:
        raise CameraError(f'{what} is nested too deeply to be of a camera') from None


def json_object(body: bytes, what: str) -> dict[str, Any]:
    """The JSON object in a body; CameraError names `what` it should have been."""
    try:
        value = json.loads(body.decode('utf-8'))
    except (ValueError, RecursionError) as error:
        raise CameraError(f'{what} is not JSON ({str(error)[:200]})') from None
    if not isinstance(value, dict):
        raise CameraError(f'{what} holds {type(value).__name__}, expected a JSON object')
    return value


def _section(magic: bytes, body: bytes) -> Iterator[bytes]:
    yield _HEAD.pack(magic, 0, len(body))
    yield reference_of(body).encode().ljust(_REFERENCE_SIZE, b'\0')
    yield body
    yield bytes(-len(body) % 16)


def _verified(stream: BinaryIO, size: int) -> Iterator[Section]:
    """The sections of a file of `size` bytes, each once its SHA-1 was found right."""
    if stream.read(len(_FILE)) != _FILE:
        raise CameraError('does not begin as an LFP file does')
    place, count = _HEAD.size, 0
    while place < size:
        stream.seek(place)
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size or not head.strip(b'\0'):
            if head.strip(b'\0'):
                raise CameraError(f'ends within a section header, at byte {place}')
            return  # padding
        magic, _, length = _HEAD.unpack(head)
        if magic not in (_TABLE, _COMPONENT):
            raise CameraError(f'no section begins at byte {place}, where one should (found '
                              f'{head[:8].hex(" ")})')
        count += 1
        if count > _MOST_SECTIONS:
            raise CameraError(f'more than {_MOST_SECTIONS} sections')
        place += _HEAD.size
        if length == 0:  # then there is no reference either
            continue
        offset = place + _REFERENCE_SIZE
        if offset + length > size:
            raise CameraError(f'section at byte {place - _HEAD.size} claims {length} bytes, only '
                              f'{max(0, size - offset)} are left; the file was cut short')
        section = Section(magic == _TABLE, _reference(stream, place), offset, length)
        _verify(stream, section)
        yield section
        place = section.offset + length + -length % 16


def _reference(stream: BinaryIO, place: int) -> str:
    reference = stream.read(_REFERENCE_SIZE).rstrip(b'\0')
    if len(reference) != 45 or not reference.startswith(b'sha1-') or not reference.isascii():
        raise CameraError(f'the name at byte {place} is {reference!r}, expected sha1- and 40 hex '
                          'digits')
    return reference.decode('ascii')


def _verify(stream: BinaryIO, section: Section) -> None:
    digest = hashlib.sha1(usedforsecurity=False)
    left = section.length
    while left and (block := stream.read(min(left, _BLOCK))):
        digest.update(block)
        left -= len(block)
    if (found := f'sha1-{digest.hexdigest()}') != section.reference:
        raise CameraError(f'the {section.length} bytes from byte {section.offset} have {found}, '
                          f'but their name is {section.reference}; the file is damaged')


def _read(stream: BinaryIO, section: Section, largest: int) -> bytes:
    if section.length > largest:
        raise CameraError(f'the component at byte {section.offset} has {section.length} bytes, '
                          f'at most {largest} make sense for what it should be')
    stream.seek(section.offset)
    return stream.read(section.length)
