"""Bags: MCAP files of recorded messages, written and read without ROS."""

import logging
import os
import shutil
import sqlite3
from collections.abc import Container, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from rosbags.interfaces import Qos, QosDurability

from pmcl_ros.messages import bag_metadata
from pmcl_ros.messages.bag_metadata import BagFiles, Written, offered, qos_from, qos_text
from pmcl_ros.messages.cdr import message_from, typestore
from pmcl_ros.messages.mcap_reader import McapReader
from pmcl_ros.messages.mcap_records import MOST_CHUNK, Channel
from pmcl_ros.messages.mcap_writer import McapWriter
from pmcl_ros.messages.sqlite_reader import SqliteReader
from pmcl_ros.messages.unpacking import unpack_file, unpacked
from pmcl_ros.runtime.errors import BagError, MessageError

_LOG = logging.getLogger(__name__)
_SUMMARY = 2 ** 20  # bytes kept free for what makes a bag of the messages, should the disk be full
VOLATILE, LATCHED = offered(QosDurability.VOLATILE), offered(QosDurability.TRANSIENT_LOCAL)


class Recorded(NamedTuple):
    """One message as it lies in a bag: `cdr` is what goes over the wire, time_ns when it came."""

    topic: str
    type: str
    time_ns: int
    cdr: bytes
    qos: Qos = VOLATILE


class BagWriter:
    """A new bag, a folder that `ros2 bag play` and `read` take; chunks compressed with zstd.

    A context manager; whatever ends it, a full disk too, what was written until then can be read.
    A bag without a message is taken away again. Raises BagError when it is already there or cannot
    be written.
    """

    def __init__(self, bag: Path | str, compress: bool = True) -> None:
        self._bag, self._compress = Path(bag), compress
        if self._bag.exists():
            raise BagError(f'{bag} is already there; remove it or choose another name')
        self._file = f'{self._bag.absolute().name}.mcap'
        self._reserve = self._bag / '.room_for_the_summary'
        self._channels: dict[str, tuple[int, Channel, Qos]] = {}

    def __enter__(self) -> 'BagWriter':
        with self._explained():
            self._bag.mkdir(parents=True)
            try:
                self._writer = McapWriter(self._bag / self._file, self._compress)
                with self._reserve.open('xb') as file:
                    os.posix_fallocate(file.fileno(), 0, _SUMMARY)
            except OSError:
                shutil.rmtree(self._bag)
                raise
        return self

    def __exit__(self, *_: object) -> None:
        with self._explained():
            try:
                self._writer.flush()
            finally:  # where there is no room for it, what was written before is made a bag
                self._close()

    def _close(self) -> None:
        self._reserve.unlink()
        start, end = self._writer.times or (0, 0)
        metadata = bag_metadata.metadata_of(Written(
            self._file, [(channel, qos, self._writer.counts[number - 1])
                         for number, channel, qos in self._channels.values()],
            start, end - start))
        self._writer.close(bag_metadata.as_yaml(metadata))
        if sum(self._writer.counts):
            bag_metadata.write(self._bag / bag_metadata.NAME, metadata)
        else:
            shutil.rmtree(self._bag)

    def write(self, message: Recorded) -> None:
        """Append a message."""
        topic = message.topic
        with self._explained():
            if topic not in self._channels:
                if message.type not in typestore().types:
                    raise BagError(f'the message type {message.type!r} is none of ROS 2 Jazzy')
                channel = Channel(topic, message.type, 'cdr', qos_text(message.qos))
                definition, _ = typestore().generate_msgdef(message.type, ros_version=2)
                self._channels[topic] = (self._writer.add(channel, definition), channel,
                                         message.qos)
            self._writer.write(self._channels[topic][0], message.time_ns, message.cdr)

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except (BagError, OSError) as error:
            kept = sum(self._writer.counts) if self._channels and isinstance(error, OSError) else 0
            raise BagError(f'cannot write {self._bag}: {error}' + (
                f'; the {kept} messages that came before can be read' if kept else '')) from None


def record(bag: Path | str, messages: Iterable[Recorded], compress: bool = True) -> None:
    """Write a new bag of `messages`; as `BagWriter`."""
    with BagWriter(bag, compress) as writer:
        for each in messages:
            writer.write(each)


