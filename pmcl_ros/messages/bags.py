"""Bags: MCAP files of the chain's topics, written and read without ROS."""

import shutil
from collections.abc import Container, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
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
from scipy.spatial.transform import Rotation

from pmcl_ros.camera.files import read_raw_frame, write_picture
from pmcl_ros.camera.packing import pack12
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, mosaic_of_views
from pmcl_ros.runtime.errors import BagError

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
                    topic, message.type, typestore=_TYPES, offered_qos_profiles=[message.qos])
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


def record_capture(picture: Path | str, bag: Path | str, header: Header | None = None) -> None:
    """Make a bag of `/metadata` and `/image_raw` from a raw picture and its .TXT."""
    record(bag, capture_messages(read_raw_frame(picture, header)))


def capture_messages(frame: RawFrame) -> list[Recorded]:
    """What `lytro_driver` would publish for a raw frame, in its order."""
    image = _image(frame.header, 'bayer_bggr16', np.ascontiguousarray(frame.counts, '<u2'))
    text = _TYPES.types['std_msgs/msg/String'](data=frame.metadata.text)
    return [_recorded('/metadata', text, frame.header, LATCHED),
            _recorded('/image_raw', image, frame.header)]


def extract_captures(bag: Path | str, folder: Path | str) -> list[Path]:
    """Write each picture of a bag as the camera has it, RAW and TXT; their paths.

    The inverse of `record_capture`, for every `/image_raw` with the `/metadata` before it. Raises
    BagError when there is none, or a picture of that name is there already.
    """
    text = ''
    paths: list[Path] = []
    for each in read(bag):
        if each.topic == '/metadata':
            text = _TYPES.deserialize_cdr(each.cdr, each.type).data  # type: ignore[attr-defined]
        elif each.topic == '/image_raw' and text:
            image: Any = _TYPES.deserialize_cdr(each.cdr, each.type)
            counts = image.data.view('<u2').reshape(image.height, image.width)
            paths.append(Path(folder) / f'IMG_{len(paths) + 1:04d}.RAW')
            if paths[-1].exists():
                raise BagError(f'{paths[-1]} is already there; choose another folder')
            write_picture(paths[-1], pack12(counts), text)
    if not paths:
        raise BagError(f'{bag} holds no /image_raw with /metadata before it')
    return paths


def record_light_field(light_field: LightField, bag: Path | str) -> None:
    """Make a bag of `/views`, `/center/image` and what belongs to them."""
    record(bag, light_field_messages(light_field))


def light_field_messages(light_field: LightField) -> list[Recorded]:
    """What `subaperture_node` would publish for a light field."""
    grid, header = light_field.grid, light_field.header
    light = np.concatenate([grid.weights[..., None], grid.positions], axis=2).astype('<f4')
    return [_recorded('/center/camera_info', _camera_info(header, grid.pinhole, 0.0), header),
            _recorded('/center/image', _image(header, 'rgb8', light_field.picture()), header),
            _recorded('/views/camera_info', _camera_info(header, grid.pinhole, grid.baseline),
                      header),
            _recorded('/views/pupil', _image(header, '32FC3', light), header),
            _recorded('/views', _image(header, 'rgb16', mosaic_of_views(light_field.views)),
                      header)]


def pose_message(topic: str, header: Header, pose: NDArray[np.float64]) -> Recorded:
    """A PoseStamped of a pose (4, 4), told in the header's frame."""
    types = _TYPES.types
    x, y, z = (float(each) for each in pose[:3, 3])
    a, b, c, w = (float(each) for each in Rotation.from_matrix(pose[:3, :3]).as_quat())
    inner = types['geometry_msgs/msg/Pose'](
        position=types['geometry_msgs/msg/Point'](x=x, y=y, z=z),
        orientation=types['geometry_msgs/msg/Quaternion'](x=a, y=b, z=c, w=w))
    return _recorded(topic, types['geometry_msgs/msg/PoseStamped'](header=_header(header),
                                                                   pose=inner), header)


def _recorded(topic: str, message: Any, header: Header, qos: Qos = VOLATILE) -> Recorded:
    cdr = bytes(_TYPES.serialize_cdr(message, message.__msgtype__))
    return Recorded(topic, message.__msgtype__, header.stamp_ns, cdr, qos)


def _header(header: Header) -> Any:
    stamp = _TYPES.types['builtin_interfaces/msg/Time'](*divmod(header.stamp_ns, 10**9))
    return _TYPES.types['std_msgs/msg/Header'](stamp=stamp, frame_id=header.frame_id)


def _image(header: Header, encoding: str, pixels: NDArray[Any]) -> Any:
    """An Image of little-endian pixels (height, width[, channels])."""
    height, width = pixels.shape[:2]
    return _TYPES.types['sensor_msgs/msg/Image'](
        header=_header(header), height=height, width=width, encoding=encoding, is_bigendian=0,
        step=pixels.nbytes // height, data=pixels.reshape(-1).view(np.uint8))


def _camera_info(header: Header, pinhole: Pinhole, baseline: float) -> Any:
    """As `camera_info.pinhole_to_message`."""
    types = _TYPES.types
    p = np.zeros((3, 4))
    p[:, :3] = pinhole.matrix
    p[:2, 3] = -pinhole.fx * baseline, -pinhole.fy * baseline
    return types['sensor_msgs/msg/CameraInfo'](
        header=_header(header), height=pinhole.height, width=pinhole.width,
        distortion_model='plumb_bob', d=np.zeros(5), k=pinhole.matrix.ravel(),
        r=np.eye(3).ravel(), p=p.ravel(), binning_x=0, binning_y=0,
        roi=types['sensor_msgs/msg/RegionOfInterest'](x_offset=0, y_offset=0, height=0, width=0,
                                                      do_rectify=False))


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

