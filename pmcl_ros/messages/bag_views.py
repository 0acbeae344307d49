"""A robot's bag of images and camera poses -> PosedViews, as `sweep_driver` collects them."""

import logging
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pose_buffer import MovingPose, PoseBuffer
from pmcl_ros.geometry.se3 import transform
from pmcl_ros.geometry.transform_tree import TransformTree
from pmcl_ros.lightfield.masks import read_mask
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.readers.pictures import full_range
from pmcl_ros.lightfield.sweep.frame import Lens, SweepFrame
from pmcl_ros.lightfield.sweep.settings import SweepDriverSettings, check_mounted
from pmcl_ros.lightfield.sweep.view_collection import ViewCollection
from pmcl_ros.messages.bags import Recorded, Topic, message_of, read, topics
from pmcl_ros.messages.camera_info import lens_from
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.image import colours_from, decompressed_from
from pmcl_ros.messages.pose import pose_from, transform_from
from pmcl_ros.runtime.errors import (
    BagError,
    LightFieldError,
    MessageError,
    PmclError,
    PoseUnavailableError,
    told_as,
)
from pmcl_ros.runtime.resources import resolve

_LOG = logging.getLogger(__name__)
_IMAGE, _COMPRESSED = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage'
_INFO, _POSE = 'sensor_msgs/msg/CameraInfo', 'geometry_msgs/msg/PoseStamped'
_TRANSFORMS = 'tf2_msgs/msg/TFMessage'
_TF, _TF_STATIC = '/tf', '/tf_static'
_VALUES = 'ros__parameters'  # of a section of a parameter file
_OWN = '/**', '/**/sweep_driver'  # sections that count here, the last most
_CAMERA = 'camera on mount_parent'  # its name among the frames of /tf
_Poses = Callable[[Header], MovingPose | None]  # of the camera when an image was taken
# Words in names of topics.
_OF_ARM = {'arm', 'ee', 'eef', 'effector', 'flange', 'gripper', 'hand', 'tcp', 'tool', 'wrist'}
_OF_CAMERA = {'cam', 'camera', 'eye', 'optical'}
_APART = 1_000_000_000  # ns: recordings of images and poses begin and end together, nearly


class BagViews(SweepDriverSettings):
    """The parameters of `sweep_driver` that make posed views, and the topics of the bag."""

    image_topic: str = Field('', description='topic of the images, plain or compressed, with '
                             'camera_info beside it; empty: the only one, or the one called image')
    pose_topic: str = Field('', description='topic of the camera poses, PoseStamped or /tf; '
                            'empty: the only one, or the one called camera_pose')

    @model_validator(mode='before')
    @classmethod
    def _without_sections(cls, values: Any) -> Any:
        """The values of a parameter file for sweep_driver, as `pmcl handeye` writes one."""
        if not isinstance(values, dict):
            return values
        rest: dict[str, Any] = dict(values)
        own: dict[str, Any] = {}
        for name in _OWN:
            section = rest.get(name)
            if isinstance(section, dict) and isinstance(section.get(_VALUES), dict):
                own |= rest.pop(name)[_VALUES]
        if own:
            rest.pop('/**/grasp_node', None)
        return own | rest


def has_images_with_poses(bag: Path | str) -> bool:
    """Whether a bag has topics of images and of poses of a camera."""
    there = topics(bag)
    return bool(_images(there) and _pose_topics(there))


def read_views(bag: Path | str, settings: BagViews) -> PosedViews:
    """A view of each place where the camera came to rest, in the frame of the poses.

    The log says whose poses are taken for the camera's, a warning if they seem to be an arm's; and
    which frames were left out or are blurred views, a warning if it is not motion alone. Raises
    BagError where topics are missing or hold what they should not, and where there is no view.
    """
    there = topics(bag)
    image = _chosen(bag, settings.image_topic, _images(there), 'image', '--image-topic')
    info = _info_beside(image)
    if not any(each[:2] == (info, _INFO) and each.messages for each in there):
        raise BagError(f'{bag} has no {info} (CameraInfo) beside {image}: record it too')
    pose = _chosen(bag, settings.pose_topic, _pose_topics(there), 'camera_pose', '--pose-topic')
    _tell_poses(bag, pose, settings)
    with told_as(BagError, PmclError, name=bag):
        frame, poses, posed = (_tf(bag, settings) if pose == _TF
                               else _stamped(bag, pose, settings))
        mask = read_mask(resolve(settings.mask, 'mask')) if settings.mask else None
        collection = ViewCollection(settings, frame, mask=mask)
        taken = _collect(bag, image, info, poses, collection, settings)
        if not collection.frames:
            _check_clocks(taken, posed)
        found = collection.assemble()
    if found.left_out or found.blurred:
        usual = not found.blurred and all(each.spare or each.moved for each in found.left_out)
        _LOG.log(logging.INFO if usual else logging.WARNING, '%s: %s', bag, found.describe())
    return found.source


def _tell_poses(bag: Path | str, topic: str, settings: BagViews) -> None:
    """Log whose poses are taken for the camera's; a warning if they seem to be an arm's."""
    words = {*re.findall('[a-z]+', topic.lower())}
    placed = any((*settings.mount_position, *settings.mount_rpy))
    if words & _OF_ARM and not words & _OF_CAMERA and not placed:
        _LOG.warning("%s: the poses of %s are taken for the camera's optical frame: are they of "
                     'the arm? Then give the hand-eye transform, mount_position and mount_rpy '
                     '(--collect)', bag, topic)
    else:
        _LOG.info('%s: camera poses by %s', bag, topic)


