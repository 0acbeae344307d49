"""The callback connection, and the new pictures that its events announce (lytro_f01.md, A6)."""

import logging
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone

from pmcl_ros.camera.client import Picture
from pmcl_ros.camera.lytro.address import Address, LinkSettings
from pmcl_ros.camera.lytro.link import dial
from pmcl_ros.camera.lytro.protocol import PictureRecord
from pmcl_ros.runtime.errors import LinkError, ProtocolError

HEARTBEAT = 'HeartbeatTick'
SHUTTER_PRESSED = 'ShutterPressed'
NEW_PICTURE = 'NewPictureAvailable'
PICTURE_DELETED = 'PictureDeleted'

_LONGEST = 4096  # bytes of an event; the camera's have less than 80
_FIRST_PAUSE, _LONGEST_PAUSE = 0.1, 5.0  # seconds before the next try, doubled each time
_EPOCH, _MICROSECOND = datetime(1970, 1, 1, tzinfo=timezone.utc), timedelta(microseconds=1)
_SAME_SHOT_NS = 5_000_000_000  # between command, callback and the camera's date of one picture
_OLDEST_NS = 60_000_000_000  # a shot without a picture after this time gets none
_END_NS = 2**31 * 10**9  # of ROS's stamps, in 2038; no picture is of later, nor before 1970
_PATIENCE = 5.0  # seconds for an announced picture to be in the list

_LOG = logging.getLogger(__name__)


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
    """Assembles events from received pieces."""

    def __init__(self) -> None:
        self._rest = b''

    def feed(self, data: bytes, arrived_ns: int = 0) -> list[Event]:
        """The events that `data` completes; ProtocolError for anything else."""
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
    """A thread that passes every event except heartbeats to `heard`, and reconnects.

    `connected` is called with True after each connection and with False when it is lost; events
    in between are lost. Raises LinkError when the first connection cannot be made.
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
            _LOG.debug('callbacks had ended: %s', error)
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
            _LOG.warning('lost the callbacks of the camera (%s); connecting again', reason)
            while not self._closed.wait(pause):
                pause = min(2 * pause, _LONGEST_PAUSE)
                try:
                    self._socket = self._dial()
                    break
                except LinkError as error:
                    _LOG.debug('%s', error)
            if self._closed.is_set():
                self._socket.close()
                return
            self._connected(True)

    def _listen(self) -> str:
        """Pass events on until the connection is lost; the reason of the loss."""
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


@dataclass(eq=False)
class Shot:
    """A press of the shutter, with times of this host's clock [ns since the epoch].

    sent_ns: just before the command was sent; None: the camera's own button was pressed.
    pressed_ns: arrival of the ShutterPressed callback; None: not yet.
    picture: the resulting picture; None: not yet.
    """

    sent_ns: int | None = None
    pressed_ns: int | None = None
    picture: Picture | None = None

    @property
    def stamp_ns(self) -> int:
        """Best estimate of the time of the shutter."""
        return self.pressed_ns or self.sent_ns or 0


class Arrivals:
    """Matches commands, callbacks and picture lists; safe to use from several threads.

    The list decides which pictures exist. Callbacks say when to read it, and which picture is
    complete. After a gap in the callbacks every new picture in the list counts as complete.
    """

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.clock_ahead_ns = 0  # the camera's clock less this host's
        self._pictures: dict[str, Picture] | None = None  # on the card and complete, oldest first
        self._announced: dict[str, float] = {}  # not in the list yet: time of the announcement
        self._shots: list[Shot] = []  # without a picture so far
        self._connected, self._gap = True, False

    @property
    def pending(self) -> bool:
        """Whether the list should be read."""
        with self.changed:
            return bool(self._announced) or self._gap

    def commanded(self, sent_ns: int) -> Shot:
        """Record that a capture command is about to be sent."""
        with self.changed:
            self._shots.append(Shot(sent_ns))
            return self._shots[-1]

    def given_up(self, shot: Shot) -> None:
        """Forget a shot without a picture."""
        with self.changed:
            if shot in self._shots:
                self._shots.remove(shot)

    def pressed(self, arrived_ns: int) -> None:
        """Record a ShutterPressed callback."""
        with self.changed:
            for shot in self._shots:
                if (shot.pressed_ns is None and shot.sent_ns is not None
                        and abs(arrived_ns - shot.sent_ns) < _SAME_SHOT_NS):
                    shot.pressed_ns = arrived_ns
                    break
            else:
                self._shots.append(Shot(pressed_ns=arrived_ns))

    def announced(self, identity: str) -> None:
        """Record a NewPictureAvailable callback."""
        with self.changed:
            if identity not in (self._pictures or {}):
                self._announced[identity] = time.monotonic()
                self.changed.notify_all()

    def callbacks(self, connected: bool) -> None:
        """Record that the callback connection was made, or lost."""
        with self.changed:
            self._gap = self._gap or not connected
            self._connected = connected
            self.changed.notify_all()

    def listed(self, records: list[PictureRecord], *, all_complete: bool = False) -> list[Picture]:
        """Record the camera's list (newest first); the complete pictures, oldest first.

        All pictures of the first list are complete. all_complete: include pictures that were not
        announced.
        """
        with self.changed:
            first, known = self._pictures is None, self._pictures or {}
            everything = first or all_complete or self._gap
            pictures: dict[str, Picture] = {}
            for record in reversed(records):
                if record.id in known:
                    pictures[record.id] = known[record.id]
                elif everything or record.id in self._announced:
                    pictures[record.id] = self._arrived(record)
            self._pictures = pictures
            oldest = time.monotonic() - _PATIENCE
            self._announced = {each: since for each, since in self._announced.items()
                               if each not in pictures and since > oldest}
            self._gap = not self._connected
            return list(pictures.values())

    def wait(self, seconds: float) -> None:
        """Wait until `pending`, at most so long."""
        with self.changed:
            self.changed.wait_for(lambda: self._announced or self._gap, seconds)

    def _arrived(self, record: PictureRecord) -> Picture:
        """The picture of a record, stamped by the shot nearest to the camera's date, if any."""
        date = record.taken
        oldest = time.time_ns() - _OLDEST_NS
        self._shots = [each for each in self._shots if each.stamp_ns > oldest]
        taken_ns = -1 if date is None else (
            (date - _EPOCH) // _MICROSECOND * 1000 - self.clock_ahead_ns)
        if not 0 <= taken_ns < _END_NS:
            taken_ns, shots = 0, self._shots
        else:
            shots = [each for each in self._shots if record.id in self._announced
                     or abs(each.stamp_ns - taken_ns) < _SAME_SHOT_NS]
        if not shots:
            return Picture(record.id, taken_ns)
        shot = min(shots, key=lambda each: abs(each.stamp_ns - taken_ns))
        self._shots.remove(shot)
        shot.picture = Picture(record.id, shot.stamp_ns)
        return shot.picture
