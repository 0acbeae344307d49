"""Files that anybody may have written, read as bytes: bounded before they are read."""

import hashlib
from pathlib import Path

from pmcl_ros.runtime.errors import FileError

_BLOCK = 2 ** 20  # bytes


def read_bytes(path: Path, most: int, otherwise: str = 'expected a smaller file') -> bytes:
    """The bytes of a file; FileError where it cannot be read, or has more than `most`.

    otherwise: what to do about a file that has more, for the message.
    """
    try:
        with path.open('rb') as stream:
            data = stream.read(most + 1)
    except OSError as error:
        raise FileError(f'cannot read {path}: {error.strerror or error}; check the path') from None
    if len(data) > most:
        raise FileError(f'{path} has more than {most / 2 ** 20:g} MiB: {otherwise}')
    return data


def sha256(path: Path) -> str:
    """The digest of a file; OSError where it cannot be read."""
    digest = hashlib.sha256()
    with path.open('rb') as stream:
        while block := stream.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()
