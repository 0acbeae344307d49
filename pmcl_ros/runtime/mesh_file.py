"""Mesh files that anybody may have written: bounded before they are parsed."""

import io
import logging
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from pmcl_ros.runtime.binary_file import read_bytes
from pmcl_ros.runtime.errors import FileError, ObjectModelError, PmclError, told_as
from pmcl_ros.runtime.mesh_repair import repair
from pmcl_ros.runtime.mesh_size import MeshSize, mesh_size

_LOG = logging.getLogger(__name__)
_MOST_FACES = 1_000_000  # ten times as many as make a search take minutes
_MOST_BYTES = 2 ** 26  # of a file: a binary STL of so many faces has 50 MB
_COMMA = re.compile(rb'(?:^|\n)[ \t]*+v(?:ertex)?+[ \t]++-?\d++,\d')  # in OBJ, and STL in text
_KINDS = 'stl', 'obj', 'ply', 'off', 'glb'  # of meshes; trimesh reads others with more libraries


def read_mesh(path: Path) -> trimesh.Trimesh:
    """The mesh of a file: finite vertices, a surface, not too many faces; else ObjectModelError.

    It is mended as `repair` says; what was mended is logged.
    """
    kind = path.suffix.lower().removeprefix('.')
    if not os.path.isfile(path):  # which takes any name
        raise ObjectModelError(f'no mesh file {path}')
    if kind not in _KINDS:
        raise ObjectModelError(f'{path} cannot be read as a mesh: {", ".join(_KINDS)} are read; '
                               'convert it, with Blender or MeshLab')
    with told_as(ObjectModelError, FileError):
        data = read_bytes(path, _MOST_BYTES, 'simplify it, or write it as a binary STL or PLY')
    try:
        _check_content(data)
        _check_size(mesh_size(data, kind))
        mesh = _whole(trimesh.load_mesh(io.BytesIO(data), file_type=kind, process=False))
        if not np.isfinite(mesh.triangles).all():
            raise ObjectModelError('has vertices that are not finite numbers')
        count = len(mesh.vertices)
        mended = repair(mesh)
        if not mesh.area > 0:
            raise ObjectModelError(f'holds {count} vertices but no surface')
    except PmclError as error:
        raise ObjectModelError(f'{path} {error}') from None
    except MemoryError:
        raise
    except Exception as error:  # trimesh's readers raise whatever their parsers raise
        raise ObjectModelError(f'{path} cannot be read as a mesh: {error!r}') from error
    if mended:
        _LOG.info('mesh %s: %s', path, ', '.join(mended))
    return mesh


def _check_content(data: bytes) -> None:
    """Raise ObjectModelError for what is often there in place of a mesh."""
    if not data:
        raise ObjectModelError('is empty')
    if data.startswith(b'version https://git-lfs'):
        raise ObjectModelError('only says where Git LFS keeps the mesh: git lfs pull fetches it')
    if _COMMA.search(data):
        raise ObjectModelError('has commas in its decimals: write them with points')


def _check_size(size: MeshSize) -> None:
    """Raise ObjectModelError for too many faces, or what no such mesh needs."""
    for name, count, most in (('faces', size.faces, _MOST_FACES),
                              ('vertices', size.vertices, 3 * _MOST_FACES),
                              ('corners', size.corners, 4 * _MOST_FACES),
                              ('lines', size.lines, 10 * _MOST_FACES)):
        if count > most:
            raise ObjectModelError(f'has {count} {name}, at most {most} are read; simplify it')


def _whole(loaded: Any) -> trimesh.Trimesh:
    """The parts of a file as one mesh; ObjectModelError for none, or too many faces."""
    scene = loaded if isinstance(loaded, trimesh.Scene) else trimesh.Scene(loaded)
    # A part may be there many times, by reference.
    parts = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
    faces = sum(len(getattr(each, 'faces', ())) for each in parts)
    if not faces:
        raise ObjectModelError('holds no faces, and so no surface')
    _check_size(MeshSize(0, faces))
    return loaded if isinstance(loaded, trimesh.Trimesh) else loaded.to_mesh()
