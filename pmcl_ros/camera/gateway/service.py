"""What a gateway does with its camera, whoever asks and in whatever language."""

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import BinaryIO

from pmcl_ros.camera.client import CameraClient, CameraStatus, Picture
from pmcl_ros.camera.gateway.cache import Cache, CachedFile
from pmcl_ros.runtime.errors import CameraError

_REMEMBERED = 100  # captures whose keys are not taken for new ones

_log = logging.getLogger(__name__)


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
