"""The camera's protocol: frames, commands, payloads (lytro_f01.md, A2, A3, A5)."""

import math
import re
import struct
from dataclasses import dataclass, field
from datetime import datetime, timezone
from enum import IntEnum

from pmcl_ros.runtime.errors import ProtocolError

MAGIC = 0xFAAA55AF
HEADER_LENGTH = 28  # bytes of every message; below, of two replies
HARDWARE_INFO_LENGTH = 644
RECORD_LENGTH = 128
CHUNK = 0x200000  # bytes: the largest piece that the camera hands out at once

_HEADER = struct.Struct('<IIIHB13s')
_NO_PAYLOAD, _RESPONSE = 1, 2  # bits of the flags
_HARDWARE = struct.Struct('<256s128s128s128sI')
_RECORD = struct.Struct('<8s8sii16xif48s28si')
_KEY_LENGTH = 24
_TIME = struct.Struct('<7H')
_FILE_ENTRY = struct.Struct('<I32s')
_LONGEST_RECORD = 4096  # bytes; a camera's have 128
_MOST_PICTURES = 100_000  # 16 GB, the largest card, holds a thousand
_MOST_FILES = 4096  # a camera has some hundreds; a longer table is damaged
# Offsets of the fields of a record, which the header of the list repeats.
_FIELD_OFFSETS = (0x00, 0x08, 0x10, 0x14, 0x18, 0x28, 0x2C, 0x30, 0x60, 0x7C)
# Names become paths, on the camera and on this machine's disk.
_NAME = re.compile(r'[A-Za-z0-9_]*')


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

    code: class * 256 + sub-command, a `Command` if it is known.
    length: bytes of payload that follow; in a request without payload, room for the reply.
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
        """First byte of a download in the transfer buffer."""
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
        """Read 28 bytes; ProtocolError when they are no header."""
        if len(data) != HEADER_LENGTH:
            raise ProtocolError(f'a header has {HEADER_LENGTH} bytes, got {len(data)}')
        magic, length, flags, group, sub, parameters = _HEADER.unpack(data)
        if magic != MAGIC:
            raise ProtocolError(f'no header of a message begins with {data[:16].hex(" ")}')
        return cls(group << 8 | sub, length, flags, parameters)


@dataclass(frozen=True)
class Request:
    """A request of a client.

    payload: data to send, or None. room: largest payload of the reply [bytes]; a reply to a
    request with payload mirrors the payload, or is empty.
    """

    command: Command
    payload: bytes | None = None
    room: int = 0
    parameters: bytes = field(default=b'')

    @property
    def header(self) -> Header:
        """Header of the request."""
        parameters = self.parameters.ljust(13, b'\0')
        if self.payload is None:
            return Header(self.command, self.room, _NO_PAYLOAD, parameters)
        return Header(self.command, len(self.payload), 0, parameters)

    def encode(self) -> bytes:
        """The bytes to send."""
        return self.header.encode() + (self.payload or b'')

    def check(self, reply: Header) -> int:
        """Bytes of payload that follow `reply`; ProtocolError when it answers another request.

        The length is checked against the requested one before memory is allocated.
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


@dataclass(frozen=True)
class HardwareInfo:
    """Identity of the camera."""

    manufacturer: str
    serial: str
    build: str
    software: str

    def encode(self) -> bytes:
        """The 644 bytes."""
        texts = (self.manufacturer, self.serial, self.build, self.software)
        return _HARDWARE.pack(*(each.encode() for each in texts), 0)

    @classmethod
    def decode(cls, data: bytes) -> 'HardwareInfo':
        """Decode the data of C2 00 00; ProtocolError when it is too short or no text."""
        if len(data) != HARDWARE_INFO_LENGTH:
            raise ProtocolError(f'hardware info has {HARDWARE_INFO_LENGTH} bytes, got {len(data)}')
        *texts, _ = _HARDWARE.unpack(data)
        return cls(*(_text(each, 'hardware info') for each in texts))


@dataclass(frozen=True)
class PictureRecord:
    """A record of the picture list.

    id: "sha1-" and 40 hexadecimal digits. date: of the camera's clock, ISO 8601, UTC.
    focus: the lambda selected on the camera. orientation: counter-clockwise, as EXIF codes it:
    1 (or 0) none, 8 90, 3 180, 6 270 degrees.
    """

    folder: int
    number: int
    id: str
    date: str
    liked: bool = False
    focus: float = 0.0
    orientation: int = 1
    folder_postfix: str = 'PHOTO'
    prefix: str = 'IMG_'

    @property
    def folder_name(self) -> str:
        """As in 100PHOTO."""
        return f'{self.folder:03d}{self.folder_postfix}'

    @property
    def name(self) -> str:
        """As in IMG_0001; another folder of the card may hold another one of this name."""
        return f'{self.prefix}{self.number:04d}'

    def path(self, extension: str) -> str:
        r"""Path of its file on the camera, as in I:\DCIM\100PHOTO\IMG_0001.RAW."""
        return rf'I:\DCIM\{self.folder_name}\{self.name}.{extension}'

    @property
    def taken(self) -> datetime | None:
        """`date` as a time, by the camera's clock; None when it is not ISO 8601."""
        try:  # Python 3.10 does not know the Z
            moment = datetime.fromisoformat(self.date.replace('Z', '+00:00'))
        except ValueError:
            return None
        return moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)

    @property
    def key(self) -> bytes:
        """The first 24 bytes of the record, by which C0 00 05 deletes a picture."""
        return self.encode()[:_KEY_LENGTH]

    def encode(self) -> bytes:
        """The 128 bytes."""
        return _RECORD.pack(self.folder_postfix.encode(), self.prefix.encode(), self.folder,
                            self.number, self.liked, self.focus, self.id.encode(),
                            self.date.encode(), self.orientation)

    @classmethod
    def decode(cls, data: bytes) -> 'PictureRecord':
        """Decode the first 128 bytes of a record; ProtocolError for impossible values."""
        postfix, prefix, folder, number, liked, focus, identity, date, orientation = \
            _RECORD.unpack(data[:RECORD_LENGTH])
        texts = [_text(each, 'picture list') for each in (postfix, prefix, identity, date)]
        if not (_NAME.fullmatch(texts[0]) and _NAME.fullmatch(texts[1])
                and folder >= 0 and number >= 0 and texts[2]):
            raise ProtocolError(f'picture list holds an impossible record: folder {folder} '
                                f'{texts[0]!r}, file {texts[1]!r} {number}, id {texts[2]!r}')
        return cls(folder, number, texts[2], texts[3], liked == 1, focus, orientation,
                   texts[0], texts[1])


