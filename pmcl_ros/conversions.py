"""The only place that knows how this package's values lie in ROS messages.

Writers take an optional `Buffer`, the publisher's own, and fill it in place: the message that they
return holds until the next is written to the same buffer. Readers check all that a topic promises,
raise MessageError with what is wrong, the values and the remedy, and never copy big fields.
"""

from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
)
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import (
    ColorRGBA,
    Float32MultiArray,
    MultiArrayDimension,
    MultiArrayLayout,
    String,
)
from std_msgs.msg import Header as HeaderMessage
from visualization_msgs.msg import Marker, MarkerArray

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.dlv.volume import DepthLikelihoodVolume, EdgeVolume
from pmcl_ros.errors import MessageError, PmclError
from pmcl_ros.header import Header
from pmcl_ros.lightfield.counts import VIEW_WHITE, views_of_mosaic
from pmcl_ros.lightfield.geometry import Pinhole, ViewGrid
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region

# encoding: type of one value, values per pixel
_ENCODINGS = {'bayer_bggr16': ('<u2', 1), 'rgb16': ('<u2', 3), 'rgb8': ('u1', 3),
              '32FC1': ('<f4', 1), '32FC3': ('<f4', 3)}
_VOLUME, _EDGES = ('height', 'width', 'depth'), ('height', 'width', 'depth', 'tensor')
# what follows the name in a dimension's label
_KEYS = {'height': ('stamp', 'frame'), 'width': ('fx', 'fy', 'cx', 'cy'), 'depth': ('metres',),
         'tensor': ('components',)}


class Buffer:
    """A publisher's message with a big array, kept from one publication to the next.

    Assigning such a field copies it, numpy and lists element by element: 0.8 s for a 32 MB volume,
    against 5 ms for filling the array of an old message through a numpy view of it.
    """

    def __init__(self) -> None:
        self._message: Image | Float32MultiArray | None = None

    def message(self, kind: type, typecode: str, shape: tuple[int, ...],
                dtype: str) -> tuple[Any, NDArray]:
        """A message of this kind, and its data as writable numpy of this shape and dtype."""
        size = prod(shape) * np.dtype(dtype).itemsize
        if not isinstance(self._message, kind) or memoryview(self._message.data).nbytes != size:
            self._message = kind()
            self._message.data = array(typecode, bytes(size))
        return self._message, np.frombuffer(self._message.data, dtype).reshape(shape)


class RawMessages(NamedTuple):
    """`metadata` and `image_raw`, in the order in which they are published."""

    metadata: String
    image: Image


class Part(NamedTuple):
    """A message that becomes a value together with others of its capture."""

    header: Header
    message: Any


class LightFieldMessages(NamedTuple):
    """`views/camera_info`, `views/pupil` and `views`, in the order in which they are published."""

    camera_info: CameraInfo
    pupil: Image
    views: Image


class PoseMessages(NamedTuple):
    """`pose`, `pose_with_covariance` and `particles`."""

    pose: PoseStamped
    with_covariance: PoseWithCovarianceStamped
    particles: PoseArray


# headers

def header_to_message(header: Header) -> HeaderMessage:
    """Stamp and frame."""
    return HeaderMessage(stamp=time_to_message(header.stamp_ns), frame_id=header.frame_id)


def header_from(message: HeaderMessage) -> Header:
    """The inverse of `header_to_message`."""
    return Header(message.stamp.sec * 10**9 + message.stamp.nanosec, message.frame_id)


def part_from(check: Callable[[Any], object]) -> Callable[[Any], Part]:
    """What reads a message with a header that `check`, its reader, does not refuse."""
    def read(message: Any) -> Part:
        check(message)
        return Part(header_from(message.header), message)
    return read


