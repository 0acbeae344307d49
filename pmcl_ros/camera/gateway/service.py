"""One camera for the requests of many robots, and a bounded cache of its pictures."""

import hashlib
import itertools
import logging
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from pmcl_ros.camera.client import CameraClient, CameraStatus, Picture
from pmcl_ros.runtime.errors import CameraError

_REMEMBERED = 100  # captures whose keys are not taken for new ones
_log = logging.getLogger(__name__)


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


class BusyError(CameraError):
    """Another capture is under way; this one was not begun."""


@dataclass(frozen=True)
class Capture:
    """A picture that was taken, and its files by kind ('raw', 'txt').

    files: empty where the picture could not be fetched yet, `problem` says why; it is on the card.
    """

    picture: Picture
    files: Mapping[str, CachedFile]
    problem: str = ''


class Service:
    """One camera for many requests, usable from several threads.

    connect: makes the client of the camera; called again by every request until it succeeds.
    """

    def __init__(self, connect: Callable[[], CameraClient], cache: Cache) -> None:
        self._connect, self._cache = connect, cache
        self._client: CameraClient | None = None
        self._connecting, self._fetching = threading.Lock(), threading.Lock()
        self._lock = threading.Lock()  # of what follows
        self._capturing = False
        self._captures: OrderedDict[str, Future[Capture]] = OrderedDict()
        self._known: dict[str, Picture] = {}

    def status(self) -> CameraStatus:
        """Who the camera is and how it is."""
        return self._camera().status()

    def pictures(self) -> list[Picture]:
        """What is on the card, oldest first."""
        found = self._camera().pictures()
        with self._lock:
            self._known = {each.id: each for each in found}
        return found

    def capture(self, key: str) -> Capture:
        """Take a picture and fetch it; the same `key` again gets the same picture, or error.

        Raises BusyError while a capture of another key is under way.
        """
        with self._lock:
            future = self._captures.get(key)
            mine = future is None
            if future is None:
                if self._capturing:
                    raise BusyError('a picture is being taken; try again when it is')
                self._capturing = True
                future = self._captures[key] = Future()
                while len(self._captures) > _REMEMBERED:
                    self._captures.popitem(last=False)
        if mine:
            self._run(future)
        return future.result()

    def open(self, identity: str, kind: str) -> tuple[CachedFile, BinaryIO] | None:
        """A file ('raw' or 'txt') of a picture on the card; None when there is no such picture."""
        with self._lock:
            picture = self._known.get(identity)
        if picture is None:
            picture = {each.id: each for each in self.pictures()}.get(identity)
        if picture is None:
            return None
        while (found := self._cache.open(picture.id, kind)) is None:
            self._files(picture)
        return found

    def close(self) -> None:
        """End every connection, forget every picture."""
        with self._connecting:
            if self._client is not None:
                self._client.close()
        self._cache.close()

    def _camera(self) -> CameraClient:
        with self._connecting:
            if self._client is None:
                self._client = self._connect()
            return self._client

    def _run(self, future: 'Future[Capture]') -> None:
        outcome: Capture | BaseException
        try:
            outcome = self._capture()
        except BaseException as error:
            outcome = error
        with self._lock:
            self._capturing = False  # before anybody hears of it and asks for the next
        if isinstance(outcome, Capture):
            future.set_result(outcome)
        else:
            future.set_exception(outcome)

    def _capture(self) -> Capture:
        picture = self._camera().capture()
        with self._lock:
            self._known[picture.id] = picture
        _log.info('took %s', picture.id)
        try:
            return Capture(picture, self._files(picture))
        except CameraError as error:
            _log.warning('%s is on the card, but could not be fetched: %s', picture.id, error)
            return Capture(picture, {}, str(error))

    def _files(self, picture: Picture) -> Mapping[str, CachedFile]:
        with self._fetching:  # who waits here finds it kept then
            files = self._cache.files(picture.id)
            if files is None:
                raw, text = self._camera().fetch(picture)
                files = self._cache.put(picture.id, {'raw': raw, 'txt': text.encode()})
            return files