def encode_picture_list(pictures: list[PictureRecord]) -> bytes:
    """The data of C2 00 02: records, the newest picture first."""
    fields = b''.join(struct.pack('<II', *each) for each in enumerate(_FIELD_OFFSETS))
    header = struct.pack('<III', 1, RECORD_LENGTH, len(_FIELD_OFFSETS)) + fields
    return header + b''.join(each.encode() for each in pictures)


def decode_picture_list(data: bytes) -> list[PictureRecord]:
    """Decode the data of C2 00 02; ProtocolError for impossible values.

    The header contains its own length and the records'. Fewer bytes than a record at the end are
    ignored.
    """
    if len(data) < 12:
        raise ProtocolError(f'picture list has {len(data)} bytes, its header alone has 12')
    _, length, fields = struct.unpack_from('<III', data)
    start = 12 + 8 * fields
    if not RECORD_LENGTH <= length <= _LONGEST_RECORD or start > len(data):
        raise ProtocolError(f'picture list of {len(data)} bytes has an impossible header: '
                            f'{fields} fields, records of {length} bytes')
    places = range(start, len(data) - length + 1, length)
    if len(places) > _MOST_PICTURES:
        raise ProtocolError(f'picture list of {len(places)} pictures, more than any card holds')
    return [PictureRecord.decode(data[each:each + length]) for each in places]


def encode_time(moment: datetime) -> bytes:
    """14 bytes; `moment` has a time zone."""
    utc = moment.astimezone(timezone.utc)
    return _TIME.pack(utc.year, utc.month, utc.day, utc.hour, utc.minute, utc.second,
                      utc.microsecond // 1000)


def decode_time(data: bytes) -> datetime:
    """Decode 14 bytes: a time in UTC; ProtocolError for an impossible time."""
    if len(data) != _TIME.size:
        raise ProtocolError(f'a time has {_TIME.size} bytes, got {len(data)}')
    year, month, day, hour, minute, second, milliseconds = _TIME.unpack(data)
    try:
        return datetime(year, month, day, hour, minute, second, 1000 * milliseconds, timezone.utc)
    except ValueError as error:
        raise ProtocolError(f'no time: {_TIME.unpack(data)} ({error})') from None


def decode_battery(data: bytes) -> float:
    """Decode 4 bytes: percent; ProtocolError for anything but a number from 0 to 100."""
    if len(data) != 4:
        raise ProtocolError(f'a battery level has 4 bytes, got {len(data)}')
    percent = float(struct.unpack('<f', data)[0])
    if not (math.isfinite(percent) and -1 <= percent <= 101):
        raise ProtocolError(f'no battery level: {percent} percent')
    return min(max(percent, 0.0), 100.0)


def decode_length(data: bytes) -> int:
    """Decode 4 bytes: number of bytes in the transfer buffer."""
    if len(data) != 4:
        raise ProtocolError(f'a length has 4 bytes, got {len(data)}')
    return int.from_bytes(data, 'little')


def encode_files(files: dict[str, bytes]) -> bytes:
    """The data of C2 00 06: a table of lengths and paths, then the files."""
    table = [_FILE_ENTRY.pack(len(body), path.encode()) for path, body in files.items()]
    return b''.join([*table, *files.values()])


def decode_files(data: bytes) -> dict[str, bytes]:
    """Decode the data of C2 00 06; the table ends where it and its files fill all bytes."""
    entries: list[tuple[int, str]] = []
    total = 0
    while (begin := _FILE_ENTRY.size * len(entries)) + total < len(data):
        if begin + _FILE_ENTRY.size > len(data) or len(entries) == _MOST_FILES:
            break
        length, path = _FILE_ENTRY.unpack_from(data, begin)
        entries.append((length, _text(path, 'calibration')))
        total += length
    if begin + total != len(data):
        raise ProtocolError(f'calibration of {len(data)} bytes has a table of {len(entries)} '
                            f'files of {total} bytes')
    files: dict[str, bytes] = {}
    for length, path in entries:
        files[path] = data[begin:begin + length]
        begin += length
    return files


def _text(data: bytes, where: str) -> str:
    """The text before the first NUL."""
    try:
        text = data.split(b'\0', 1)[0].decode()
    except UnicodeDecodeError:
        text = '\0'
    if not text.isprintable():
        raise ProtocolError(f'{where} holds {data[:48]!r} where a text should be')
    return text