def time_to_message(stamp_ns: int) -> Time:
    """Nanoseconds since the epoch as a Time, which ends in 2038."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    if not -2**31 <= seconds < 2**31:
        raise MessageError(f'stamp {stamp_ns} does not fit into a ROS time (32 bits of seconds): '
                           'it must be nanoseconds since 1970')
    return Time(sec=seconds, nanosec=nanoseconds)


# images

def picture_to_message(header: Header, picture: NDArray[np.uint8],
                       buffer: Buffer | None = None) -> Image:
    """A picture to look at: (height, width, 3) uint8 RGB as rgb8."""
    message, pixels = _image(header, 'rgb8', picture.shape[:2], buffer)
    pixels[:] = picture
    return message


def picture_from(message: Image) -> NDArray[np.uint8]:
    """(height, width, 3) uint8 of an rgb8 image."""
    return _pixels(message, 'rgb8', 'picture')


def depth_to_message(volume: DepthLikelihoodVolume, buffer: Buffer | None = None) -> Image:
    """The most likely depth as 32FC1 [m]; NaN where no label is better than another (REP-118)."""
    depth = volume.depth_map()
    message, pixels = _image(volume.header, '32FC1', depth.shape, buffer)
    pixels[:] = depth
    return message


def depth_from(message: Image) -> NDArray[np.float32]:
    """(height, width) float32 [m] of a 32FC1 image; NaN: unknown."""
    return _pixels(message, '32FC1', 'depth')


def _image(header: Header, encoding: str, shape: tuple[int, ...],
           buffer: Buffer | None) -> tuple[Image, NDArray]:
    """An Image of (height, width) pixels and the view through which its data are filled."""
    dtype, channels = _ENCODINGS[encoding]
    height, width = shape
    shape = (height, width, channels) if channels > 1 else (height, width)
    message, pixels = (buffer or Buffer()).message(Image, 'B', shape, dtype)
    message.header = header_to_message(header)
    message.height, message.width, message.encoding = height, width, encoding
    message.is_bigendian, message.step = 0, width * channels * np.dtype(dtype).itemsize
    return message, pixels


def _pixels(message: Image, encoding: str, topic: str) -> NDArray:
    """The data of an Image as (height, width[, channels]), not copied."""
    dtype, channels = _ENCODINGS[encoding]
    height, width = message.height, message.width
    step = width * channels * np.dtype(dtype).itemsize
    if message.encoding != encoding:
        raise MessageError(f'{topic}: encoding is {message.encoding!r}, expected {encoding!r}')
    if message.is_bigendian:
        raise MessageError(f'{topic}: is_bigendian is {message.is_bigendian}, expected 0')
    if not height or not width or message.step != step or len(message.data) != step * height:
        raise MessageError(
            f'{topic}: {width}x{height} pixels in rows of {message.step} bytes with '
            f'{len(message.data)} bytes of data; {encoding} needs rows of {step} bytes and '
            f'{step * height} bytes, and at least one pixel')
    shape = (height, width, channels) if channels > 1 else (height, width)
    return np.frombuffer(message.data, dtype).reshape(shape)


# camera -> RawFrame

def raw_frame_to_messages(frame: RawFrame, buffer: Buffer | None = None) -> RawMessages:
    """The camera's JSON, and its own counts 0..4095 (not shifted to 16 bits) as bayer_bggr16."""
    message, pixels = _image(frame.header, 'bayer_bggr16', frame.counts.shape, buffer)
    pixels[:] = frame.counts
    return RawMessages(String(data=frame.metadata.text), message)


def metadata_from(message: String) -> CameraMetadata:
    """The camera's JSON, parsed."""
    with _promised_by('metadata'):
        return CameraMetadata.parse(message.data)


def counts_from(image: Image) -> NDArray[np.uint16]:
    """(height, width) counts of an `image_raw` message, its own memory."""
    return _pixels(image, 'bayer_bggr16', 'image_raw')


def raw_frame_from(image: Image, metadata: CameraMetadata) -> RawFrame:
    """The inverse of `raw_frame_to_messages`; the counts are the message's own memory."""
    with _promised_by('image_raw'):
        return RawFrame(header_from(image.header), counts_from(image), metadata)


# RawFrame -> LightField

