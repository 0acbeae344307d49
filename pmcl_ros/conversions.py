"""The only place that knows how this package's values lie in ROS messages.

Writers take an optional `Buffer`, the publisher's own, and fill it in place: the message that they
return holds until the next is written to the same buffer. Readers check all that a topic promises,
raise MessageError with what is wrong, the values and the remedy, and never copy big fields.
"""

from pmcl_ros.messages.buffer import Buffer
from pmcl_ros.messages.camera_info import baseline_from, pinhole_from, pinhole_to_message
from pmcl_ros.messages.cdr import message_from, multi_array_from
from pmcl_ros.messages.diagnostics import diagnostics_to_message
from pmcl_ros.messages.header import (
    Part,
    header_from,
    header_to_message,
    part_from,
    time_to_message,
)
from pmcl_ros.messages.image import (
    depth_from,
    depth_to_message,
    picture_from,
    picture_to_message,
)
from pmcl_ros.messages.light_field import (
    LightFieldMessages,
    light_field_from,
    light_field_to_messages,
    mosaic_from,
    pupil_from,
    pupil_to_message,
    views_to_message,
)
from pmcl_ros.messages.marker import (
    mesh_to_marker,
    no_markers,
    objects_to_markers,
    place_markers,
    region_to_marker,
)
from pmcl_ros.messages.pose import (
    PoseMessages,
    estimate_to_messages,
    estimate_to_transform,
    particles_from,
    pose_from,
    pose_with_covariance_from,
)
from pmcl_ros.messages.raw_frame import (
    RawMessages,
    counts_from,
    metadata_from,
    raw_frame_from,
    raw_frame_to_messages,
)
from pmcl_ros.messages.volume import (
    edges_from,
    edges_to_message,
    volume_from,
    volume_to_message,
    with_edges,
)

__all__ = [
    'Buffer',
    'LightFieldMessages',
    'Part',
    'PoseMessages',
    'RawMessages',
    'baseline_from',
    'counts_from',
    'depth_from',
    'depth_to_message',
    'diagnostics_to_message',
    'edges_from',
    'edges_to_message',
    'estimate_to_messages',
    'estimate_to_transform',
    'header_from',
    'header_to_message',
    'light_field_from',
    'light_field_to_messages',
    'mesh_to_marker',
    'message_from',
    'metadata_from',
    'mosaic_from',
    'multi_array_from',
    'no_markers',
    'objects_to_markers',
    'part_from',
    'particles_from',
    'picture_from',
    'picture_to_message',
    'pinhole_from',
    'pinhole_to_message',
    'place_markers',
    'pose_from',
    'pose_with_covariance_from',
    'pupil_from',
    'pupil_to_message',
    'raw_frame_from',
    'raw_frame_to_messages',
    'region_to_marker',
    'time_to_message',
    'views_to_message',
    'volume_from',
    'volume_to_message',
    'with_edges',
]
