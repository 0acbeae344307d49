"""Writes MCAP files: indexed chunks with checksums."""

import struct
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

import zstandard

from pmcl_ros.messages.mcap_records import (
    HEAD,
    MAGIC,
    MESSAGE,
    MOST_CHUNK,
    Channel,
    Op,
    record,
    sized,
    text,
)
from pmcl_ros.runtime.errors import BagError

_ROOM = 2 ** 20  # bytes of a chunk beside its largest message


class McapWriter:
    """A new file, profile `ros2`. compress: its chunks, by zstd, of more than `chunk` bytes each.

    counts: messages of each channel that are in the file or wait for their chunk to end. A chunk
    that does not fit on the disk is taken away again, and its messages count no more. summary:
    bytes of the index of chunks that `finish` writes. Raises OSError.
    """

    def __init__(self, path: Path, compress: bool = True, chunk: int = 2 ** 20) -> None:
        self._file: BinaryIO = path.open('xb', buffering=0)
        self._compress, self._enough = compress, chunk
        self._place = self._crc = 0
        self._records = bytearray()  # of the chunk that is being filled
        self._index: dict[int, list[tuple[int, int]]] = {}  # of it: channel -> times and places
        self._schemas: dict[str, bytes] = {}
        self._channels: list[bytes] = []
        self._chunks: list[bytes] = []
        self.counts: list[int] = []
        self.summary = 0
        self.times: list[int] = []  # of the first message and the last
        self._put(MAGIC + record(Op.HEADER, text('ros2'), text('pmcl_ros')))

    def add(self, channel: Channel, definition: str) -> int:
        """The number of a new channel. definition: of its type, as of .msg."""
        number = len(self._channels) + 1
        if channel.type not in self._schemas:
            self._schemas[channel.type] = record(
                Op.SCHEMA, struct.pack('<H', len(self._schemas) + 1), text(channel.type),
                text('ros2msg'), text(definition))
            self._records += self._schemas[channel.type]
        schema = list(self._schemas).index(channel.type) + 1
        self._channels.append(record(
            Op.CHANNEL, struct.pack('<HH', number, schema), text(channel.topic),
            text(channel.encoding), sized(text('offered_qos_profiles') + text(channel.qos))))
        self._records += self._channels[-1]
        self.counts.append(0)
        return number

    def write(self, number: int, time_ns: int, data: bytes) -> None:
        """Append a message of a channel. BagError when it is too large to be read again."""
        if len(data) > MOST_CHUNK - _ROOM:
            raise BagError(f'a message of {len(data)} bytes is larger than the '
                           f'{(MOST_CHUNK - _ROOM) // 2 ** 20} MiB that a bag takes')
        if len(self._records) + len(data) > MOST_CHUNK - 2 ** 10:
            self.flush()
        self._index.setdefault(number, []).append((time_ns, len(self._records)))
        self._records += HEAD.pack(Op.MESSAGE, MESSAGE.size + len(data))
        self._records += MESSAGE.pack(number, 0, time_ns, time_ns)
        self._records += data
        self.counts[number - 1] += 1
        if len(self._records) > self._enough:
            self.flush()

    def finish(self, metadata: str) -> None:
        """After `flush`: write the summary. metadata: of the bag, YAML."""
        start = self._place
        self._put(record(Op.METADATA, text('rosbag2'),
                         sized(text('serialized_metadata') + text(metadata))))
        index = record(Op.METADATA_INDEX, struct.pack('<QQ', start, self._place - start),
                       text('rosbag2'))
        self._put(record(Op.DATA_END, struct.pack('<I', self._crc)))
        counts = b''.join(struct.pack('<HQ', number, count)
                          for number, count in enumerate(self.counts, 1))
        statistics = record(Op.STATISTICS, struct.pack(
            '<QHIIIIQQ', sum(self.counts), len(self._schemas), len(self._channels), 0, 1,
            len(self._chunks), *(self.times or (0, 0))), sized(counts))
        self._put_summary((*self._schemas.values(),), self._channels, self._chunks, [index],
                          [statistics])

    def close(self) -> None:
        """Close the file as it is."""
        self._file.close()

    def _put_summary(self, *groups: 'tuple[bytes, ...] | list[bytes]') -> None:
        """The groups of records, where each is, and the footer."""
        start, self._crc = self._place, 0
        offsets = b''
        for group in groups:
            if group:
                place = self._place
                self._put(b''.join(group))
                offsets += record(Op.SUMMARY_OFFSET, struct.pack(
                    '<BQQ', group[0][0], place, self._place - place))
        place = self._place
        self._put(offsets)
        self._put(HEAD.pack(Op.FOOTER, 20) + struct.pack('<QQ', start, place))
        self._put(struct.pack('<I', self._crc) + MAGIC)

    def flush(self) -> None:
        """End the chunk that is being filled."""
        start, crc, chunks = self._place, self._crc, len(self._chunks)
        try:
            if self._records:
                self._put_chunk()
        except BaseException:
            for number, places in self._index.items():
                self.counts[number - 1] -= len(places)
            del self._chunks[chunks:]
            self._place, self._crc = start, crc
            self._file.seek(start)
            self._file.truncate()
            raise
        finally:
            self._records.clear()
            self._index.clear()

    def _put_chunk(self) -> None:
        records = bytes(self._records)
        packed = zstandard.ZstdCompressor().compress(records) if self._compress else records
        times = [time for places in self._index.values() for time, _ in places] or [0]
        span = struct.pack('<QQ', min(times), max(times))
        compression = text('zstd' if self._compress else '')
        start = self._place
        self._put(record(Op.CHUNK, span, struct.pack('<QI', len(records), crc32(records)),
                         compression, struct.pack('<Q', len(packed)), packed))
        end, places = self._place, b''
        for number, each in self._index.items():
            places += struct.pack('<HQ', number, self._place)
            entries = b''.join(struct.pack('<QQ', *one) for one in each)
            self._put(record(Op.MESSAGE_INDEX, struct.pack('<H', number), sized(entries)))
        if self._index:
            self.times = [min([*times, *self.times]), max([*times, *self.times])]
        self._chunks.append(record(
            Op.CHUNK_INDEX, span, struct.pack('<QQ', start, end - start), sized(places),
            struct.pack('<Q', self._place - end), compression,
            struct.pack('<QQ', len(packed), len(records))))
        self.summary += len(self._chunks[-1])

    def _put(self, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest):]
        self._place += len(data)
        self._crc = crc32(data, self._crc)