def light_field_to_messages(light_field: LightField,
                            buffer: Buffer | None = None) -> LightFieldMessages:
    """The mosaic of views, their geometry and their light.

    views: rgb16, rows x columns of views, linear, 32768 at the sensor's white; negative light
        becomes 0, light beyond twice the white 65535.
    pupil: 32FC3 of the grid's size: weight, then the position (x, y) in view steps.
    `gamma` stays behind: it is for looking, and the centre picture has it applied.
    """
    grid, header = light_field.grid, light_field.header
    info = pinhole_to_message(header, grid.pinhole, grid.baseline)
    return LightFieldMessages(info, pupil_to_message(light_field),
                              views_to_message(light_field, buffer))


def views_to_message(light_field: LightField, buffer: Buffer | None = None) -> Image:
    """`views` alone of `light_field_to_messages`."""
    (rows, columns), pinhole = light_field.grid.shape, light_field.grid.pinhole
    shape = (rows * pinhole.height, columns * pinhole.width)
    message, mosaic = _image(light_field.header, 'rgb16', shape, buffer)
    tiles = mosaic.reshape(rows, pinhole.height, columns, pinhole.width, 3)
    for row, column in np.ndindex(rows, columns):
        counts = light_field.views[row, column] * np.float32(VIEW_WHITE)
        counts += np.float32(0.5)
        tiles[row, :, column] = np.clip(counts, 0, 65535, out=counts)
    return message


def pupil_to_message(light_field: LightField, buffer: Buffer | None = None) -> Image:
    """`views/pupil` alone of `light_field_to_messages`."""
    grid = light_field.grid
    message, light = _image(light_field.header, '32FC3', grid.shape, buffer)
    light[..., 0], light[..., 1:] = grid.weights, grid.positions
    return message


def light_field_from(camera_info: CameraInfo, pupil: Image, views: Image) -> LightField:
    """The inverse of `light_field_to_messages`: three messages of one capture."""
    header = header_from(views.header)
    for name, other in (('views/camera_info', camera_info), ('views/pupil', pupil)):
        _same(name, header_from(other.header), header)
    pinhole, baseline = pinhole_from(camera_info), baseline_from(camera_info)
    light, mosaic = pupil_from(pupil), mosaic_from(views)
    rows, columns = light.shape[:2]
    expected = (rows * pinhole.height, columns * pinhole.width)
    if mosaic.shape[:2] != expected:
        raise MessageError(
            f'views is {mosaic.shape[1]}x{mosaic.shape[0]} pixels, but {columns}x{rows} views '
            f'(views/pupil) of {pinhole.width}x{pinhole.height} (views/camera_info) make '
            f'{expected[1]}x{expected[0]}')
    linear = views_of_mosaic(mosaic, rows, columns)
    with _promised_by('views'):
        grid = ViewGrid(pinhole, baseline, light[..., 1:].astype(float), light[..., 0].copy())
        return LightField(header, linear, grid)


def mosaic_from(views: Image) -> NDArray[np.uint16]:
    """(rows * height, columns * width, 3) counts of a `views` message, its own memory."""
    return _pixels(views, 'rgb16', 'views')


def pupil_from(message: Image) -> NDArray[np.float32]:
    """(rows, columns, 3): weight, x and y of each view, from a `views/pupil` message."""
    light = _pixels(message, '32FC3', 'views/pupil')
    if not np.isfinite(light).all() or (light[..., 0] < 0).any():
        raise MessageError('views/pupil holds NaN, infinity or a negative weight; expected the '
                           'weight, x and y of every view')
    return light


def pinhole_to_message(header: Header, pinhole: Pinhole, baseline: float = 0) -> CameraInfo:
    """A rectified pinhole; a baseline [m] is told as in stereo: P[3] = -fx B and P[7] = -fy B."""
    p = np.zeros((3, 4))
    p[:, :3] = pinhole.matrix
    p[:2, 3] = -pinhole.fx * baseline, -pinhole.fy * baseline
    return CameraInfo(header=header_to_message(header), height=pinhole.height, width=pinhole.width,
                      distortion_model='plumb_bob', d=array('d', bytes(40)),
                      k=pinhole.matrix.ravel(), r=np.eye(3).ravel(), p=p.ravel())


