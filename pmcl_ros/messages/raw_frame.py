"""RawFrame: `metadata` and `image_raw`."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.messages.header import header_from, promised_by
from pmcl_ros.messages.image import image_message, pixels_of
from pmcl_ros.messages.types import Buffer, Image, String


class RawMessages(NamedTuple):
    """`metadata` and `image_raw`, in the order in which they are published."""

    metadata: String
    image: Image


def raw_frame_to_messages(frame: RawFrame, buffer: Buffer | None = None) -> RawMessages:
    """The camera's JSON, and its own counts 0..4095 (not shifted to 16 bits) as bayer_bggr16."""
    message, pixels = image_message(frame.header, 'bayer_bggr16', frame.counts.shape, buffer)
    pixels[:] = frame.counts
    return RawMessages(String(data=frame.metadata.text), message)


def metadata_from(message: String) -> CameraMetadata:
    """The camera's JSON, parsed."""
    with promised_by('metadata'):
        return CameraMetadata.parse(message.data)


def counts_from(image: Image) -> NDArray[np.uint16]:
    """(height, width) counts of an `image_raw` message, its own memory."""
    return pixels_of(image, 'bayer_bggr16', 'image_raw')


def raw_frame_from(image: Image, metadata: CameraMetadata) -> RawFrame:
    """The inverse of `raw_frame_to_messages`; the counts are the message's own memory."""
    with promised_by('image_raw'):
        return RawFrame(header_from(image.header), counts_from(image), metadata)
