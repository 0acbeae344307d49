"""Frames of the command connection: a 28-byte header, then a payload (lytro_f01.md, A2, A3)."""

import struct
from dataclasses import dataclass, field
from enum import IntEnum

from pmcl_ros.runtime.errors import ProtocolError

MAGIC = 0xFAAA55AF
HEADER_LENGTH = 28
CHUNK = 0x200000  # bytes: the largest piece that the camera hands out at once

_HEADER = struct.Struct('<IIIHB13s')
_NO_PAYLOAD, _RESPONSE = 1, 2  # bits of the flags


class Command(IntEnum):
    """Class and sub-command of a request, class * 256 + sub-command."""

    TAKE_PICTURE = 0xC000
    SET_TIME = 0xC004
    DELETE_PICTURE = 0xC005
    MANUAL_CONTROL = 0xC00C
    WIFI_OFF = 0xC00D
    INJECT_UART = 0xC0FE
    MONITOR = 0xC0FF
    LOAD_HARDWARE_INFO = 0xC200
    LOAD_FILE = 0xC201
    LOAD_PICTURE_LIST = 0xC202
    LOAD_PICTURE = 0xC205
    LOAD_CALIBRATION = 0xC206
    DOWNLOAD = 0xC400
    CONTENT_LENGTH = 0xC600
    UART_TEXT = 0xC602
    CAMERA_TIME = 0xC603
    BATTERY = 0xC606


@dataclass(frozen=True)
class Header:
    """The first 28 bytes of every message.

    code: class * 256 + sub-command, a `Command` where it is a known one.
    length: bytes of payload that follow; in a request without payload the room for the reply.
    parameters: 13 bytes.
    """

    code: int
    length: int
    flags: int
    parameters: bytes = bytes(13)

    @property
    def has_payload(self) -> bool:
        """Whether this request is followed by `length` bytes."""
        return not self.flags & _NO_PAYLOAD

    @property
    def offset(self) -> int:
        """Where in the transfer buffer a download begins, bytes."""
        return int.from_bytes(self.parameters[:4], 'little')

    def reply(self, length: int) -> 'Header':
        """The header of the reply to this request, with `length` bytes of payload."""
        return Header(self.code, length, self.flags | _RESPONSE, self.parameters)

    def encode(self) -> bytes:
        """The 28 bytes."""
        return _HEADER.pack(MAGIC, self.length, self.flags, self.code >> 8, self.code & 255,
                            self.parameters)

    @classmethod
    def decode(cls, data: bytes) -> 'Header':
        """Read 28 bytes; ProtocolError when they are not the beginning of a message."""
        if len(data) != HEADER_LENGTH:
            raise ProtocolError(f'a header has {HEADER_LENGTH} bytes, got {len(data)}')
        magic, length, flags, group, sub, parameters = _HEADER.unpack(data)
        if magic != MAGIC or group > 255:
            raise ProtocolError(f'no header of a message begins with {data[:16].hex(" ")}')
        return cls(group << 8 | sub, length, flags, parameters)


@dataclass(frozen=True)
class Request:
    """What a client asks.

    payload: sent with it, or None. room: most bytes of payload that the reply may have; a reply to
    a request with payload mirrors it, or is empty.
    """

    command: Command
    payload: bytes | None = None
    room: int = 0
    parameters: bytes = field(default=b'')

    @property
    def header(self) -> Header:
        """What is sent first."""
        parameters = self.parameters.ljust(13, b'\0')
        if self.payload is None:
            return Header(self.command, self.room, _NO_PAYLOAD, parameters)
        return Header(self.command, len(self.payload), 0, parameters)

    def encode(self) -> bytes:
        """The bytes to send."""
        return self.header.encode() + (self.payload or b'')

    def check(self, reply: Header) -> int:
        """How many bytes of payload follow `reply`; ProtocolError when it answers something else.

        The length is bounded by what was asked for, before anything is allocated.
        """
        asked = self.header
        expected = asked.reply(reply.length)
        if reply != expected:
            raise ProtocolError(f'asked {asked.encode()[8:].hex(" ")}, the reply is to '
                                f'{reply.encode()[8:].hex(" ")}')
        if reply.length > asked.length:
            raise ProtocolError(f'the reply to {self.command.name} announces {reply.length} '
                                f'bytes, at most {asked.length} were asked for')
        return reply.length


def load_file(path: str) -> Request:
    r"""Put a file into the transfer buffer, by its path on the camera (I:\DCIM\...)."""
    return Request(Command.LOAD_FILE, path.encode() + b'\0')


def download(offset: int, room: int) -> Request:
    """Up to `room` bytes of the transfer buffer, from byte `offset`."""
    return Request(Command.DOWNLOAD, room=room, parameters=struct.pack('<I', offset))


TAKE_PICTURE = Request(Command.TAKE_PICTURE)
LOAD_HARDWARE_INFO = Request(Command.LOAD_HARDWARE_INFO)
LOAD_PICTURE_LIST = Request(Command.LOAD_PICTURE_LIST)
LOAD_CALIBRATION = Request(Command.LOAD_CALIBRATION)
CONTENT_LENGTH = Request(Command.CONTENT_LENGTH, room=4)
CAMERA_TIME = Request(Command.CAMERA_TIME, room=14)
BATTERY = Request(Command.BATTERY, room=4)
