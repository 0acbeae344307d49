"""`posed_views` and what belongs to them -> PosedViews."""

from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseArray
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, Image

from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.messages.camera_info import pinhole_from
from pmcl_ros.messages.header import Part, part_from
from pmcl_ros.messages.posed_views import cameras_from, mosaic_from, posed_views_from, sigmas_from
from pmcl_ros.nodes.runtime.base import BIG, SMALL, StageNode
from pmcl_ros.nodes.transport.exact_synchronizer import ExactSynchronizer
from pmcl_ros.nodes.transport.values import subscribe_value

# topic: type, what reads (and so checks) a message as it comes, quality of service
_INPUTS: dict[str, tuple[type, Callable[[Any], object], Any]] = {
    'posed_views/camera_info': (CameraInfo, pinhole_from, SMALL),
    'posed_views/poses': (PoseArray, cameras_from, SMALL),
    'posed_views/sigma': (Image, sigmas_from, SMALL),
    'posed_views': (Image, mosaic_from, BIG),
}


def subscribe_posed_views(node: StageNode, callback: Callable[[PosedViews], None]
                          ) -> list[Subscription]:
    """Subscribe to posed views, for `start` of a node. callback: gets them, once a stamp."""
    matching = ExactSynchronizer(list(_INPUTS), SMALL.depth, node.dropped)

    def on_part(topic: str, part: PosedViews | Part) -> None:
        if isinstance(part, PosedViews):  # by reference, on each of the topics
            if topic == 'posed_views':
                callback(part)
        elif complete := matching.add(topic, part.header.stamp_ns, part.message):
            callback(posed_views_from(*complete))

    return [subscribe_value(node, kind, topic, part_from(check), partial(on_part, topic), qos,
                            each_a_capture=topic == 'posed_views', announced=True)
            for topic, (kind, check, qos) in _INPUTS.items()]
