"""An F01 picture as an LFP container, and back to what the camera wrote (lytro_f01.md, B1).

The camera's .TXT is one JSON object whose frame holds its metadata; in the container the frame
holds references instead: to the metadata, to the private metadata and to the .RAW.
"""

import ntpath
import re
from fnmatch import fnmatchcase
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pmcl_ros.camera.lfp import (
    LARGEST_TEXT,
    Container,
    container_bytes,
    json_bytes,
    json_object,
    reference_of,
)
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.runtime.errors import CameraError
from pmcl_ros.runtime.settings import explain

LARGEST_RAW = 100_000_000  # bytes; an F01 picture has 16,137,600: more than this is no picture

_PARTS = ('metadata', 'privateMetadata')
_REFERENCES = ('imageRef', *(f'{part}Ref' for part in _PARTS))
_OUTSIDE = 'pmcl_ros.outside_master'  # what the camera wrote beside 'master', as 'debug'
_NAME = re.compile(r'\w[\w .+-]*', re.ASCII)


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

    Raises CameraError when the text is none of a camera.
    """
    CameraMetadata.parse(text)
    data = json_object(text.encode('utf-8', 'replace'), 'metadata')
    if 'master' not in data:
        frame = {'metadata': data, 'privateMetadata': {}}
        data = {'master': {'picture': {'frameArray': [{'frame': frame}]},
                           'version': {'major': 1, 'minor': 0}}}
    table = data.pop('master')
    frame = table['picture']['frameArray'][0]['frame']
    components = {f'{part}Ref': json_bytes(frame.pop(part), part)
                  for part in _PARTS if part in frame}
    components['imageRef'] = raw
    frame.update((name, reference_of(body)) for name, body in components.items())
    if data:
        table[_OUTSIDE] = data
    return container_bytes(table, [*components.values()])


def lfp_to_picture(container: Container) -> tuple[bytes, str]:
    """The .RAW and the .TXT that a container was built from; the text has the same JSON.

    Raises CameraError when it holds something else, as a refocused stack or a Lytro Illum's.
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

    pattern: as a shell has it, in any letter case: 'MOD_*' are the white images. A name is what
    follows the last \ or /, so that nothing is ever written beside the folder that was asked for.
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