def pinhole_from(message: CameraInfo) -> Pinhole:
    """The pinhole of a rectified camera; distortion or skew are refused."""
    k, p = np.reshape(message.k, (3, 3)), np.reshape(message.p, (3, 4))
    fx, fy, cx, cy = (float(each) for each in (k[0, 0], k[1, 1], k[0, 2], k[1, 2]))
    with _promised_by('camera_info'):
        pinhole = Pinhole(message.width, message.height, fx, fy, cx, cy)
    if not np.array_equal(k, pinhole.matrix) or not np.array_equal(p[:, :3], k) or any(message.d):
        raise MessageError(f'camera_info: K {k.tolist()}, P {p.tolist()}, D {list(message.d)} are '
                           'not of a rectified pinhole: no skew, no distortion, P begins with K')
    return pinhole


def baseline_from(message: CameraInfo) -> float:
    """Metres between adjacent views, from P[3] = -fx B and P[7] = -fy B, which must agree."""
    across, down = -message.p[3] / message.k[0], -message.p[7] / message.k[4]
    if not (across > 0 and np.isclose(across, down, rtol=1e-6)):
        raise MessageError(f'views/camera_info: P[3] and P[7] say baselines of {across} m and '
                           f'{down} m; expected -fx B and -fy B of one positive B')
    return float(across)


# LightField -> DepthLikelihoodVolume

def volume_to_message(volume: DepthLikelihoodVolume,
                      buffer: Buffer | None = None) -> Float32MultiArray:
    """The likelihood, height x width x depth, with all that is needed to use it.

    The labels of the dimensions hold text, exact to the last bit:
    `height;stamp=NS;frame=ID`, `width;fx=..;fy=..;cx=..;cy=..`, `depth;metres=FAR,..,NEAR`.
    The data before `data_offset` hold the same as float32: the stamp [ns] as four 16-bit words,
    most significant first, then fx, fy, cx, cy, then the depth of every label. The value of row i,
    column j, label k is data[data_offset + dim[1].stride * i + dim[2].stride * j + k].
    """
    return _write_volume(volume, volume.likelihood, _VOLUME, buffer)


def multi_array_from(cdr: bytes) -> Float32MultiArray:
    """A `dlv` or `dlv/edges` message as it was sent: see `message_from`."""
    return message_from(cdr, Float32MultiArray)


def message_from(cdr: bytes, kind: type) -> Any:
    """A message of type `kind` as it was sent; its arrays are numpy.

    They are copied once, to be writable as all others are: numba compiles for that. rclpy copies
    them three times, in ways that take longer than all of the transport.
    """
    # numpy's new memory comes in huge pages, which a bytearray's does not: 20 ms less of 40.
    copy = np.frombuffer(cdr, np.uint8).copy()
    package = kind.__module__.partition('.')[0]
    return _types().deserialize_cdr(memoryview(copy), f'{package}/msg/{kind.__name__}')


@cache
def _types() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


def volume_from(message: Float32MultiArray) -> DepthLikelihoodVolume:
    """The inverse of `volume_to_message`; `with_edges` adds the edges."""
    header, pinhole, depths, values = _read_volume(message, _VOLUME, 'dlv')
    with _promised_by('dlv'):
        return DepthLikelihoodVolume(header, values, depths, pinhole)


def edges_to_message(edges: EdgeVolume, buffer: Buffer | None = None) -> Float32MultiArray:
    """As `volume_to_message`, with a fourth dimension `tensor;components=xx,yy,xy`."""
    return _write_volume(edges, edges.tensor, _EDGES, buffer)


