"""Outputs of pmcl_node for other pipelines, where the packages of their messages are installed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from rclpy.lifecycle import LifecyclePublisher

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.optional.collision_object import CollisionObjects
from pmcl_ros.messages.optional.detection import estimates_to_detections
from pmcl_ros.messages.types import message_class
from pmcl_ros.nodes.graph import COLLISION_OBJECT, DETECTIONS, TopicEntry
from pmcl_ros.nodes.pmcl_settings import PmclNodeSettings
from pmcl_ros.nodes.runtime.base import SMALL, StageNode
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import BagError, SettingsError


class OptionalOutputs:
    """Publishes `detections` and `collision_object`, for `set_up` of a node.

    names: distinct, of the models. in_scene: as `there` of `CollisionObjects`, for as long as the
    node lives: the planning scene outlives a configuration. Raises SettingsError where one is
    always to be published and its package is not installed.
    """

    def __init__(self, node: StageNode, settings: PmclNodeSettings, names: Sequence[str],
                 models: Sequence[ObjectModel], in_scene: dict[str, Header]) -> None:
        self._names, self._models, self._fixed = names, models, settings.track_frame
        self._detections = _publisher(node, DETECTIONS, settings.detections)
        self._collisions = _publisher(node, COLLISION_OBJECT, settings.collision_object)
        if self._collisions is not None:
            self._scene = CollisionObjects(message_class, names, models, in_scene)

    def publish(self, estimates: Sequence[PoseEstimate],
                camera: NDArray[np.float64] | None = None) -> None:
        """Publish what was found in one capture to whoever listens.

        camera: (4, 4) pose of the estimates' frame in track_frame [m] at the capture. With it
        collision objects are in track_frame, as MoveIt asks TF for its own moment, not for that
        of the capture; None: not known.
        """
        if self._detections is not None and self._detections.get_subscription_count():
            self._detections.publish(estimates_to_detections(
                message_class, self._names, self._models, estimates))
        if self._collisions is not None and self._collisions.get_subscription_count():
            placed = estimates if camera is None else [
                replace(each, header=replace(each.header, frame_id=self._fixed),
                        pose=camera @ each.pose) for each in estimates]
            for each in self._scene.update(placed):
                self._collisions.publish(each)

    def clear(self) -> None:
        """Remove the objects from the planning scene."""
        if self._collisions is not None:
            for each in self._scene.clear():
                self._collisions.publish(each)


def _publisher(node: StageNode, topic: TopicEntry, wanted: str) -> LifecyclePublisher | None:
    """None where it is not wanted, or its package is missing."""
    if wanted == 'never':
        return None
    try:
        kind = message_class(topic.type)
    except BagError as error:
        if wanted == 'always':
            raise SettingsError(f"parameter {topic.name!r} is 'always', but {error}") from None
        node.get_logger().debug(f'no {topic.name}: {error}')
        return None
    return node.publisher(kind, topic.name, SMALL)
