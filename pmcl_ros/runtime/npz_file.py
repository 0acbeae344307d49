"""NPZ files: what their arrays would take is known before any is read."""

import math
import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import FileError, PmclError

_MOST_ARRAYS = 1000
_KINDS = 'biufcSU'  # of numbers and text: no objects
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0}


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
    with_header = np.lib.format.read_magic(stream)
    if with_header not in _HEADERS:
        raise FileError(f'{member.filename} is of version {with_header}')
    shape, fortran, kind = _HEADERS[with_header](stream)
    if kind.kind not in _KINDS or any(side < 0 for side in shape):
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
