"""Bags: MCAP files of recorded messages, written and read without ROS."""

import shutil
from collections.abc import Container, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, NamedTuple

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import (
    CompressionFormat,
    CompressionMode,
    Reader,
    ReaderError,
    StoragePlugin,
    Writer,
    WriterError,
)

from pmcl_ros.messages.cdr import typestore
from pmcl_ros.runtime.errors import BagError

_FORMAT: Literal[9] = 9  # rosbag2's version of metadata.yaml as of Jazzy
_FOREVER = QosTime(9223372036, 854775807)  # RMW_DURATION_INFINITE


def _offered(durability: QosDurability) -> Qos:
    """Reliable, keep last 1: what every publisher of the chain's big topics offers."""
    return Qos(QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, durability, _FOREVER, _FOREVER,
               QosLiveliness.AUTOMATIC, _FOREVER, avoid_ros_namespace_conventions=False)


VOLATILE, LATCHED = _offered(QosDurability.VOLATILE), _offered(QosDurability.TRANSIENT_LOCAL)


class Recorded(NamedTuple):
    """One message as it lies in a bag: `cdr` is what goes over the wire, time_ns when it came."""

    topic: str
    type: str
    time_ns: int
    cdr: bytes
    qos: Qos = VOLATILE


class BagWriter:
    """A new bag, a folder that `ros2 bag play` and `read` take; chunks compressed with zstd.

    A context manager; whatever ends it, what was written until then can be read. A bag without a
    message is taken away again. Raises BagError when it is already there or cannot be written.
    """

    def __init__(self, bag: Path | str, compress: bool = True) -> None:
        self._bag = Path(bag)
        if self._bag.exists():
            raise BagError(f'{bag} is already there; remove it or choose another name')
        self._writer = Writer(self._bag, version=_FORMAT, storage_plugin=StoragePlugin.MCAP)
        if compress:
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._connections: dict[str, Connection] = {}

    def __enter__(self) -> 'BagWriter':
        with self._explained():
            self._writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        with self._explained():
            self._writer.close()  # never abort, which writes no index
        if not self._connections:
            shutil.rmtree(self._bag)

    def write(self, message: Recorded) -> None:
        """Append a message."""
        topic = message.topic
        with self._explained():
            if topic not in self._connections:
                self._connections[topic] = self._writer.add_connection(
                    topic, message.type, typestore=typestore(), offered_qos_profiles=[message.qos])
            self._writer.write(self._connections[topic], message.time_ns, message.cdr)

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except (WriterError, OSError) as error:
            raise BagError(f'cannot write {self._bag}: {error}') from None


def record(bag: Path | str, messages: Iterable[Recorded], compress: bool = True) -> None:
    """Write a new bag of `messages`; as `BagWriter`."""
    with BagWriter(bag, compress) as writer:
        for each in messages:
            writer.write(each)


def is_bag(path: Path | str) -> bool:
    """Whether `path` is the folder of a bag."""
    path = Path(path)
    return path.is_dir() and (path / 'metadata.yaml').is_file() and any(
        each for ending in ('mcap', 'db3') for each in path.glob(f'*.{ending}*'))


class Topic(NamedTuple):
    """A topic of a bag."""

    name: str
    type: str
    qos: Qos
    messages: int


def topics(bag: Path | str) -> list[Topic]:
    """The topics of a bag."""
    with _open(bag) as reader:
        return [Topic(each.topic, each.msgtype, _qos(each), each.msgcount)
                for each in reader.connections]


def read(bag: Path | str, only: Container[str] | None = None) -> Iterator[Recorded]:
    """The messages of a bag in the order of their times, a chunk of it in memory at a time.

    only: the names of the topics that are wanted.
    """
    with _open(bag) as reader:
        wanted = [each for each in reader.connections if only is None or each.topic in only]
        if not wanted:  # none means all there
            return
        for connection, time_ns, cdr in reader.messages(wanted):
            yield Recorded(connection.topic, connection.msgtype, time_ns, bytes(cdr),
                           _qos(connection))


@contextmanager
def _open(bag: Path | str) -> Iterator[Reader]:
    try:
        with Reader(bag) as reader:
            yield reader
    except (ReaderError, OSError) as error:
        raise BagError(f'cannot read the bag {bag}: {error}') from None


def _qos(connection: Connection) -> Qos:
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    return next(iter(connection.ext.offered_qos_profiles), VOLATILE)

