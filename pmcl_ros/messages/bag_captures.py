"""Captures in bags: the messages that the nodes would publish, written and read without ROS."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Qos

from pmcl_ros.camera.files import read_raw_frame, write_picture
from pmcl_ros.camera.packing import pack12
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.messages.bags import LATCHED, VOLATILE, Recorded, read, record
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.cdr import cdr_from, message_from, type_name
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.image import picture_to_message
from pmcl_ros.messages.light_field import light_field_from, light_field_to_messages
from pmcl_ros.messages.pose import pose_to_message
from pmcl_ros.messages.raw_frame import (
    counts_from,
    metadata_from,
    raw_frame_from,
    raw_frame_to_messages,
)
from pmcl_ros.messages.types import PoseStamped
from pmcl_ros.runtime.errors import BagError, MessageError

_RAW = ('/metadata', '/image_raw')
_VIEWS = ('/views/camera_info', '/views/pupil', '/views')


def read_bag(bag: Path | str) -> RawFrame | LightField:
    """The first complete capture of a bag, as `pmcl bag record` writes it.

    The raw picture where there is one, else the views.
    Raises BagError where there is neither, or a message is not what its topic promises.
    """
    messages: dict[str, Any] = {}
    try:
        for each in read(bag):
            if each.topic in (*_RAW, *_VIEWS):
                messages.setdefault(each.topic, message_from(each.cdr, each.type))
            if all(topic in messages for topic in _RAW):
                text, image = (messages[topic] for topic in _RAW)
                return raw_frame_from(image, metadata_from(text))
        if all(topic in messages for topic in _VIEWS):
            return light_field_from(*(messages[topic] for topic in _VIEWS))
    except MessageError as error:
        raise BagError(f'{bag}: {error}') from None
    raise BagError(f'{bag} holds neither {" with ".join(reversed(_RAW))} nor '
                   f'{", ".join(_VIEWS)}: it takes the picture or its views')


def record_capture(picture: Path | str, bag: Path | str, header: Header | None = None) -> None:
    """Make a bag of `/metadata` and `/image_raw` from a raw picture and its .TXT."""
    record(bag, capture_messages(read_raw_frame(picture, header)))


def capture_messages(frame: RawFrame) -> list[Recorded]:
    """The messages that `lytro_driver` publishes for a raw frame, in its order."""
    metadata, image = raw_frame_to_messages(frame)
    return [_recorded('/metadata', metadata, frame.header, LATCHED),
            _recorded('/image_raw', image, frame.header)]


def extract_captures(bag: Path | str, folder: Path | str) -> list[Path]:
    """Write each picture of a bag as the camera has it, RAW and TXT; their paths.

    The inverse of `record_capture`, for every `/image_raw` with the `/metadata` before it. Raises
    BagError when there is none, or a picture of that name is there already.
    """
    text = ''
    paths: list[Path] = []
    for each in read(bag, _RAW):
        message = message_from(each.cdr, each.type)
        if each.topic == '/metadata':
            text = message.data
        elif text:
            paths.append(Path(folder) / f'IMG_{len(paths) + 1:04d}.RAW')
            if paths[-1].exists():
                raise BagError(f'{paths[-1]} is already there; choose another folder')
            write_picture(paths[-1], pack12(counts_from(message)), text)
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


def pose_message(topic: str, header: Header, pose: NDArray[np.float64]) -> Recorded:
    """A PoseStamped of a pose (4, 4) in the header's frame."""
    message = PoseStamped(header=header_to_message(header), pose=pose_to_message(pose))
    return _recorded(topic, message, header)


def _recorded(topic: str, message: Any, header: Header, qos: Qos = VOLATILE) -> Recorded:
    return Recorded(topic, type_name(type(message)), header.stamp_ns, cdr_from(message), qos)
