"""Outputs of pmcl_node for several objects: a pose topic of each, the list of all."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.lifecycle import LifecyclePublisher
from visualization_msgs.msg import Marker, MarkerArray

from pmcl_ros.drawing.pictures import outlines
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.messages.marker import (
    mesh_to_marker,
    objects_to_markers,
    place_markers,
    region_to_marker,
)
from pmcl_ros.messages.pose import estimate_to_messages
from pmcl_ros.nodes.object_frame import ObjectFrame, PmclNodeSettings
from pmcl_ros.nodes.overlays import Overlays
from pmcl_ros.nodes.runtime.base import LATCHED, SMALL, StageNode
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_object.scene_localizer import (
    SceneEstimate,
    SceneLocalizer,
    distinct_names,
)
from pmcl_ros.pmcl.object_model import ObjectModel, mesh_file
from pmcl_ros.pmcl.region import Region
from pmcl_ros.runtime.resources import resolve


class ObjectList:
    """The latched list of what is looked for: where each was in the last capture, or lost.

    For `set_up` of a node. paths: of each object's mesh or YAML.
    """

    def __init__(self, node: StageNode, paths: Sequence[Path]) -> None:
        self._meshes = [mesh_file(each) for each in paths]
        self._publisher = node.publisher(MarkerArray, 'objects', LATCHED)

    def publish(self, names: Sequence[str], estimates: Sequence[PoseEstimate]) -> None:
        """Publish the list of one capture, in the order of the paths."""
        self._publisher.publish(objects_to_markers(names, self._meshes, estimates))


class SeveralObjects:
    """The objects that are looked for together.

    For `set_up` of a node. Raises what loading them raises, and LocalizationError where two would
    have one name.
    """

    def __init__(self, node: StageNode, settings: PmclNodeSettings, overlays: Overlays,
                 markers: LifecyclePublisher) -> None:
        self._node, self._settings, self._overlays = node, settings, overlays
        self._markers = markers
        paths = [resolve(each, 'objects') for each in settings.several]
        distinct = {path: ObjectModel.load(path) for path in dict.fromkeys(paths)}
        self._models = [distinct[path] for path in paths]
        self.names = distinct_names([each.name for each in self._models], paths)
        self._list = ObjectList(node, paths)
        self._poses = [(node.publisher(PoseStamped, f'objects/{name}/pose', SMALL),
                        node.publisher(PoseWithCovarianceStamped,
                                       f'objects/{name}/pose_with_covariance', SMALL))
                       for name in self.names]
        self._frames = [ObjectFrame(node, name) for name in self.names
                        ] if settings.broadcast_tf else []
        self._meshes: list[Marker] = []  # made when somebody wants them
        self._box = region_to_marker(Region(settings.roi_center, settings.roi_size))

    def localizer(self) -> SceneLocalizer:
        """Finds them; for the thread that uses it."""
        return SceneLocalizer(self._models, self._settings)

    def publish(self, scene: SceneEstimate, header: Header, pinhole: Pinhole, latency: float
                ) -> None:
        """Publish where they are in one capture; pinhole: of its evidence."""
        health, stamp = self._node.health, header.stamp_ns
        health.extra = {'objects': len(self.names),
                        'interpenetration [mm]': f'{1e3 * scene.depth:.1f}'}
        for k, (name, each) in enumerate(zip(self.names, scene.estimates, strict=True)):
            health.extra[name] = 'lost' if each.lost else f'score {each.score:.0f}'
            if each.lost:
                continue
            for publisher, message in zip(self._poses[k], estimate_to_messages(each),
                                          strict=False):
                publisher.publish(message)
            if self._frames:
                self._frames[k].broadcast(each)
        self._list.publish(self.names, scene.estimates)
        there = [(model, each.pose, name) for model, each, name
                 in zip(self._models, scene.estimates, self.names, strict=True) if not each.lost]
        self._overlays.publish(header, pinhole,
                               lambda picture, camera: outlines(picture, camera, there))
        if self._markers.get_subscription_count():
            self._meshes = self._meshes or [
                mesh_to_marker(replace(model, name=name))
                for model, name in zip(self._models, self.names, strict=True)]
            both = zip(self._meshes, scene.estimates, strict=True)
            placed = [place_markers(mesh, self._box, each) for mesh, each in both]
            self._markers.publish(MarkerArray(markers=[
                self._box, *(marker for each in placed for marker in each.markers[1:])]))
        self._report(scene, stamp, latency)

    def _report(self, scene: SceneEstimate, stamp: int, latency: float) -> None:
        lost = [name for name, each in zip(self.names, scene.estimates, strict=True) if each.lost]
        found = [name for name in self.names if name not in lost]
        text = f'found {" and ".join(found)}' if found else 'found nothing'
        if lost:
            self._node.health.count('captures with one lost')
            text += f'; lost: {" and ".join(lost)}'
        if found:
            self._node.done(latency, f'{text} in capture {stamp}')
        if lost:
            self._node.health.warn(f'{text} in capture {stamp}')
            self._node.get_logger().warning(self._node.health.message)
        self._node.publish_diagnostics()