def is_bag(path: Path | str) -> bool:
    """Whether `path` is the folder of a bag."""
    path = Path(path)
    return path.is_dir() and (path / bag_metadata.NAME).is_file() and any(
        each for ending in ('mcap', 'db3') for each in path.glob(f'*.{ending}*'))


class Topic(NamedTuple):
    """A topic of a bag."""

    name: str
    type: str
    qos: Qos
    messages: int


def topics(bag: Path | str) -> list[Topic]:
    """The topics of a bag. Raises BagError where it is damaged."""
    found: dict[tuple[str, str], Topic] = {}
    with _explained(bag):
        for file in _opened(Path(bag)):
            for number, channel in file.channels.items():
                name, kind = channel.topic, channel.type
                before = found.get((name, kind), Topic(name, kind, VOLATILE, 0)).messages
                found[name, kind] = Topic(name, kind, _qos(channel),
                                          before + file.counts.get(number, 0))
    return list(found.values())


def read(bag: Path | str, only: Container[str] | None = None) -> Iterator[Recorded]:
    """The messages of a bag in the order of their times, a chunk of it in memory at a time.

    only: the names of the topics that are wanted. What has a checksum is checked, and BagError
    raised where it is wrong; of a bag without checksums a warning says so.
    """
    with _explained(bag):
        for file in _opened(Path(bag)):
            wanted = {number: (each, _qos(each)) for number, each in file.channels.items()
                      if only is None or each.topic in only}
            if wanted and not file.checked:
                _warn_unchecked(str(bag))
            for time_ns, number, cdr in file.messages(wanted):
                channel, qos = wanted[number]
                yield Recorded(channel.topic, channel.type, time_ns, bytes(cdr), qos)


def message_of(recorded: Recorded, kind: str) -> Any:
    """The message; MessageError where it is not of the type `kind`, or damaged."""
    if recorded.type != kind:
        raise MessageError(f'{recorded.topic} is {recorded.type}, expected {kind}')
    return message_from(recorded.cdr, kind)


class _MessagesUnpacked:
    """A file whose messages rosbag2 has compressed one by one."""

    def __init__(self, file: McapReader | SqliteReader) -> None:
        self.channels, self.counts, self.checked = file.channels, file.counts, file.checked
        self._file = file

    def messages(self, channels: Container[int]) -> Iterator[tuple[int, int, bytes | memoryview]]:
        for time_ns, number, data in self._file.messages(channels):
            yield time_ns, number, unpacked(data, 'zstd', MOST_CHUNK)


def _opened(bag: Path) -> Iterator[McapReader | SqliteReader | _MessagesUnpacked]:
    """The files of a bag one after the other, open. bag: its folder, or a file of it alone."""
    if bag.is_dir() and not (bag / 'metadata.yaml').exists():
        raise BagError('there is no metadata.yaml in it; ros2 bag and pmcl bag record make bags')
    of = BagFiles.read(bag) if bag.is_dir() else None
    for path in [bag] if of is None else of.paths(bag):
        with ExitStack() as stack:
            file = _file(path, stack)
            foreign = {each.encoding for each in file.channels.values()} - {'cdr'}
            if foreign:
                raise BagError(f'its messages are {", ".join(foreign)}, only cdr is read')
            each_packed = of is not None and of.compressed == 'message'
            yield _MessagesUnpacked(file) if each_packed else file


def _file(path: Path, stack: ExitStack) -> McapReader | SqliteReader:
    if path.suffix == '.zstd':
        whole = Path(stack.enter_context(TemporaryDirectory())) / path.stem
        unpack_file(path, whole)
        return _file(whole, stack)
    if path.suffix not in ('.mcap', '.db3'):
        raise BagError(f'{path.name} is no .mcap and no .db3')
    file = McapReader(path) if path.suffix == '.mcap' else SqliteReader(path)
    stack.callback(file.close)
    return file


@contextmanager
def _explained(bag: Path | str) -> Iterator[None]:
    try:
        yield
    # ValueError and others: SQLite gives values of any kind for any column.
    except (BagError, OSError, sqlite3.Error, ValueError, TypeError, OverflowError) as error:
        raise BagError(f'cannot read the bag {bag}: {error}') from None


@cache
def _warn_unchecked(bag: str) -> None:
    """Once for each bag."""
    _LOG.warning('%s has no checksums: damage to its messages would not be noticed; a bag that '
                 'is recorded anew has them', bag)


def _qos(channel: Channel) -> Qos:
    return qos_from(channel.qos, channel.topic) or VOLATILE
