"""Captures in bags: the messages that the nodes would publish, written and read without ROS."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Qos

from pmcl_ros.camera.files import read_raw_frame, write_raw_frame
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.messages.bag_views import BagViews, has_images_with_poses, read_views
from pmcl_ros.messages.bags import LATCHED, VOLATILE, Recorded, message_of, read, record, topics
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.cdr import cdr_from, type_name
from pmcl_ros.messages.header import header_from, header_to_message
from pmcl_ros.messages.image import picture_to_message
from pmcl_ros.messages.light_field import light_field_from, light_field_to_messages
from pmcl_ros.messages.pose import pose_to_message
from pmcl_ros.messages.posed_views import posed_views_from, posed_views_to_messages
from pmcl_ros.messages.raw_frame import (
    metadata_from,
    raw_frame_from,
    raw_frame_to_messages,
)
from pmcl_ros.messages.types import PoseStamped
from pmcl_ros.runtime.errors import BagError, MessageError, told_as

_IMAGE, _INFO = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/CameraInfo'
# Topics and their types
_RAW = {'/metadata': 'std_msgs/msg/String', '/image_raw': _IMAGE}
_VIEWS = {'/views/camera_info': _INFO, '/views/pupil': _IMAGE, '/views': _IMAGE}
_POSED = {'/posed_views/camera_info': _INFO, '/posed_views/poses': 'geometry_msgs/msg/PoseArray',
          '/posed_views/sigma': _IMAGE, '/posed_views': _IMAGE}


def read_bag(bag: Path | str, wanted: BagViews | None = None
             ) -> RawFrame | LightField | PosedViews:
    """The first complete capture of a bag, as `pmcl bag record` writes it, or a robot's pictures.

    The raw picture where there is one, else the views, else the posed views, the last of them, as
    each that `sweep_driver` publishes has one view more; else images with poses (`read_views`).
    wanted: that these are meant, and how they become posed views.
    Raises BagError where there is none of these, or a message is not what its topic promises.
    """
    if wanted is not None:
        return read_views(bag, wanted)
    there = {each.name for each in topics(bag) if each.messages}
    with told_as(BagError, MessageError, name=bag):
        if there.issuperset(_RAW):
            text, image = _first_raw(bag)
            return raw_frame_from(image, metadata_from(text))
        if there.issuperset(_VIEWS):
            return light_field_from(*_of_one_stamp(bag, _VIEWS, last=False))
        if there.issuperset(_POSED):
            return posed_views_from(*_of_one_stamp(bag, _POSED, last=True))
    if has_images_with_poses(bag):
        return read_views(bag, BagViews())
    raise BagError(f'{bag} holds neither {" with ".join(reversed(_RAW))} nor {", ".join(_VIEWS)} '
                   f'nor {", ".join(_POSED)}: it takes the picture or its views; nor images with '
                   'poses of their camera (PoseStamped or /tf)')


def _first_raw(bag: Path | str) -> list[Any]:
    """The first picture, and the last metadata before it, else the first after it."""
    text, image = _RAW
    found: dict[str, Any] = {}
    for each in read(bag, _RAW):
        if each.topic == text or image not in found:
            found[each.topic] = message_of(each, _RAW[each.topic])
        if len(found) == len(_RAW):
            break
    return _all_of(found, _RAW)


def _of_one_stamp(bag: Path | str, names: dict[str, str], last: bool) -> list[Any]:
    """The messages of the first or last capture that has all; else the last of each topic.

    names: of the topics, with their types.
    """
    now: dict[str, Any] = {}
    complete: dict[str, Any] = {}
    for each in read(bag, names):
        now[each.topic] = message_of(each, names[each.topic])
        if len({header_from(now[name].header) for name in now}) == 1 and len(now) == len(names):
            complete = dict(now)
            if not last:
                break
    return _all_of(complete or now, names)


def _all_of(found: dict[str, Any], names: dict[str, str]) -> list[Any]:
    missing = [name for name in names if name not in found]
    if missing:  # the summary of the bag says something else
        raise MessageError(f'there is no message of {", ".join(missing)}: the bag is damaged')
    return [found[name] for name in names]


def record_capture(picture: Path | str, bag: Path | str) -> None:
    """Make a bag of `/metadata` and `/image_raw` from a raw picture and its .TXT."""
    record(bag, capture_messages(read_raw_frame(picture)))


def capture_messages(frame: RawFrame) -> list[Recorded]:
    """The messages that `lytro_driver` publishes for a raw frame, in its order."""
    metadata, image = raw_frame_to_messages(frame)
    return [_recorded('/metadata', metadata, frame.header, LATCHED),
            _recorded('/image_raw', image, frame.header)]


def extract_captures(bag: Path | str, folder: Path | str, force: bool = False
                     ) -> list[Path]:
    """Write each picture of a bag as the camera has it, RAW and TXT; their paths.

    The inverse of `record_capture`, for every `/image_raw` with the `/metadata` before it. Raises
    BagError when there is none, or when one is not what a camera writes, OutputError when another
    file of such a name is there already, unless `force`.
    """
    metadata: CameraMetadata | None = None
    paths: list[Path] = []
    with told_as(BagError, MessageError, name=bag):
        for each in read(bag, _RAW):
            message = message_of(each, _RAW[each.topic])
            if each.topic == '/metadata':
                metadata = metadata_from(message)
            elif metadata is not None:
                frame = raw_frame_from(message, metadata)
                paths.append(Path(folder) / f'IMG_{len(paths) + 1:04d}.RAW')
                write_raw_frame(paths[-1], frame, force)
    if not paths:
        raise BagError(f'{bag} holds no /image_raw with /metadata before it')
    return paths


def record_light_field(light_field: LightField, bag: Path | str) -> None:
    """Make a bag of `/views`, `/center/image` and what belongs to them."""
    record(bag, light_field_messages(light_field))


def light_field_messages(light_field: LightField) -> list[Recorded]:
    """The messages that `subaperture_node` publishes for a light field, in its order."""
    header = light_field.header
    info, pupil, views = light_field_to_messages(light_field)
    return [_recorded('/center/camera_info', pinhole_to_message(header, light_field.grid.pinhole),
                      header),
            _recorded('/center/image', picture_to_message(header, light_field.picture()), header),
            _recorded('/views/camera_info', info, header),
            _recorded('/views/pupil', pupil, header),
            _recorded('/views', views, header)]


def record_posed_views(views: PosedViews, bag: Path | str) -> None:
    """Make a bag of `/posed_views` and what belongs to it."""
    record(bag, posed_views_messages(views))


def posed_views_messages(views: PosedViews) -> list[Recorded]:
    """The messages that `sweep_driver` publishes for posed views, in its order."""
    return [_recorded(topic, message, views.header)
            for topic, message in zip(_POSED, posed_views_to_messages(views), strict=True)]


def pose_message(topic: str, header: Header, pose: NDArray[np.float64]) -> Recorded:
    """A PoseStamped of a pose (4, 4) in the header's frame."""
    message = PoseStamped(header=header_to_message(header), pose=pose_to_message(pose))
    return _recorded(topic, message, header)


def _recorded(topic: str, message: Any, header: Header, qos: Qos = VOLATILE) -> Recorded:
    return Recorded(topic, type_name(type(message)), header.stamp_ns, cdr_from(message), qos)