def edges_from(message: Float32MultiArray) -> EdgeVolume:
    """The inverse of `edges_to_message`."""
    header, pinhole, depths, values = _read_volume(message, _EDGES, 'dlv/edges')
    with _promised_by('dlv/edges'):
        if values.shape[3] != 3:
            raise MessageError(f'dlv/edges: {values.shape[3]} components, expected xx, yy, xy')
        return EdgeVolume(header, values, depths, pinhole)


def with_edges(volume: DepthLikelihoodVolume, edges: EdgeVolume) -> DepthLikelihoodVolume:
    """Both of one capture as one value; their labels may differ, as edges need fewer."""
    if volume.edges is edges:  # they were handed over as one
        return volume
    _same('dlv/edges', edges.header, volume.header)
    if edges.pinhole != volume.pinhole:
        raise MessageError(f'dlv/edges: {edges.pinhole}, but dlv of that stamp: {volume.pinhole}')
    return replace(volume, edges=edges)


def _write_volume(source: DepthLikelihoodVolume | EdgeVolume, values: NDArray[np.float32],
                  names: Sequence[str], buffer: Buffer | None) -> Float32MultiArray:
    header, pinhole = source.header, source.pinhole
    texts = {'height': (header.stamp_ns, header.frame_id),
             'width': (pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy),
             'depth': (','.join(repr(float(depth)) for depth in source.depths),),
             'tensor': ('xx,yy,xy',)}
    dimensions = []
    for axis, name in enumerate(names):
        pairs = zip(_KEYS[name], texts[name], strict=True)
        label = ';'.join([name, *(f'{key}={value}' for key, value in pairs)])
        dimensions.append(MultiArrayDimension(label=label, size=values.shape[axis],
                                              stride=prod(values.shape[axis:])))
    padding = _padding(header, pinhole, source.depths)
    message, data = (buffer or Buffer()).message(Float32MultiArray, 'f',
                                                 (len(padding) + values.size,), '<f4')
    message.layout = MultiArrayLayout(dim=dimensions, data_offset=len(padding))
    data[:len(padding)] = padding
    data[len(padding):].reshape(values.shape)[:] = values
    return message


def _read_volume(message: Float32MultiArray, names: Sequence[str], topic: str,
                 ) -> tuple[Header, Pinhole, NDArray[np.float64], NDArray[np.float32]]:
    dimensions, offset = message.layout.dim, message.layout.data_offset
    if len(dimensions) != len(names):
        raise MessageError(f'{topic}: the layout has {len(dimensions)} dimensions, expected '
                           f'{", ".join(names)}')
    texts = [_fields(each.label, name, topic)
             for each, name in zip(dimensions, names, strict=True)]
    shape = tuple(each.size for each in dimensions)
    strides = [each.stride for each in dimensions]
    expected = [prod(shape[axis:]) for axis in range(len(shape))]
    if strides != expected or not prod(shape):
        raise MessageError(f'{topic}: sizes {list(shape)} with strides {strides}, expected '
                           f'strides {expected} (products of the sizes inwards) and no size 0')
    stamp, frame = texts[0]
    with _promised_by(topic):
        header = Header(_number(int, stamp, topic), frame)
        time_to_message(header.stamp_ns)  # refuses what no ROS time can hold
        intrinsics = [_number(float, text, topic) for text in texts[1]]
        pinhole = Pinhole(shape[1], shape[0], *intrinsics)
    depths = np.array([_number(float, text, topic) for text in texts[2][0].split(',')])
    padding = _padding(header, pinhole, depths)
    found = len(depths), offset, len(message.data)
    right = shape[2], len(padding), len(padding) + expected[0]
    if found != right:
        raise MessageError(
            f'{topic}: {found[0]} depths, data_offset {found[1]} and {found[2]} values for sizes '
            f'{list(shape)}; expected {right[0]}, {right[1]} and {right[2]}')
    data = np.frombuffer(message.data, '<f4')
    if not np.array_equal(data[:offset], padding):
        raise MessageError(f'{topic}: the numbers before data_offset are not those of the labels')
    values = data[offset:].reshape(shape)
    if not np.isfinite([values.min(), values.max()]).all():  # either is NaN where any value is
        raise MessageError(f'{topic}: the data hold NaN or infinity')
    return header, pinhole, depths, values


