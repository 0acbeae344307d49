"""DepthLikelihoodVolume, EdgeVolume, ContourMap: `dlv`, `dlv/edges`, `dlv/contour_map`."""

from collections.abc import Sequence
from math import prod
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import CameraPose, DepthLikelihoodVolume
from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.learned import learned_map_evidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.messages.header import promised_by, time_to_message
from pmcl_ros.messages.types import (
    Buffer,
    Float32MultiArray,
    MultiArrayDimension,
    MultiArrayLayout,
)
from pmcl_ros.runtime.errors import MessageError

_VOLUME = 'height', 'width', 'depth'
_EDGES, _MAP = (*_VOLUME, 'tensor'), (*_VOLUME, 'log_odds')
_COMPONENTS = {'tensor': 'xx,yy,xy', 'log_odds': 'a0,c1,s1,c2,s2,inside'}
_Number = TypeVar('_Number', int, float)
# what follows the name in a dimension's label
_KEYS = {'height': ('stamp', 'frame'), 'width': ('fx', 'fy', 'cx', 'cy'), 'depth': ('metres',),
         'tensor': ('components',), 'log_odds': ('components',)}
_POSED = *_KEYS['width'], 'camera_to_reference', 'reference'  # instead, of posed views


def volume_to_message(volume: DepthLikelihoodVolume,
                      buffer: Buffer | None = None) -> Float32MultiArray:
    """The likelihood, height x width x depth, with all that is needed to use it.

    The labels of the dimensions hold text, exact to the last bit:
    `height;stamp=NS;frame=ID`, `width;fx=..;fy=..;cx=..;cy=..`, `depth;metres=FAR,..,NEAR`.
    Of posed views the second ends `;camera_to_reference=..,..;reference=ID`: the pose of the
    camera in that frame, 16 numbers, row by row.
    The data before `data_offset` hold the same as float32: the stamp [ns] as four 16-bit words,
    most significant first, then fx, fy, cx, cy, then the depth of every label, then the pose if
    there is one. The value of row i, column j, label k is
    data[data_offset + dim[1].stride * i + dim[2].stride * j + k].
    """
    return _write_volume(volume, (volume.likelihood,), _VOLUME, buffer, volume.camera)


def volume_from(message: Float32MultiArray) -> DepthLikelihoodVolume:
    """The inverse of `volume_to_message`."""
    header, pinhole, depths, values, camera = _read_volume(message, _VOLUME, 'dlv')
    with promised_by('dlv'):
        return DepthLikelihoodVolume(header, values, depths, pinhole, camera=camera)


def edges_to_message(edges: EdgeVolume, buffer: Buffer | None = None) -> Float32MultiArray:
    """As `volume_to_message`, with a fourth dimension `tensor;components=xx,yy,xy`."""
    return _write_volume(edges, (_at_all_labels(edges, edges.tensor),), _EDGES, buffer)


def edges_from(message: Float32MultiArray) -> EdgeVolume:
    """The inverse of `edges_to_message`."""
    header, pinhole, depths, values, _ = _read_volume(message, _EDGES, 'dlv/edges')
    with promised_by('dlv/edges'):
        return EdgeVolume(header, values, depths, pinhole)


def map_to_message(odds: ContourMap, buffer: Buffer | None = None) -> Float32MultiArray:
    """As `volume_to_message`, with `log_odds;components=a0,c1,s1,c2,s2,inside`."""
    parts = odds.tensor, odds.inside[..., None]
    return _write_volume(odds, [_at_all_labels(odds, each) for each in parts], _MAP, buffer)


def map_from(message: Float32MultiArray) -> ContourMap:
    """The inverse of `map_to_message`, with the learned numbers of this package."""
    header, pinhole, depths, values, _ = _read_volume(message, _MAP, 'dlv/contour_map')
    if (values == values[:, :, :1]).all():
        values = values[:, :, :1]  # of one picture
    with promised_by('dlv/contour_map'):
        return ContourMap(header, np.ascontiguousarray(values[..., :5]), depths, pinhole,
                          np.ascontiguousarray(values[..., 5]), learned_map_evidence())


