"""Reads MCAP files, whoever wrote them: bounded in memory, and checked where there are checksums.

The heads of all records are looked at first; what is in a chunk, only when its time has come.
"""

import struct
from collections.abc import Container, Iterator
from heapq import heappop, heappush
from pathlib import Path
from typing import BinaryIO, NamedTuple
from zlib import crc32

from pmcl_ros.messages.mcap_records import (
    HEAD,
    MAGIC,
    MESSAGE,
    MOST_CHUNK,
    Channel,
    Fields,
    Op,
)
from pmcl_ros.messages.unpacking import unpacked
from pmcl_ros.runtime.errors import BagError

_MOST_OPEN = 3 * 2 ** 27  # bytes of chunks whose times overlap
_MOST_RECORDS = 2_000_000  # beside those in chunks
_MOST_IN_CHUNK = 1_000_000  # messages
_MOST_FIELDS = 2 ** 22  # bytes of a record that is no message and no chunk
_BLOCK = 2 ** 20  # bytes that are read at once


class _Chunk(NamedTuple):
    """Where records lie; a message that is in no chunk counts as one. crc: 0 for none."""

    start: int
    end: int
    place: int
    length: int
    size: int  # when it is unpacked
    crc: int
    compression: str


class McapReader:
    """A file that is open. Raises BagError where it is damaged, OSError."""

    def __init__(self, path: Path) -> None:
        self._file: BinaryIO = path.open('rb')
        self.channels: dict[int, Channel] = {}
        self.counts: dict[int, int] = {}  # of messages, by channel
        self._schemas: dict[int, str] = {}
        self._chunks: list[_Chunk] = []
        self._chunk_count: int | None = None
        self._counted = False  # the summary says how many messages each channel has
        self.checked = True  # all has checksums
        try:
            self._look()
            if not (self._counted and self.channels):
                self._count()
            self._chunks.sort()
            _check_overlap(self._chunks)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def messages(self, channels: Container[int]) -> Iterator[tuple[int, int, memoryview]]:
        """(time, channel, data) of all messages of some channels, in the order of their times."""
        waiting: list[tuple[int, int, int, memoryview]] = []
        number = 0  # keeps the order of messages of one time
        for chunk in self._chunks:
            while waiting and waiting[0][0] < chunk.start:
                time, _, channel, data = heappop(waiting)
                yield time, channel, data
            for time, channel, data in self._messages(chunk):
                if channel in channels:
                    heappush(waiting, (time, number, channel, data))
                    number += 1
        while waiting:
            time, _, channel, data = heappop(waiting)
            yield time, channel, data

    def _look(self) -> None:
        """Look at the heads of all records, from the first to the footer."""
        size = self._file.seek(0, 2)
        self._file.seek(0)
        if self._file.read(len(MAGIC)) != MAGIC:
            raise BagError('it does not begin as an MCAP file')
        found = 0
        for _ in range(_MOST_RECORDS):
            place = self._file.tell()
            head = self._file.read(HEAD.size)
            op, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, size)
            end = place + HEAD.size + length
            if end > size:
                raise BagError(f'it was cut short, or is damaged: the record at byte {place} '
                               f'would end at byte {end}, the file does at {size}; `mcap recover` '
                               'saves what can be saved')
            if op == Op.FOOTER:
                self._end(place, self._fields(length), found)
                return
            if op in (Op.SCHEMA, Op.CHANNEL):
                self._define(op, self._fields(length))
            elif op == Op.STATISTICS:
                self._statistics(self._fields(length))
            elif op == Op.CHUNK:
                self._chunks.append(self._chunk(length))
                found += 1
            elif op == Op.MESSAGE:
                time = Fields(self._file.read(min(length, MESSAGE.size))).numbers('HIQQ')[2]
                whole = HEAD.size + length
                self._chunks.append(_Chunk(time, time, place, whole, whole, 0, ''))
            self._file.seek(end)
        raise BagError(f'it has more than {_MOST_RECORDS} records that are in no chunk; write it '
                       'with chunks (mcap convert)')

    def _fields(self, length: int) -> Fields:
        if length > _MOST_FIELDS:
            raise BagError(f'a record has {length} bytes, at most {_MOST_FIELDS} are expected')
        return Fields(self._file.read(length))

    def _chunk(self, length: int) -> _Chunk:
        place = self._file.tell()
        head = Fields(self._file.read(min(length, 256)))
        start, end, size, crc = head.numbers('QQQI')
        compression = head.text()
        packed, = head.numbers('Q')
        begin = 40 + len(compression.encode())
        if begin + packed > length or start > end:
            raise BagError(f'the chunk at byte {place} is damaged: it says {packed} of {length} '
                           f'bytes, and times from {start} to {end}')
        if size > MOST_CHUNK:
            raise BagError(f'the chunk at byte {place} says that it unpacks to {size} bytes; at '
                           f'most {MOST_CHUNK} are read: write it with smaller ones (mcap '
                           'convert)')
        return _Chunk(start, end, place + begin, packed, size, crc, compression)

    def _define(self, op: int, fields: Fields) -> None:
        """Note a schema or a channel, which may come again but not as another one."""
        if op == Op.SCHEMA:
            number, = fields.numbers('H')
            self._schemas.setdefault(number, fields.text())
            return
        number, schema = fields.numbers('HH')
        topic, encoding, more = fields.text(), fields.text(), fields.texts()
        channel = Channel(topic, self._schemas.get(schema, ''), encoding,
                          more.get('offered_qos_profiles', ''))
        if self.channels.setdefault(number, channel) != channel:
            raise BagError(f'channel {number} is of {self.channels[number].topic}, then of '
                           f'{topic}: the file is damaged')

    def _statistics(self, fields: Fields) -> None:
        messages, *_, self._chunk_count, _, _ = fields.numbers('QHIIIIQQ')
        counts = Fields(fields.sized())
        self._counted = bool(counts) or not messages  # an empty map: nobody has counted
        while counts:
            number, count = counts.numbers('HQ')
            self.counts[number] = count

    def _end(self, place: int, footer: Fields, found: int) -> None:
        """Check what the footer says. found: the number of chunks."""
        summary, _, crc = footer.numbers('QQI')
        if self._file.read() != MAGIC:
            raise BagError(f'it does not end as an MCAP file, after its footer at byte {place}')
        if crc and _crc(self._file, summary, place + HEAD.size + 16) != crc:
            raise BagError('the checksum of its summary is wrong: the file is damaged')
        if self._chunk_count not in (None, found):
            raise BagError(f'it has {found} chunks, its summary says {self._chunk_count}: the '
                           'file is damaged')
        self.checked = bool(crc) and all(each.crc for each in self._chunks)

    def _count(self) -> None:
        """Count the messages of a file without a summary."""
        counts: dict[int, int] = {}
        for chunk in self._chunks:
            for _, channel, _ in self._messages(chunk):
                counts[channel] = counts.get(channel, 0) + 1
        self.counts = counts

    def _messages(self, chunk: _Chunk) -> Iterator[tuple[int, int, memoryview]]:
        """(time, channel, data) of the messages of a chunk."""
        self._file.seek(chunk.place)
        packed = self._file.read(chunk.length)
        records = memoryview(unpacked(packed, chunk.compression, chunk.size))
        if len(records) != chunk.size or len(packed) != chunk.length:
            raise BagError(f'the chunk at byte {chunk.place} unpacks to {len(records)} bytes, it '
                           f'says {chunk.size}: the file is damaged')
        if chunk.crc and crc32(records) != chunk.crc:
            raise BagError(f'the checksum of the chunk at byte {chunk.place} is wrong: the file '
                           'is damaged; record it again, or take another copy')
        place = count = 0
        while place < len(records):
            count += 1
            op, length = _head(records, place)
            content = records[place + HEAD.size:place + HEAD.size + length]
            place += HEAD.size + length
            if count > _MOST_IN_CHUNK:
                raise BagError(f'the chunk at byte {chunk.place} has more than {_MOST_IN_CHUNK} '
                               'records')
            if op in (Op.SCHEMA, Op.CHANNEL):
                self._define(op, Fields(content))
            elif op == Op.MESSAGE:
                channel, _, time, _ = Fields(content).numbers('HIQQ')
                if not chunk.start <= time <= chunk.end or channel not in self.channels:
                    raise BagError(f'the chunk at byte {chunk.place} has a message of channel '
                                   f'{channel} at {time}, it says from {chunk.start} to '
                                   f'{chunk.end}: the file is damaged')
                yield time, channel, content[MESSAGE.size:]


def _head(records: memoryview, place: int) -> tuple[int, int]:
    try:
        op, length = HEAD.unpack_from(records, place)
    except struct.error:
        op, length = 0, 0
    if not op or place + HEAD.size + length > len(records):
        raise BagError(f'a record in a chunk has the code {op} and {length} bytes, '
                       f'{len(records) - place} are left: the file is damaged')
    return op, length


def _crc(file: BinaryIO, start: int, end: int) -> int:
    file.seek(start)
    crc, left = 0, end - start
    while left > 0 and (block := file.read(min(left, _BLOCK))):
        crc, left = crc32(block, crc), left - len(block)
    return crc


def _check_overlap(chunks: list[_Chunk]) -> None:
    """BagError where too much must be in memory to put messages into the order of their times."""
    ends: list[tuple[int, int]] = []
    together = 0
    for each in chunks:
        while ends and ends[0][0] < each.start:
            together -= heappop(ends)[1]
        heappush(ends, (each.end, each.size))
        together += each.size
        if together > _MOST_OPEN:
            raise BagError(f'its chunks of one time unpack to more than {_MOST_OPEN // 2 ** 20} '
                           'MiB: bring its messages into the order of their times (mcap sort)')
