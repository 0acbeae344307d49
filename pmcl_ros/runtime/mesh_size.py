"""How large a mesh is by its file, before a library makes a hundred bytes of each number in it."""

import json
import re
import struct
from typing import NamedTuple

import numpy as np

from pmcl_ros.runtime.errors import ObjectModelError

_COUNT = rb'(\d{1,18})'
_BETWEEN = rb'(?:\s|#[^\n]*+\n)*+'  # white space and comments
_OFF = re.compile(_BETWEEN + rb'\w*OFF' + _BETWEEN + _COUNT + rb'\s++' + _COUNT)
_PLY = re.compile(rb'element\s++(vertex|face)\s++' + _COUNT)
_STL_HEAD, _STL_FACE = 84, 50  # bytes, of binary files
_TRIANGLE = 3  # corners


class MeshSize(NamedTuple):
    """What a file says that it has, or its lines say.

    corners: of its faces, fewer than there are. lines: of a file in text, else 0.
    """

    vertices: int
    faces: int
    corners: int = 0
    lines: int = 0


def mesh_size(data: bytes, kind: str) -> MeshSize:
    """Of a whole file. kind: stl, obj, ply, off or glb. A polygon counts as one face.

    Raises ObjectModelError, ValueError, LookupError, TypeError or struct.error where it is no such
    file.
    """
    return {'stl': _stl, 'obj': _obj, 'ply': _ply, 'off': _off, 'glb': _glb}[kind](data)


def _stl(data: bytes) -> MeshSize:
    faces = more = 0
    if len(data) >= _STL_HEAD:
        faces, = struct.unpack_from('<I', data, _STL_HEAD - 4)
        more = len(data) - _STL_HEAD - _STL_FACE * faces
        if more == 0:
            return MeshSize(_TRIANGLE * faces, faces)
    text = data.lower()
    corners = text.count(b'vertex')
    if corners or b'facet' in text:
        return MeshSize(corners, corners // _TRIANGLE)
    if more == 0 or b'\0' not in data:  # which the numbers of a binary file have
        raise ObjectModelError('is no STL')
    what = 'is cut short: its header tells' if more < 0 else 'is longer than its header tells:'
    raise ObjectModelError(f'{what} {faces} faces')


def _obj(data: bytes) -> MeshSize:
    vertices, normals, textures, faces = (
        sum(data.count(b'\n' + name + space) for space in (b' ', b'\t')) + data.startswith(name)
        for name in (b'v', b'vn', b'vt', b'f'))
    # A vertex has up to 7 numbers, with a weight and a colour.
    corners = _words(data) - 8 * vertices - 4 * (normals + textures) - faces
    return MeshSize(max(vertices, normals, textures), faces, corners, data.count(b'\n'))


def _ply(data: bytes) -> MeshSize:
    end = data.find(b'end_header')
    if end < 0:
        raise ValueError('a PLY has end_header')
    counts = {name: int(count) for name, count in _PLY.findall(data, 0, end)}
    vertices, faces = counts.get(b'vertex', 0), counts.get(b'face', 0)
    others = data.count(b'property', 0, end) * (vertices + faces)
    if b'ascii' in data[:end]:
        return MeshSize(vertices, faces, _words(data) - others, data.count(b'\n'))
    return MeshSize(vertices, faces, (len(data) - end - 8 * others) // 4)


def _off(data: bytes) -> MeshSize:
    found = _OFF.match(data)
    if found is None:
        raise ValueError('an OFF begins with OFF and the numbers of its vertices and faces')
    vertices, faces = int(found[1]), int(found[2])
    # Each may have a colour of four numbers.
    return MeshSize(vertices, faces, _words(data) - 7 * vertices - 5 * faces, data.count(b'\n'))


def _words(data: bytes) -> int:
    """Number of words, with white space between them."""
    written = np.frombuffer(data, np.uint8) > ord(' ')
    return int(np.count_nonzero(written[1:] & ~written[:-1])) + 1


def _glb(data: bytes) -> MeshSize:
    length, = struct.unpack_from('<I', data, 12)
    head = json.loads(data[20:20 + length])
    accessors, vertices, faces = head['accessors'], 0, 0
    for part in (part for mesh in head['meshes'] for part in mesh['primitives']):
        corners = accessors[part['attributes']['POSITION']]['count']
        vertices += corners
        faces += (accessors[part['indices']]['count'] if 'indices' in part
                  else corners) // _TRIANGLE
    return MeshSize(vertices, faces)
