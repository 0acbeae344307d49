"""The records of MCAP files (mcap.dev/spec): an operation code, a length, and fields."""

import struct
from enum import IntEnum
from typing import Any, NamedTuple

from pmcl_ros.runtime.errors import BagError

MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')  # operation code, length of what follows
MESSAGE = struct.Struct('<HIQQ')  # channel, sequence number, times of log and publication
MOST_CHUNK = 2 ** 28  # bytes of an unpacked chunk: of one message, the largest that there may be


class Op(IntEnum):
    """Operation codes of those records that are written or read here."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    SUMMARY_OFFSET = 0x0E
    DATA_END = 0x0F


class Channel(NamedTuple):
    """A topic in a file. qos: the offered quality of service, YAML."""

    topic: str
    type: str
    encoding: str
    qos: str


def record(op: Op, *parts: bytes) -> bytes:
    """A record of the parts of its fields."""
    content = b''.join(parts)
    return HEAD.pack(op, len(content)) + content


def text(value: str) -> bytes:
    """A text, or an array, with its length before it."""
    return sized(value.encode())


def sized(data: bytes) -> bytes:
    """Bytes with their length before them."""
    return struct.pack('<I', len(data)) + data


class Fields:
    """Reads the fields of a record one after the other; BagError where it ends before them."""

    def __init__(self, data: bytes | memoryview) -> None:
        self._data, self._place = memoryview(data), 0

    def numbers(self, layout: str) -> tuple[Any, ...]:
        """Little-endian numbers, as `struct` describes them."""
        size = struct.calcsize(f'<{layout}')
        return struct.unpack(f'<{layout}', self._take(size))

    def sized(self) -> memoryview:
        """Bytes with their length before them."""
        return self._take(self.numbers('I')[0])

    def text(self) -> str:
        """UTF-8 with its length before it."""
        try:
            return str(self.sized(), 'utf-8')
        except UnicodeDecodeError:
            raise BagError('a record has text that is not UTF-8: the file is damaged') from None

    def texts(self) -> dict[str, str]:
        """A map of texts."""
        inner, found = Fields(self.sized()), {}
        while inner:
            name = inner.text()
            found[name] = inner.text()
        return found

    def __bool__(self) -> bool:
        return self._place < len(self._data)

    def _take(self, size: int) -> memoryview:
        part = self._data[self._place:self._place + size]
        if len(part) < size:
            raise BagError(f'a record ends {size - len(part)} bytes too early: the file is '
                           'damaged')
        self._place += size
        return part