def _check_clocks(taken: Sequence[int], posed: Sequence[int]) -> None:
    """Raise LightFieldError where stamps of images and of poses [ns] are of different times."""
    if taken and posed and min(taken) > 0 and (
            max(taken) + _APART < min(posed) or max(posed) + _APART < min(taken)):
        raise LightFieldError(
            f'the clocks of images and poses differ by {abs(min(posed) - min(taken)) / 1e9:.0f} '
            's: no pose is of the time of an image; stamp both by one clock and record again')


def _collect(bag: Path | str, image: str, info: str, poses: _Poses, collection: ViewCollection,
             settings: BagViews) -> list[int]:
    """Fill the collection; returns the stamps of the images [ns]."""
    stamps: list[int] = []
    first = next(read(bag, (info,)), None)
    if first is None:
        raise MessageError(f'there is no message of {info}: the bag is damaged')
    lens = _lens(first, settings)
    for each in read(bag, (image, info)):
        if each.topic == info:
            lens = _lens(each, settings)
            continue
        message = message_of(each, _IMAGE if each.type == _IMAGE else _COMPRESSED)
        header = header_from(message.header)
        stamps.append(header.stamp_ns)
        name = f'frame {len(stamps)}'
        try:
            moving = poses(header)
        except PoseUnavailableError as error:
            collection.leave_out(name, str(error))
            continue
        if moving is None:
            collection.leave_out(name, 'no pose of its time, or later, is there')
            continue
        if isinstance(lens, str):
            collection.leave_out(name, lens)
            continue
        try:
            pixels = (colours_from if each.type == _IMAGE else decompressed_from)(message)
            frame = SweepFrame(name, header.stamp_ns, full_range(pixels, settings.bits), lens,
                               moving.pose, moving.speed, moving.angular_speed)
        except PmclError as error:
            collection.leave_out(name, str(error))
            continue
        try:
            collection.add(frame)
        except LightFieldError as error:  # no room: what is there is enough to go on with
            _LOG.warning('%s: %s; the views before it are taken', bag, error)
            break
    return stamps


def _lens(info: Recorded, settings: BagViews) -> Lens | str:
    """What a message of camera_info tells, or why it tells nothing."""
    try:
        return lens_from(message_of(info, _INFO), settings.rectified)
    except MessageError as error:
        return str(error)


def _stamped(bag: Path | str, topic: str, settings: BagViews
             ) -> tuple[str, _Poses, list[int]]:
    """The frame of a topic of PoseStamped, its poses, those of the camera by its mount, and their
    stamps [ns].
    """
    mount = transform(settings.mount_position, settings.mount_rpy)
    buffer, stamps = PoseBuffer(None), []
    frame = settings.fixed_frame if 'fixed_frame' in settings.model_fields_set else ''
    for each in read(bag, (topic,)):
        header, pose = pose_from(message_of(each, _POSE))
        frame = frame or header.frame_id
        if header.frame_id != frame:
            raise LightFieldError(f'{topic} is in frame {header.frame_id!r} at {header.stamp_ns}, '
                                  f'expected {frame!r}: give all poses in one frame')
        buffer.add(header.stamp_ns, pose @ mount)
        stamps.append(header.stamp_ns)
    return frame, lambda header: buffer.interpolated(header.stamp_ns, settings.gap), stamps


def _tf(bag: Path | str, settings: BagViews) -> tuple[str, _Poses, list[int]]:
    """The fixed frame, the poses of the camera in it, from /tf and /tf_static, and the stamps of
    what moves [ns].
    """
    mount = transform(settings.mount_position, settings.mount_rpy)
    tree, stamps = TransformTree(), []
    for each in read(bag, (_TF, _TF_STATIC)):
        for one in message_of(each, _TRANSFORMS).transforms:
            header, child, pose = transform_from(one)
            fixed = each.topic == _TF_STATIC
            tree.add(header.frame_id, child, pose, None if fixed else header.stamp_ns)
            stamps += [] if fixed else [header.stamp_ns]
    if settings.mount_parent:
        tree.add(settings.mount_parent, _CAMERA, mount)
    else:
        check_mounted(mount)

    def at(header: Header) -> MovingPose | None:
        camera = _CAMERA if settings.mount_parent else settings.camera_frame or header.frame_id
        return tree.interpolated(header.stamp_ns, settings.fixed_frame, camera, settings.gap)
    return settings.fixed_frame, at, stamps


def _images(there: Sequence[Topic]) -> list[str]:
    """Topics of images; of an image that is there also compressed, the plain one."""
    plain = [each.name for each in there if each.type == _IMAGE and each.messages]
    return plain + [each.name for each in there if each.type == _COMPRESSED and each.messages
                    and each.name.rpartition('/')[0] not in plain]


def _pose_topics(there: Sequence[Topic]) -> list[str]:
    return [each.name for each in there if each.messages
            and (each.type == _POSE or each.name == _TF)]


def _info_beside(image: str) -> str:
    """The name of camera_info: beside the image, whatever transport it came by."""
    return f'{image.removesuffix("/compressed").rpartition("/")[0]}/camera_info'


def _chosen(bag: Path | str, wanted: str, names: Sequence[str], usual: str, option: str) -> str:
    """The topic that is wanted, else the only one, else the one of the usual name."""
    if wanted and wanted not in names:
        raise BagError(f'{bag} has no {wanted} of this kind; it has {", ".join(names) or "none"}')
    called = [wanted] if wanted else [each for each in names if each.split('/')[-1] == usual]
    for only in (names, called):
        if len(set(only)) == 1:
            return only[0]
    raise BagError(f'{bag} has {", ".join(names) or "no topic"} for {usual}: choose one '
                   f'({option})')
