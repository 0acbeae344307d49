"""NPZ files: what their arrays would take is known before any is read."""

import math
import re
import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import FileError, PmclError

_MOST_ARRAYS = 1000  # of a file; each takes a header that is parsed
_KINDS = 'biufcSU'  # of numbers and text: no objects
_LENGTH_BYTES = {(1, 0): 2, (2, 0): 4}  # of a header's length, by the format's version
_MOST_HEADER = 10_000  # bytes, as in NumPy
_HEADER = re.compile(r"\{'descr': '([^']+)', 'fortran_order': (True|False), "
                     r"'shape': \(((?:\d+, ?)*\d*)\),? *\}\s*")


def read_arrays(path: Path | str, most: int) -> dict[str, NDArray[Any]]:
    """The arrays of a file by name; FileError where it is none, or they exceed `most` bytes.

    Their checksums are checked.
    """
    try:
        with zipfile.ZipFile(path) as file:
            members = [each for each in file.infolist() if each.filename.endswith('.npy')]
            size = sum(each.file_size for each in members)
            if len(members) > _MOST_ARRAYS or size > most:
                raise FileError(f'{len(members)} arrays of {size / 2 ** 20:.0f} MiB, at most '
                                f'{_MOST_ARRAYS} of {most / 2 ** 20:.0f} are read')
            found = {}
            for each in members:
                with file.open(each) as stream:
                    found[each.filename.removesuffix('.npy')] = _array(stream, each)
            return found
    except PmclError as error:
        raise FileError(f'{path}: {error}') from None
    except OSError as error:
        raise FileError(f'cannot read {path}: {error.strerror or error}') from None
    except MemoryError:
        raise
    except Exception as error:  # zipfile, zlib, lzma and numpy's parser of headers have their own
        raise FileError(f'cannot read {path}: {error or type(error).__name__}; expected an NPZ '
                        'file') from None


def _array(stream: IO[bytes], member: zipfile.ZipInfo) -> NDArray[Any]:
    shape, fortran, kind = _header(stream, member)
    if kind.kind not in _KINDS:
        raise FileError(f'{member.filename} holds {kind} of shape {shape}, expected numbers')
    size = math.prod(shape) * kind.itemsize
    # What is left of the member: what its header says must be what it has.
    if not 0 <= member.file_size - size <= 2 ** 16:
        raise FileError(f'{member.filename} says that it has {size} bytes, its shape {shape}, '
                        f'and has {member.file_size} with its header')
    values, place = np.empty(size, np.uint8), 0
    while place < size:
        block = stream.read(min(size - place, 2 ** 20))
        if not block:
            raise FileError(f'{member.filename} ends {size - place} bytes too early')
        values[place:place + len(block)] = np.frombuffer(block, np.uint8)
        place += len(block)
    if stream.read(1):  # at its end its checksum is checked
        raise FileError(f'{member.filename} has more bytes than its shape {shape} takes')
    return values.view(kind).reshape(shape, order='F' if fortran else 'C')


def _header(stream: IO[bytes], member: zipfile.ZipInfo
            ) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """(Shape, Fortran order, type) of an array: the NPY format of NumPy's `numpy.lib.format`.

    NumPy reads it with `ast.literal_eval`. CPython 3.11 fails in that now and then where two
    threads read, or one compiles (https://github.com/python/cpython/issues/106905).
    """
    version = np.lib.format.read_magic(stream)
    if version not in _LENGTH_BYTES:
        raise FileError(f'{member.filename} is of version {version}')
    length = int.from_bytes(stream.read(_LENGTH_BYTES[version]), 'little')
    if length > _MOST_HEADER:
        raise FileError(f'{member.filename} has a header of {length} bytes, at most '
                        f'{_MOST_HEADER} are read')
    header = stream.read(length).decode('latin1')
    found = _HEADER.fullmatch(header)
    if found is None:
        raise FileError(f'{member.filename} is no array of numbers: its header is {header!r:.200}')
    kind, fortran, shape = found.groups()
    return (tuple(int(side) for side in shape.replace(',', ' ').split()), fortran == 'True',
            np.dtype(kind))
