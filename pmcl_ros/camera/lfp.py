"""The LFP container and F01 pictures in it (lytro_f01.md, B1)."""

import hashlib
import json
import ntpath
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, BinaryIO

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.runtime.errors import CameraError, told_as
from pmcl_ros.runtime.settings import explain

LARGEST_RAW = 100_000_000  # bytes; an F01 picture has 16,137,600
LARGEST_TEXT = 4_000_000  # bytes; the camera's JSON has some ten thousand

_MAGIC = '89 4C 46 {:02X} 0D 0A 1A 0A'
_FILE, _TABLE, _COMPONENT = (bytes.fromhex(_MAGIC.format(ord(kind))) for kind in 'PMC')
_HEAD = struct.Struct('>8sII')  # magic, version, length
_REFERENCE_SIZE = 80  # bytes: the SHA-1 of a section, as text, padded with 0
_MOST_SECTIONS = 10_000  # an empty one has 16 bytes: a small file could hold millions
_BLOCK = 1 << 20  # bytes that are hashed at once
_PARTS = ('metadata', 'privateMetadata')
_REFERENCES = ('imageRef', *(f'{part}Ref' for part in _PARTS))
_OUTSIDE = 'pmcl_ros.outside_master'  # keeps entries beside 'master', as 'debug'
_NAME = re.compile(r'\w[\w .+-]*', re.ASCII)


@dataclass(frozen=True)
class Section:
    """Place of a section's body in the file [bytes]."""

    is_table: bool
    reference: str
    offset: int
    length: int


@dataclass(frozen=True)
class Container:
    """An LFP file. All sections were checked against their SHA-1."""

    path: Path
    table: dict[str, Any]
    sections: tuple[Section, ...]

    @classmethod
    def open(cls, path: Path | str) -> 'Container':
        """Index a file; CameraError gives the fault and its byte offset."""
        path = Path(path)
        with named(path), path.open('rb') as stream:
            sections = tuple(_verified(stream, path.stat().st_size))
            tables = [each for each in sections if each.is_table]
            if len(tables) != 1:
                raise CameraError(f'{len(tables)} tables of contents, expected one; the file was '
                                  'cut short, or is no LFP')
            body = _read(stream, tables[0], LARGEST_TEXT)
            return cls(path, json_object(body, 'table of contents'), sections)

    def component(self, reference: str, largest: int) -> bytes:
        """The body of a component.

        Raises CameraError when there is none of that name, or it has more than `largest` bytes.
        """
        if reference == reference_of(b''):  # an empty section has no reference
            return b''
        found = [each for each in self.sections
                 if each.reference == reference and not each.is_table]
        if not found:
            raise CameraError(f'{self.path}: no component {reference[:60]!r}, which the table of '
                              'contents names; the file was cut short')
        with named(self.path), self.path.open('rb') as stream:
            return _read(stream, found[0], largest)


@contextmanager
def named(path: Path | str) -> Iterator[None]:
    """CameraErrors begin with the name of a file, if there is one; OSErrors become such."""
    try:
        with told_as(CameraError, name=path):
            yield
    except OSError as error:
        raise CameraError(f'cannot read {error.filename or path}: '
                          f'{error.strerror or error}') from None


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
    """JSON in ASCII; CameraError (naming `what`) if it is nested too deeply."""
    try:
        return json.dumps(value, indent=1).encode('ascii')
    except RecursionError:
        raise CameraError(f'{what} is nested too deeply to be of a camera') from None


def json_object(body: bytes, what: str) -> dict[str, Any]:
    """The JSON object in a body; CameraError (naming `what`) if there is none."""
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
    """The sections of a file of `size` bytes, each after its SHA-1 was checked."""
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
                          f'at most {largest} are allowed there')
    stream.seek(section.offset)
    return stream.read(section.length)


class _References(BaseModel):
    model_config = ConfigDict(frozen=True, extra='ignore')

    image: str = Field(alias='imageRef')
    metadata: str = Field(alias='metadataRef')
    private: str | None = Field(None, alias='privateMetadataRef')


class _File(BaseModel):
    model_config = ConfigDict(frozen=True, extra='ignore')

    name: str
    reference: str = Field(alias='dataRef')


