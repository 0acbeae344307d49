"""A simulated camera: its state, and its answer to each command (lytro_f01.md, A2 to A6)."""

import asyncio
import hashlib
import logging
import struct
import time
from collections.abc import Callable
from datetime import datetime, timedelta, timezone

from pmcl_ros.camera.lytro import events
from pmcl_ros.camera.lytro.events import Event
from pmcl_ros.camera.lytro.protocol import (
    Command,
    HardwareInfo,
    Header,
    decode_time,
    encode_picture_list,
    encode_time,
)
from pmcl_ros.camera.simulated.card import Card
from pmcl_ros.camera.simulated.faults import Faults
from pmcl_ros.runtime.errors import CameraError

_SOFTWARE = 'v1.0a208, vv1.2.2, simulated'
_LONGEST_LOG = 0xFFFFF  # bytes, the most that a client asks for

_LOG = logging.getLogger(__name__)


class SimulatedCamera:
    """State of the camera; used by one event loop.

    delay: seconds from the shutter to NewPictureAvailable. battery: percent.
    """

    def __init__(self, card: Card, *, faults: Faults | None = None, delay: float = 0.5,
                 battery: float = 87.5) -> None:
        self.card, self.faults = card, faults or Faults()
        self._delay, self._battery = delay, battery
        self._clock_ahead = timedelta(0)
        self._buffer = b''
        self._unlocked = False
        self._uart = b''
        self._listeners: set[asyncio.Queue[Event]] = set()
        self._pending: set[asyncio.TimerHandle] = set()
        self._answers: dict[int, Callable[[bytes], bytes]] = {
            Command.TAKE_PICTURE: self._take_picture,
            Command.SET_TIME: self._set_time,
            Command.DELETE_PICTURE: self._delete,
            Command.MANUAL_CONTROL: _mirror,
            Command.WIFI_OFF: _mirror,
            Command.INJECT_UART: self._log_text,
            Command.MONITOR: self._monitor,
            Command.CONTENT_LENGTH: lambda _: struct.pack('<I', len(self._buffer)),
            Command.UART_TEXT: self._read_uart,
            Command.CAMERA_TIME: lambda _: encode_time(self._now()),
            Command.BATTERY: lambda _: struct.pack('<f', self._battery),
        }
        self._loads: dict[int, Callable[[bytes], Callable[[], bytes] | None]] = {
            Command.LOAD_HARDWARE_INFO: lambda _: self._hardware_info,
            Command.LOAD_FILE: lambda path: self.card.file(_text(path)),
            Command.LOAD_PICTURE_LIST: lambda _: lambda: encode_picture_list(self.card.records),
            Command.LOAD_PICTURE: self._load_picture,
            Command.LOAD_CALIBRATION: lambda _: self.card.calibration,
        }

    async def answer(self, header: Header, payload: bytes) -> bytes | memoryview:
        """The payload of the reply; empty for a command that the camera does not know."""
        if header.code == Command.DOWNLOAD or header.code == Command.DOWNLOAD + 1:
            return self._download(header)
        if header.code in self._loads and not header.parameters[0]:
            found = await self._load(header.code, payload)
            return payload if found else b''
        if header.code in self._answers:
            reply = self._answers[header.code](payload)
            return reply if header.has_payload else reply[:header.length]
        _LOG.info('unknown command %04X', header.code)
        return b''

    def listen(self) -> 'asyncio.Queue[Event]':
        """A queue of events from now on; end it with `ignore`."""
        queue: asyncio.Queue[Event] = asyncio.Queue(1000)
        self._listeners.add(queue)
        return queue

    def ignore(self, queue: 'asyncio.Queue[Event]') -> None:
        """Stop events for `queue`."""
        self._listeners.discard(queue)

    def close(self) -> None:
        """Cancel the completion of pending pictures."""
        for each in self._pending:
            each.cancel()

    def press_shutter(self) -> None:
        """Take the next capture: ShutterPressed now, NewPictureAvailable after the delay."""
        if self.faults.refused():
            _LOG.info('command to take a picture ignored: busy or full')
            return
        record, capture = self.card.expose(self._now())
        self._notify(events.SHUTTER_PRESSED, 'CLICK')

        def complete() -> None:
            self._pending.discard(timer)
            self.card.store(record, capture)
            self._notify(events.NEW_PICTURE, record.id)
            _LOG.info('%s is %s', record.name, capture.path)

        timer = asyncio.get_running_loop().call_later(self._delay, complete)
        self._pending.add(timer)

    def _notify(self, name: str, argument: str) -> None:
        for queue in self._listeners:
            if queue.full():
                queue.get_nowait()  # a slow listener loses the oldest
            queue.put_nowait(Event(name, (argument,)))

    def _now(self) -> datetime:
        try:
            return datetime.now(timezone.utc) + self._clock_ahead
        except OverflowError:
            return datetime.max.replace(tzinfo=timezone.utc)  # where the clock stands still

    # the transfer buffer

    async def _load(self, code: int, payload: bytes) -> bool:
        read = self._loads[code](payload)
        if read is None:
            return False
        try:
            self._buffer = await asyncio.to_thread(read)
        except (CameraError, OSError) as error:
            _LOG.warning('%s', error)
            return False
        return True

    def _download(self, header: Header) -> memoryview:
        room = 0 if header.has_payload else header.length
        if self.faults.short_chunks is not None:
            room = min(room, self.faults.short_chunks)
        return memoryview(self._buffer)[header.offset:header.offset + room]

    def _hardware_info(self) -> bytes:
        return HardwareInfo('Lytro, Inc.', self.card.serial, 'simulated', _SOFTWARE).encode()

    def _load_picture(self, payload: bytes) -> Callable[[], bytes] | None:
        text = _text(payload)
        read = self.card.picture(text[:-1], text[-1:])
        if read is None:
            return None
        return lambda: _counted(read())

    # commands

    def _take_picture(self, _: bytes) -> bytes:
        self.press_shutter()
        return b''

    def _set_time(self, payload: bytes) -> bytes:
        try:
            self._clock_ahead = decode_time(payload) - datetime.now(timezone.utc)
        except CameraError as error:
            _LOG.info('clock not set: %s', error)
        return payload

    def _delete(self, payload: bytes) -> bytes:
        record = self.card.delete(payload)
        if record is not None:
            self.faults.deleted()
            self._notify(events.PICTURE_DELETED, record.id)
        return payload

    def _monitor(self, payload: bytes) -> bytes:
        text = _text(payload)
        if text == hashlib.sha1(f'{self.card.serial} please'.encode()).hexdigest():
            self._unlocked = True
            self._log_text(b'monitor unlocked')
        elif self._unlocked:
            self._log_text(payload)
            if text.split(' ')[0] == 'rficapture':
                self.press_shutter()
        return payload

    def _log_text(self, payload: bytes) -> bytes:
        line = f'\x1b[m[{time.monotonic():015.6f}] {_text(payload)}\r\n'.encode()
        self._uart = (self._uart + line)[-_LONGEST_LOG:]
        return payload

    def _read_uart(self, _: bytes) -> bytes:
        text, self._uart = self._uart, b''
        return text


def _mirror(payload: bytes) -> bytes:
    return payload


def _counted(content: bytes) -> bytes:
    """Data of a load by id: clients of real cameras skip the first four bytes."""
    return struct.pack('<I', len(content)) + content


def _text(payload: bytes) -> str:
    """The text before the first NUL."""
    return payload.split(b'\0', 1)[0].decode('utf-8', 'replace')
