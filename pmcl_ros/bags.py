"""Bags: MCAP files of the chain's topics, written and read without ROS."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
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
from rosbags.typesys import Stores, get_typestore

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.errors import BagError
from pmcl_ros.header import Header

_TYPES = get_typestore(Stores.ROS2_JAZZY)
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


def record(bag: Path | str, messages: Iterable[Recorded], compress: bool = True) -> None:
    """Write a new bag, a folder that `ros2 bag play` and `read` take; compressed with zstd.

    Raises BagError when it is already there.
    """
    if Path(bag).exists():
        raise BagError(f'{bag} is already there; remove it or choose another name')
    writer = Writer(bag, version=_FORMAT, storage_plugin=StoragePlugin.MCAP)
    if compress:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    connections = {}
    try:
        with writer:
            for each in messages:
                if each.topic not in connections:
                    connections[each.topic] = writer.add_connection(
                        each.topic, each.type, typestore=_TYPES, offered_qos_profiles=[each.qos])
                writer.write(connections[each.topic], each.time_ns, each.cdr)
    except WriterError as error:
        raise BagError(f'cannot write {bag}: {error}') from None


class Topic(NamedTuple):
    """A topic of a bag."""

    name: str
    type: str
    qos: Qos
    messages: int


def topics(bag: Path | str) -> list[Topic]:
    """What a bag holds."""
    with _open(bag) as reader:
        return [Topic(each.topic, each.msgtype, _qos(each), each.msgcount)
                for each in reader.connections]


def read(bag: Path | str) -> Iterator[Recorded]:
    """The messages of a bag in the order of their times."""
    with _open(bag) as reader:
        for connection, time_ns, cdr in reader.messages():
            yield Recorded(connection.topic, connection.msgtype, time_ns, bytes(cdr),
                           _qos(connection))


def record_capture(picture: Path | str, bag: Path | str, header: Header | None = None) -> None:
    """Make a bag of `/metadata` and `/image_raw` from a raw picture and its .TXT."""
    record(bag, capture_messages(read_raw_frame(picture, header)))


def capture_messages(frame: RawFrame) -> list[Recorded]:
    """What `lytro_driver` would publish for a raw frame, in its order."""
    kinds, time_ns = _TYPES.types, frame.header.stamp_ns
    height, width = frame.counts.shape
    stamp = kinds['builtin_interfaces/msg/Time'](*divmod(time_ns, 10**9))
    image = kinds['sensor_msgs/msg/Image'](
        header=kinds['std_msgs/msg/Header'](stamp=stamp, frame_id=frame.header.frame_id),
        height=height, width=width, encoding='bayer_bggr16', is_bigendian=0, step=2 * width,
        data=np.ascontiguousarray(frame.counts, '<u2').view(np.uint8).ravel())
    text = kinds['std_msgs/msg/String'](data=frame.metadata.text)
    return [Recorded('/metadata', text.__msgtype__, time_ns, _cdr(text), LATCHED),
            Recorded('/image_raw', image.__msgtype__, time_ns, _cdr(image))]


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


def _cdr(message: Any) -> bytes:
    return bytes(_TYPES.serialize_cdr(message, message.__msgtype__))