def _padding(header: Header, pinhole: Pinhole,
             depths: NDArray[np.float64]) -> NDArray[np.float32]:
    words = np.frombuffer(header.stamp_ns.to_bytes(8, 'big', signed=True), '>u2')
    intrinsics = [pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy]
    return np.concatenate([words, intrinsics, depths]).astype(np.float32)


def _fields(label: str, name: str, topic: str) -> list[str]:
    """The values of a label `name;key=value;...`, of which the last may hold any text."""
    keys = _KEYS[name]
    found, *pairs = label.split(';', len(keys))
    split = [pair.partition('=') for pair in pairs]
    if found != name or tuple(key for key, _, _ in split) != keys:
        raise MessageError(f'{topic}: dimension label {label[:60]!r}, expected '
                           f'{";".join([name, *(f"{key}=..." for key in keys)])!r}')
    return [value for _, _, value in split]


def _number(kind: type, text: str, topic: str) -> int | float:
    try:
        return kind(text)
    except ValueError:
        raise MessageError(f'{topic}: {text[:40]!r} in a dimension label is no number') from None


# DepthLikelihoodVolume -> PoseEstimate

def estimate_to_messages(estimate: PoseEstimate) -> PoseMessages:
    """The pose, the pose with its covariance, the particles: object to camera, metres."""
    header = header_to_message(estimate.header)
    pose, *particles = _poses(np.concatenate([estimate.pose[None], estimate.particles]))
    spread = PoseWithCovariance(pose=pose, covariance=estimate.covariance.astype(float).ravel())
    return PoseMessages(PoseStamped(header=header, pose=pose),
                        PoseWithCovarianceStamped(header=header, pose=spread),
                        PoseArray(header=header, poses=particles))


def estimate_to_transform(estimate: PoseEstimate, child: str) -> TransformStamped:
    """The pose as /tf tells it: the object's frame `child` in the camera's."""
    pose = _poses(estimate.pose[None])[0]
    p = pose.position
    return TransformStamped(
        header=header_to_message(estimate.header), child_frame_id=child,
        transform=Transform(translation=Vector3(x=p.x, y=p.y, z=p.z), rotation=pose.orientation))


def mesh_to_marker(model: ObjectModel) -> Marker:
    """The object as triangles in its own frame; `place_markers` says where it is."""
    corners = model.vertices[model.faces.ravel()].tolist()
    return Marker(ns=model.name, type=Marker.TRIANGLE_LIST, scale=Vector3(x=1.0, y=1.0, z=1.0),
                  color=ColorRGBA(r=0.1, g=0.6, b=1.0, a=0.6),
                  points=[Point(x=x, y=y, z=z) for x, y, z in corners])


def region_to_marker(region: Region) -> Marker:
    """The box that the object's origin is looked for in; `place_markers` says of which capture."""
    x, y, z = region.center
    return Marker(ns='region', type=Marker.CUBE, color=ColorRGBA(r=1.0, g=0.8, b=0.2, a=0.15),
                  scale=Vector3(**dict(zip('xyz', region.size, strict=True))),
                  pose=Pose(position=Point(x=x, y=y, z=z)))


def place_markers(mesh: Marker, region: Marker, estimate: PoseEstimate) -> MarkerArray:
    """The region, and `mesh` at the estimated pose; no mesh where the object is lost."""
    mesh.header = region.header = header_to_message(estimate.header)
    mesh.action = Marker.DELETE if estimate.lost else Marker.ADD
    mesh.pose = _poses(estimate.pose[None])[0]
    return MarkerArray(markers=[region, mesh])