def _at_all_labels(of: EvidenceVolume, values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(height, width, labels, n), also where one label stands for all."""
    height, width, _, components = values.shape
    return np.broadcast_to(values, (height, width, len(of.depths), components))


def _write_volume(source: DepthLikelihoodVolume | EvidenceVolume,
                  parts: Sequence[NDArray[np.float32]], names: Sequence[str],
                  buffer: Buffer | None, camera: CameraPose | None = None
                  ) -> Float32MultiArray:
    """parts: the values, apart along the last axis; they are copied once, into the message."""
    header, pinhole = source.header, source.pinhole
    shape = (*parts[0].shape[:-1], sum(each.shape[-1] for each in parts))
    intrinsics = pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy
    posed = () if camera is None else (_listed(camera.camera_to_reference), camera.frame_id)
    texts = {'height': (header.stamp_ns, header.frame_id), 'width': (*intrinsics, *posed),
             'depth': (_listed(source.depths),),
             **{name: (each,) for name, each in _COMPONENTS.items()}}
    dimensions = []
    for axis, name in enumerate(names):
        keys = _POSED if name == 'width' and camera is not None else _KEYS[name]
        pairs = zip(keys, texts[name], strict=True)
        label = ';'.join([name, *(f'{key}={value}' for key, value in pairs)])
        dimensions.append(MultiArrayDimension(label=label, size=shape[axis],
                                              stride=prod(shape[axis:])))
    padding = _padding(header, pinhole, source.depths, camera)
    message, data = (buffer or Buffer()).message(Float32MultiArray, 'f',
                                                 (len(padding) + prod(shape),), '<f4')
    message.layout = MultiArrayLayout(dim=dimensions, data_offset=len(padding))
    data[:len(padding)] = padding
    np.concatenate(parts, axis=-1, out=data[len(padding):].reshape(shape))
    return message


def _read_volume(message: Float32MultiArray, names: Sequence[str], topic: str,
                 ) -> tuple[Header, Pinhole, NDArray[np.float64], NDArray[np.float32],
                            CameraPose | None]:
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
    for name, (found,) in zip(names[3:], texts[3:], strict=True):
        wanted = _COMPONENTS[name]
        if found != wanted or shape[3] != len(wanted.split(',')):
            raise MessageError(f'{topic}: {shape[3]} components {found[:60]}, expected {wanted}')
    stamp, frame = texts[0]
    with promised_by(topic):
        header = Header(_number(int, stamp, topic), frame)
        time_to_message(header.stamp_ns)  # refuses what no ROS time can hold
        intrinsics, posed = texts[1][:4], texts[1][4:]
        pinhole = Pinhole(shape[1], shape[0], *(_number(float, text, topic)
                                                for text in intrinsics))
        camera = _camera(topic, *posed) if posed else None
    depths = _numbers(texts[2][0], topic)
    padding = _padding(header, pinhole, depths, camera)
    sizes = len(depths), offset, len(message.data)
    right = shape[2], len(padding), len(padding) + expected[0]
    if sizes != right:
        raise MessageError(
            f'{topic}: {sizes[0]} depths, data_offset {sizes[1]} and {sizes[2]} values for sizes '
            f'{list(shape)}; expected {right[0]}, {right[1]} and {right[2]}')
    data = np.frombuffer(message.data, '<f4')
    if not np.array_equal(data[:offset], padding):
        raise MessageError(f'{topic}: the numbers before data_offset are not those of the labels')
    return header, pinhole, depths, data[offset:].reshape(shape), camera


def _camera(topic: str, pose: str, frame: str) -> CameraPose:
    numbers = _numbers(pose, topic)
    if len(numbers) != 16:
        raise MessageError(f'{topic}: camera_to_reference has {len(numbers)} numbers, expected '
                           '16, row by row')
    return CameraPose(frame, numbers.reshape(4, 4))


def _padding(header: Header, pinhole: Pinhole, depths: NDArray[np.float64],
             camera: CameraPose | None) -> NDArray[np.float32]:
    words = np.frombuffer(header.stamp_ns.to_bytes(8, 'big', signed=True), '>u2')
    intrinsics = [pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy]
    pose = np.empty(0) if camera is None else camera.camera_to_reference.ravel()
    return np.concatenate([words, intrinsics, depths, pose]).astype(np.float32)


def _fields(label: str, name: str, topic: str) -> list[str]:
    """The values of a label `name;key=value;...`, of which the last may hold any text."""
    posed = topic == 'dlv' and name == 'width' and f';{_POSED[4]}=' in label
    keys = _POSED if posed else _KEYS[name]
    found, *pairs = label.split(';', len(keys))
    split = [pair.partition('=') for pair in pairs]
    if found != name or tuple(key for key, _, _ in split) != keys:
        raise MessageError(f'{topic}: dimension label {label[:60]!r}, expected '
                           f'{";".join([name, *(f"{key}=..." for key in keys)])!r}')
    return [value for _, _, value in split]


def _listed(numbers: NDArray[np.float64]) -> str:
    return ','.join(repr(float(each)) for each in numbers.ravel())


def _numbers(text: str, topic: str) -> NDArray[np.float64]:
    return np.array([_number(float, each, topic) for each in text.split(',')])


def _number(kind: type[_Number], text: str, topic: str) -> _Number:
    try:
        return kind(text)
    except ValueError:
        raise MessageError(f'{topic}: {text[:40]!r} in a dimension label is no number') from None
