"""Bags: MCAP files of recorded messages, written and read without ROS."""

import errno
import logging
import os
import re
import shutil
import sqlite3
from collections.abc import Container, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
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
from pmcl_ros.runtime.errors import BagError, MessageError, OutputError

_LOG = logging.getLogger(__name__)
_ROOM = '.room_for_the_summary'  # while a bag is written
# Bytes kept free for what makes a bag of the messages, should the disk be full: beside the index
# of the chunks; in steps of so many.
_END, _STEP = 2 ** 18, 2 ** 20
VOLATILE, LATCHED = offered(QosDurability.VOLATILE), offered(QosDurability.TRANSIENT_LOCAL)


class Recorded(NamedTuple):
    """One message as it lies in a bag: `cdr` is what goes over the wire, time_ns when it came."""

    topic: str
    type: str
    time_ns: int
    cdr: bytes
    qos: Qos = VOLATILE


class BagWriter:
    """A new bag, a folder that `ros2 bag play` and `read` take; compressed with zstd.

    A context manager; whatever ends it, what was written until then can be read; on a full disk
    all but the last chunk, at most `chunk` bytes and a message. A bag without a message is taken
    away again. Raises BagError when it is already there or cannot be written.
    """

    def __init__(self, bag: Path | str, compress: bool = True, chunk: int = 2 ** 20) -> None:
        self._bag, self._compress, self._chunk = Path(bag), compress, chunk
        if self._bag.exists():
            raise BagError(f'{bag} is already there; remove it or choose another name')
        self._file = f'{self._bag.name}.mcap'
        self._reserve = _Reserve(self._bag / _ROOM)
        self._channels: dict[str, tuple[int, Channel, Qos]] = {}
        self._error: BaseException | None = None  # of its own

    def __enter__(self) -> 'BagWriter':
        with self._explained():
            self._bag.mkdir(parents=True)
            try:
                self._writer = McapWriter(self._bag / self._file, self._compress, self._chunk)
                self._reserve.grow(_END)
            except OSError:
                shutil.rmtree(self._bag)
                raise
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        with self._explained():
            try:
                self._writer.flush()
            except OSError as full:
                error = self._error = BagError(f'cannot write {self._bag}: {full}')
            finally:  # what was written before is made a bag
                self._close()
        kept = sum(self._writer.counts)
        if error is not None and error is self._error:
            raise BagError(f'{error}; ' + (f'the {kept} messages that came before can be read'
                                           if kept else 'nothing is kept')) from None

    def _close(self) -> None:
        self._reserve.free()
        start, end = self._writer.times or (0, 0)
        metadata = bag_metadata.metadata_of(Written(
            self._file, [(channel, qos, self._writer.counts[number - 1])
                         for number, channel, qos in self._channels.values()],
            start, end - start))
        try:
            self._writer.finish(bag_metadata.as_yaml(metadata))
        finally:
            self._writer.close()
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
            self._reserve.grow(_END + self._writer.summary)

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except (BagError, OutputError, OSError) as error:
            self._error = BagError(f'cannot write {self._bag}: {error}')
            raise self._error from None


class _Reserve:
    """A file that keeps room on the disk."""

    def __init__(self, path: Path) -> None:
        self._path, self._size = path, 0

    def grow(self, size: int) -> None:
        """At least to a size [bytes], in steps. Raises OSError on a full disk."""
        if size <= self._size:
            return
        self._size = -(-size // _STEP) * _STEP
        with self._path.open('ab') as file:
            try:
                os.posix_fallocate(file.fileno(), 0, self._size)
            except OSError as error:
                if error.errno in (errno.ENOSPC, errno.EDQUOT):
                    raise
                _LOG.info('no room is kept for the end of %s: %s', self._path.parent, error)

    def free(self) -> None:
        """Give the room back."""
        with suppress(OSError):
            self._path.unlink(missing_ok=True)


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


def remove_bag(path: Path) -> None:
    """Remove a bag, complete or not; a folder that holds anything else stays."""
    own = re.compile(r'.*\.(mcap|db3)([.-].*)?|' + re.escape(bag_metadata.NAME)
                     + r'((\.\d+)?\.part)?|' + re.escape(_ROOM))
    if path.is_dir() and all(own.fullmatch(each.name) for each in path.iterdir()):
        shutil.rmtree(path)


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
    raised where it is wrong; of a bag without checksums the log says so.
    """
    with _explained(bag):
        for file in _opened(Path(bag)):
            wanted = {number: (each, _qos(each)) for number, each in file.channels.items()
                      if only is None or each.topic in only}
            if wanted and not file.checked:
                _tell_unchecked(str(bag))
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
    if not bag.exists():
        raise BagError('it is not there; check the path')
    if bag.is_dir() and not (bag / 'metadata.yaml').exists():
        raise BagError('there is no metadata.yaml in it' + (
            ': its recording was killed; `mcap recover` saves the messages of the .mcap'
            if any(bag.glob('*.mcap')) else '; ros2 bag and pmcl bag record make bags'))
    of = BagFiles.read(bag) if bag.is_dir() else None
    for path in [bag] if of is None else of.paths(bag):
        with ExitStack() as stack:
            file = _file(path, stack)
            foreign = {each.encoding for each in file.channels.values()} - {'cdr'}
            if foreign:
                raise BagError(f'its messages are {", ".join(foreign)}, only cdr is read')
            yield _MessagesUnpacked(file) if of and of.each_packed else file


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
def _tell_unchecked(bag: str) -> None:
    """Once for each bag. No warning: recorders of others write none, and nothing is wrong."""
    _LOG.info('%s has no checksums: damage to its messages would not be noticed', bag)


def _qos(channel: Channel) -> Qos:
    return qos_from(channel.qos, channel.topic) or VOLATILE