def picture_to_lfp(raw: bytes, text: str) -> bytes:
    """The container of a .RAW and its .TXT (or a frame's metadata alone).

    Raises CameraError when the text is not a camera's metadata.
    """
    CameraMetadata.parse(text)
    data = json_object(text.encode('utf-8', 'replace'), 'metadata')
    if 'master' not in data:
        frame = {'metadata': data, 'privateMetadata': {}}
        data = {'master': {'picture': {'frameArray': [{'frame': frame}]},
                           'version': {'major': 1, 'minor': 0}}}
    table = data.pop('master')
    # Empty in a raw picture; python-lfp-reader takes none without it.
    table['picture'].setdefault('accelerationArray', [])
    frame = table['picture']['frameArray'][0]['frame']
    components = {f'{part}Ref': json_bytes(frame.pop(part), part)
                  for part in _PARTS if part in frame}
    components['imageRef'] = raw
    frame.update((name, reference_of(body)) for name, body in components.items())
    if data:
        table[_OUTSIDE] = data
    return container_bytes(table, [*components.values()])


def lfp_to_picture(container: Container) -> tuple[bytes, str]:
    """The .RAW and the .TXT that a container was built from; the text has the same JSON, with
    an empty `picture.accelerationArray` where it had none.

    Raises CameraError for other contents, such as a refocused stack or a Lytro Illum's picture.
    """
    if 'frames' in container.table:
        raise CameraError(f'{container.path}: Lytro Illum (10 bit) is not supported, only the '
                          'first-generation Lytro (F01)')
    table = dict(container.table)
    outside = table.pop(_OUTSIDE, None)
    try:
        picture = dict(table['picture'])
        first, *others = picture['frameArray']
        found = dict(first['frame'])
    except (KeyError, TypeError, ValueError):
        raise CameraError(f'{container.path}: holds no raw picture: its table of contents has no '
                          'picture.frameArray[0].frame; a refocused stack has none') from None
    references = _checked(_References, found, container)
    there = {each.reference for each in container.sections}
    if picture.get('accelerationArray') and references.image not in there:
        raise CameraError(f'{container.path}: a processed picture, refocused by Lytro Desktop; '
                          'the raw one is in the file of that name without -stk')
    frame = {name: value for name, value in found.items() if name not in _REFERENCES}
    for part, reference in (('metadata', references.metadata),
                            ('privateMetadata', references.private)):
        if reference is not None:
            body = container.component(reference, LARGEST_TEXT)
            frame[part] = json_object(body, f'{container.path}: {part}')
    picture['frameArray'] = [{**first, 'frame': frame}, *others]
    data = {**outside} if isinstance(outside, dict) else {}
    data['master'] = {**table, 'picture': picture}
    raw = container.component(references.image, LARGEST_RAW)
    return raw, json_bytes(data, f'{container.path}: metadata').decode('ascii')


def is_file_set(container: Container) -> bool:
    """Whether it holds the camera's own files (data.C.#: calibration, white images)."""
    return 'files' in container.table


def file_set(container: Container, pattern: str = '*') -> dict[str, str]:
    r"""Names without folders -> references, of a container of the camera's files (data.C.#).

    pattern: shell pattern in any letter case: 'MOD_*' are the white images. A name is the part
    after the last \ or /: files are never written outside the requested folder.
    """
    entries = container.table.get('files')
    if not isinstance(entries, list):
        raise CameraError(f'{container.path}: its table of contents lists no files')
    found: dict[str, str] = {}
    for entry in entries:
        file = _checked(_File, entry, container)
        name = ntpath.basename(file.name)
        if not _NAME.fullmatch(name):
            raise CameraError(f'{container.path}: {file.name[:80]!r} is no name of a file')
        if fnmatchcase(name.upper(), pattern.upper()) and (
                found.setdefault(name, file.reference) != file.reference):
            raise CameraError(f'{container.path}: holds two different files {name}')
    return found


def _checked(kind: type[Any], value: Any, container: Container) -> Any:
    try:
        return kind.model_validate(value)
    except ValidationError as error:
        raise CameraError(f'{container.path}: table of contents: {explain(error)}') from None