def objects_to_markers(names: Sequence[str], meshes: Sequence[tuple[Path, float]],
                       estimates: Sequence[PoseEstimate]) -> MarkerArray:
    """The list of objects: ns is the name, text found or lost, pose that of the mesh.

    meshes: file and metres per unit of each. A lost one is where it would be most likely, faint.
    """
    markers = []
    for k, (name, (path, scale), each) in enumerate(zip(names, meshes, estimates, strict=True)):
        colour = ColorRGBA(r=0.8, g=0.2, b=0.1, a=0.05) if each.lost else ColorRGBA(
            r=0.1, g=0.6, b=1.0, a=0.6)
        markers.append(Marker(
            header=header_to_message(each.header), ns=name, id=k, type=Marker.MESH_RESOURCE,
            action=Marker.ADD, pose=_poses(each.pose[None])[0], color=colour,
            scale=Vector3(x=scale, y=scale, z=scale), text='lost' if each.lost else 'found',
            mesh_resource=path.absolute().as_uri()))
    return MarkerArray(markers=markers)


def no_markers() -> MarkerArray:
    """Takes every marker away."""
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL)])


def pose_from(message: PoseStamped) -> tuple[Header, NDArray[np.float64]]:
    """Header and pose (4, 4)."""
    return header_from(message.header), _matrices([message.pose], 'pose')[0]


def pose_with_covariance_from(message: PoseWithCovarianceStamped,
                              ) -> tuple[Header, NDArray[np.float64], NDArray[np.float64]]:
    """Header, pose (4, 4) and covariance (6, 6): x, y, z, then rotations about the fixed axes."""
    covariance = np.reshape(message.pose.covariance, (6, 6))
    if not np.isfinite(covariance).all() or not np.allclose(covariance, covariance.T):
        raise MessageError('pose_with_covariance: the covariance is not finite and symmetric')
    pose = _matrices([message.pose.pose], 'pose_with_covariance')[0]
    return header_from(message.header), pose, covariance


def particles_from(message: PoseArray) -> tuple[Header, NDArray[np.float64]]:
    """Header and poses (n, 4, 4)."""
    return header_from(message.header), _matrices(message.poses, 'particles')


def _poses(matrices: NDArray[np.float64]) -> list[Pose]:
    quaternions = Rotation.from_matrix(matrices[:, :3, :3]).as_quat(canonical=True)  # x, y, z, w
    return [Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=a, y=b, z=c, w=w))
            for (x, y, z), (a, b, c, w)
            in zip(matrices[:, :3, 3].tolist(), quaternions.tolist(), strict=True)]


def _matrices(poses: Sequence[Pose], topic: str) -> NDArray[np.float64]:
    rows = np.array([(p.position.x, p.position.y, p.position.z, p.orientation.x, p.orientation.y,
                      p.orientation.z, p.orientation.w) for p in poses]).reshape(-1, 7)
    lengths = np.linalg.norm(rows[:, 3:], axis=1)
    if not np.isfinite(rows).all() or (abs(lengths - 1) > 1e-3).any():
        raise MessageError(f'{topic}: a pose is not finite or its quaternion has not length 1')
    matrices = np.tile(np.eye(4), (len(rows), 1, 1))
    if len(rows):
        matrices[:, :3, :3] = Rotation.from_quat(rows[:, 3:]).as_matrix()
    matrices[:, :3, 3] = rows[:, :3]
    return matrices


# how a node is

def diagnostics_to_message(stamp_ns: int, status: DiagnosticStatus,
                           values: dict[str, object]) -> DiagnosticArray:
    """`status` with `values`, as its text, for /diagnostics."""
    status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticArray(header=HeaderMessage(stamp=time_to_message(stamp_ns)), status=[status])


@contextmanager
def _promised_by(topic: str) -> Iterator[None]:
    """What the core refuses in a message's content, told as the message's fault."""
    try:
        yield
    except MessageError:
        raise
    except PmclError as error:
        raise MessageError(f'{topic}: {error}') from None


def _same(topic: str, found: Header, expected: Header) -> None:
    if found != expected:
        raise MessageError(f'{topic} is of {found}, expected {expected}: messages of one capture '
                           'share stamp and frame')
