"""Pictures that were fetched from the camera, kept in a folder of bounded size."""

import hashlib
import itertools
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from pmcl_ros.runtime.errors import CameraError


@dataclass(frozen=True)
class CachedFile:
    """A file of a picture. sha256: hex digits."""

    path: Path
    size: int
    sha256: str


class Cache:
    """Picture id -> its files, the least recently used forgotten; usable from several threads.

    folder: where a folder of its own is made, which `close` removes; by default the system's for
    temporary files. limit: bytes in all; the newest picture is kept even if it alone has more.
    """

    def __init__(self, folder: Path | None = None, limit: int = 1 << 29) -> None:
        try:
            self._folder = tempfile.TemporaryDirectory(prefix='pmcl_gateway_', dir=folder)
        except OSError as error:
            raise CameraError(f'cannot keep pictures in {folder or tempfile.gettempdir()}: '
                              f'{error.strerror or error}') from None
        self._limit = limit
        self._lock = threading.Lock()
        self._pictures: OrderedDict[str, dict[str, CachedFile]] = OrderedDict()
        self._numbers = itertools.count()

    def files(self, picture: str) -> Mapping[str, CachedFile] | None:
        """The files of a picture by kind, or None when they are not kept."""
        with self._lock:
            return self._pictures.get(picture)

    def open(self, picture: str, kind: str) -> tuple[CachedFile, BinaryIO] | None:
        """A file of a picture, readable until it is closed even if it is forgotten meanwhile."""
        with self._lock:
            files = self._pictures.get(picture)
            if files is None:
                return None
            try:
                stream = files[kind].path.open('rb')
            except OSError:  # somebody tidied up the folder for temporary files
                del self._pictures[picture]
                return None
            self._pictures.move_to_end(picture)
            return files[kind], stream

    def put(self, picture: str, contents: Mapping[str, bytes]) -> Mapping[str, CachedFile]:
        """Keep the files of a picture, kind -> content.

        Names on disk are numbers: nothing that came over a network is part of a path. Raises
        CameraError when the disk is full.
        """
        files = {}
        try:
            for kind, content in contents.items():
                path = Path(self._folder.name) / str(next(self._numbers))
                files[kind] = CachedFile(path, len(content), hashlib.sha256(content).hexdigest())
                path.write_bytes(content)
        except OSError as error:
            _remove(files)
            raise CameraError(f'cannot keep {picture} in {self._folder.name}: '
                              f'{error.strerror or error}') from None
        with self._lock:
            if picture in self._pictures:
                _remove(self._pictures.pop(picture))
            self._pictures[picture] = files
            while len(self._pictures) > 1 and self._size() > self._limit:
                _remove(self._pictures.popitem(last=False)[1])
        return files

    def close(self) -> None:
        """Forget everything."""
        with self._lock:
            self._pictures.clear()
            self._folder.cleanup()

    def _size(self) -> int:
        return sum(file.size for files in self._pictures.values() for file in files.values())


def _remove(files: Mapping[str, CachedFile]) -> None:
    for file in files.values():
        file.path.unlink(missing_ok=True)
