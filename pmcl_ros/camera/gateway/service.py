"""One camera for the requests of many robots, and a bounded cache of its pictures."""

import errno
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

_FULL = errno.ENOSPC, errno.EDQUOT
_REMEMBERED = 100  # captures whose keys are recognised when they are repeated

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class CachedFile:
    """A file of a picture. sha256: hex digits."""

    path: Path
    size: int
    sha256: str


class Cache:
    """Files by picture id, with least-recently-used eviction; usable from several threads.

    folder: parent of the cache's own folder, which `close` removes; default: the system's for
    temporary files. limit: bytes in all; the newest picture is kept even if it exceeds them.
    """

    def __init__(self, folder: Path | None = None, limit: int = 1 << 29) -> None:
        try:
            self._folder = tempfile.TemporaryDirectory(prefix='pmcl_gateway_', dir=folder)
        except OSError as error:
            raise CameraError(f'cannot keep pictures in {folder or tempfile.gettempdir()}: '
                              f'{error.strerror or error}') from None
        self._limit, self._closed = limit, False
        self._lock = threading.Lock()
        self._pictures: OrderedDict[str, dict[str, CachedFile]] = OrderedDict()
        self._numbers = itertools.count()

    def files(self, picture: str) -> Mapping[str, CachedFile] | None:
        """The files of a picture by kind, or None when they are not kept."""
        with self._lock:
            return self._pictures.get(picture)

    def open(self, picture: str, kind: str) -> tuple[CachedFile, BinaryIO] | None:
        """Open a file of a picture; it stays readable even if the picture is evicted meanwhile."""
        with self._lock:
            files = self._pictures.get(picture)
            if files is None:
                return None
            try:
                stream = files[kind].path.open('rb')
            except OSError:  # the folder for temporary files was cleaned up
                del self._pictures[picture]
                return None
            self._pictures.move_to_end(picture)
            return files[kind], stream

    def put(self, picture: str, contents: Mapping[str, bytes]) -> Mapping[str, CachedFile]:
        """Keep the files of a picture, kind -> content.

        Names on disk are numbers: paths never contain received text. On a full disk the oldest
        pictures go; raises CameraError when not even this one alone has room.
        """
        while True:
            try:
                files = self._written(contents)
                break
            except OSError as error:
                if error.errno not in _FULL or not self._evict():
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
        """Remove all files."""
        with self._lock:
            self._closed = True
            self._pictures.clear()
            self._folder.cleanup()

    def _written(self, contents: Mapping[str, bytes]) -> dict[str, CachedFile]:
        files = {}
        try:
            with self._lock:
                if not self._closed:  # the folder may have been cleaned up
                    Path(self._folder.name).mkdir(mode=0o700, parents=True, exist_ok=True)
            for kind, content in contents.items():
                path = Path(self._folder.name) / str(next(self._numbers))
                files[kind] = CachedFile(path, len(content), hashlib.sha256(content).hexdigest())
                path.write_bytes(content)
        except OSError:
            _remove(files)
            raise
        return files

    def _evict(self) -> bool:
        """Forget the picture that was not asked for longest; False where there is none."""
        with self._lock:
            if self._pictures:
                _remove(self._pictures.popitem(last=False)[1])
                return True
        return False

    def _size(self) -> int:
        return sum(file.size for files in self._pictures.values() for file in files.values())


def _remove(files: Mapping[str, CachedFile]) -> None:
    for file in files.values():
        file.path.unlink(missing_ok=True)


class BusyError(CameraError):
    """Another capture is in progress; this one was not started."""


@dataclass(frozen=True)
class CapturedPicture:
    """A picture that was taken, and its files by kind ('raw', 'txt').

    files: empty if the picture could not be fetched yet; `problem` is the reason.
    """

    picture: Picture
    files: Mapping[str, CachedFile]
    problem: str = ''


class Service:
    """One camera for many requests, usable from several threads.

    connect: creates the camera's client; every request calls it until it has succeeded.
    """

    def __init__(self, connect: Callable[[], CameraClient], cache: Cache) -> None:
        self._connect, self._cache = connect, cache
        self._client: CameraClient | None = None
        self._connecting, self._fetching = threading.Lock(), threading.Lock()
        self._lock = threading.Lock()  # of the attributes below
        self._capturing = False
        self._captures: OrderedDict[str, Future[CapturedPicture]] = OrderedDict()
        self._known: dict[str, Picture] = {}

    def status(self) -> CameraStatus:
        """Identity and state of the camera."""
        return self._camera().status()

    def pictures(self) -> list[Picture]:
        """All pictures on the card, oldest first."""
        found = self._camera().pictures()
        with self._lock:
            self._known = {each.id: each for each in found}
        return found

    def capture(self, key: str) -> CapturedPicture:
        """Take a picture and fetch it; a repeated `key` gets the same picture or error.

        Raises BusyError while a capture with another key is in progress.
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
        """Open a file ('raw' or 'txt') of a picture on the card; None: no such picture."""
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
        """End every connection and remove all cached files."""
        with self._connecting:
            if self._client is not None:
                self._client.close()
        self._cache.close()

    def _camera(self) -> CameraClient:
        with self._connecting:
            if self._client is None:
                self._client = self._connect()
            return self._client

    def _run(self, future: 'Future[CapturedPicture]') -> None:
        outcome: CapturedPicture | BaseException
        try:
            outcome = self._capture()
        except BaseException as error:
            outcome = error
        with self._lock:
            self._capturing = False  # first: a waiting client may request the next
        if isinstance(outcome, CapturedPicture):
            future.set_result(outcome)
        else:
            future.set_exception(outcome)

    def _capture(self) -> CapturedPicture:
        picture = self._camera().capture()
        with self._lock:
            self._known[picture.id] = picture
        _LOG.info('took %s', picture.id)
        try:
            return CapturedPicture(picture, self._files(picture))
        except CameraError as error:
            _LOG.warning('%s is on the card, but could not be fetched: %s', picture.id, error)
            return CapturedPicture(picture, {}, str(error))

    def _files(self, picture: Picture) -> Mapping[str, CachedFile]:
        with self._fetching:  # a thread that waited here finds the files in the cache
            files = self._cache.files(picture.id)
            if files is None:
                raw, text = self._camera().fetch(picture)
                files = self._cache.put(picture.id, {'raw': raw, 'txt': text.encode()})
            return files
