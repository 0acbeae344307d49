"""What the camera says by itself, on the callback connection (lytro_f01.md, A6)."""

import logging
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from pmcl_ros.camera.lytro.connection import dial
from pmcl_ros.camera.lytro.settings import Address, LinkSettings
from pmcl_ros.runtime.errors import LinkError, ProtocolError

HEARTBEAT = 'HeartbeatTick'
SHUTTER_PRESSED = 'ShutterPressed'
NEW_PICTURE = 'NewPictureAvailable'
PICTURE_DELETED = 'PictureDeleted'

_LONGEST = 4096  # bytes of an event; those of the camera have less than 80
_FIRST_PAUSE, _LONGEST_PAUSE = 0.1, 5.0  # seconds before the next try, doubled each time

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Event:
    """`[name] arguments`; `arrived_ns` is when, by this host's clock, since the epoch."""

    name: str
    arguments: tuple[str, ...] = ()
    arrived_ns: int = 0

    def encode(self) -> bytes:
        """The camera's bytes: the NUL comes after the end of the line."""
        return f'[{self.name}] {" ".join(self.arguments)}\r\n\0'.encode()


class EventParser:
    """Puts events together from pieces as they come."""

    def __init__(self) -> None:
        self._rest = b''

    def feed(self, data: bytes, arrived_ns: int = 0) -> list[Event]:
        """The events that `data` completes; ProtocolError when these are no events."""
        *complete, self._rest = (self._rest + data).split(b'\0')
        if len(self._rest) > _LONGEST:
            raise ProtocolError(f'a callback has no end: {self._rest[:48]!r} ...')
        return [_parse(each, arrived_ns) for each in complete]


def _parse(line: bytes, arrived_ns: int) -> Event:
    try:
        name, *arguments = line.decode().split()
    except ValueError:  # also UnicodeDecodeError
        name, arguments = '', []
    if len(name) < 3 or not (name[0] == '[' and name[-1] == ']'):
        raise ProtocolError(f'no callback: {line[:48]!r}')
    return Event(name[1:-1], tuple(arguments), arrived_ns)


class CallbackListener:
    """A thread that hands every event except heartbeats to `heard`, and connects again when lost.

    `connected` is told True after each connection, False when it is lost: what the camera said in
    between is lost too. Raises LinkError when the first connection cannot be made.
    """

    def __init__(self, address: Address, settings: LinkSettings, heard: Callable[[Event], None],
                 connected: Callable[[bool], None]) -> None:
        self._address, self._settings = address, settings
        self._heard, self._connected = heard, connected
        self._closed = threading.Event()
        self._socket = self._dial()
        self._thread = threading.Thread(target=self._run, name='lytro callbacks', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the connection and the thread."""
        self._closed.set()
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError as error:
            _log.debug('callbacks had ended: %s', error)
        self._thread.join(self._settings.timeout + 1)

    def _dial(self) -> socket.socket:
        dialled = dial(self._address.host, self._address.callback_port, self._settings.timeout)
        dialled.settimeout(self._settings.watchdog)
        return dialled

    def _run(self) -> None:
        self._connected(True)
        pause = _FIRST_PAUSE
        while True:
            began = time.monotonic()
            with self._socket:
                reason = self._listen()
            if self._closed.is_set():
                return
            self._connected(False)
            if time.monotonic() - began > _LONGEST_PAUSE:
                pause = _FIRST_PAUSE
            _log.warning('lost the callbacks of the camera (%s); connecting again', reason)
            while not self._closed.wait(pause):
                pause = min(2 * pause, _LONGEST_PAUSE)
                try:
                    self._socket = self._dial()
                    break
                except LinkError as error:
                    _log.debug('%s', error)
            if self._closed.is_set():
                self._socket.close()
                return
            self._connected(True)

    def _listen(self) -> str:
        """Hand events on until the connection is lost; why it was."""
        parser = EventParser()
        try:
            while data := self._socket.recv(4096):
                for event in parser.feed(data, time.time_ns()):
                    if event.name != HEARTBEAT:
                        self._heard(event)
        except TimeoutError:
            return f'no heartbeat for {self._settings.watchdog:g} s'
        except (OSError, ProtocolError) as error:
            return str(error)
        return 'the camera closed the connection'
