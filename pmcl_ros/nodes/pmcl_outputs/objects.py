"""SceneEstimate -> poses, overlay, markers, `objects`, /tf and /diagnostics of what is sought."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from rclpy.lifecycle import LifecyclePublisher
from visualization_msgs.msg import Marker, MarkerArray

from pmcl_ros.drawing.pictures import outlines, overlay
from pmcl_ros.drawing.view_overlay import outlines_in_view, overlay_in_view
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.messages.marker import (
    mesh_to_marker,
    objects_to_markers,
    place_markers,
    region_to_marker,
)
from pmcl_ros.messages.pose import estimate_to_messages
from pmcl_ros.nodes.pmcl_outputs.object_frame import ObjectFrame
from pmcl_ros.nodes.pmcl_outputs.overlays import Overlays
from pmcl_ros.nodes.pmcl_settings import PmclNodeSettings
from pmcl_ros.nodes.runtime.base import LATCHED, SMALL, StageNode
from pmcl_ros.pipeline import AnyLocalizer, Evidence, make_localizer, make_scene_localizer
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_object.scene_estimate import SceneEstimate, distinct_names
from pmcl_ros.pmcl.multi_view.next_view import position_sigma
from pmcl_ros.pmcl.object_model import ObjectModel, mesh_file
from pmcl_ros.pmcl.prior.region import Box
from pmcl_ros.pmcl.render.sunken import as_it_appears
from pmcl_ros.pmcl.tracking.tracker import PREDICTED
from pmcl_ros.runtime.resources import resolve


class ObjectList:
    """The latched list of the objects: where each was in the last capture, or lost.

    For `set_up` of a node. paths: of each object's mesh or YAML.
    """

    def __init__(self, node: StageNode, paths: Sequence[Path]) -> None:
        self._meshes = [mesh_file(each) for each in paths]
        self._publisher = node.publisher(MarkerArray, 'objects', LATCHED)

    def publish(self, names: Sequence[str], estimates: Sequence[PoseEstimate]) -> None:
        """Publish the list of one capture, in the order of the paths."""
        self._publisher.publish(objects_to_markers(names, self._meshes, estimates))


class OneObject:
    """The object of a search: its model, and its topics.

    For `set_up` of a node. names, models, frames: of one element; no frame where none is
    broadcast. box: the region that is searched, as a marker. Raises what loading the model raises.
    """

    def __init__(self, node: StageNode, settings: PmclNodeSettings, overlays: Overlays,
                 markers: LifecyclePublisher) -> None:
        self._node, self._settings = node, settings
        self._overlays, self._markers = overlays, markers
        path = resolve(settings.object, 'object')
        self._model = ObjectModel.load(path)
        self.models, self.names = [self._model], [self._model.name]
        self.frames = ([ObjectFrame(node, settings.object_frame or self._model.name)]
                       if settings.broadcast_tf else [])
        self._poses = [node.publisher(PoseStamped, 'pose', SMALL),
                       node.publisher(PoseWithCovarianceStamped, 'pose_with_covariance', SMALL),
                       node.publisher(PoseArray, 'particles', SMALL)]
        self._list = ObjectList(node, [path])
        self._mesh: Marker | None = None  # made for the first subscriber
        self.box = region_to_marker(Box(settings.roi_center, settings.roi_size))

    def localizer(self, settings: PmclNodeSettings) -> AnyLocalizer[PoseEstimate]:
        """What finds it; call it on the thread that uses it."""
        return make_localizer(self._model, settings, settings.source == 'posed_views')

    def publish(self, scene: SceneEstimate, given: Evidence | PosedViews, latency: float,
                search: dict[str, object]) -> None:
        """Publish the estimate of one capture, the only one of the scene.

        latency: since the capture came [s]. search: the values that tell the search from others
        on /diagnostics.
        """
        estimate, = scene.estimates
        for frame in self.frames:
            frame.broadcast(estimate)
        if not estimate.lost:
            for publisher, message in zip(self._poses, estimate_to_messages(estimate),
                                          strict=True):
                publisher.publish(message)
            self._draw(estimate, given)
        self._report(estimate, given, latency, search)
        self._list.publish(self.names, scene.estimates)
        if self._markers.get_subscription_count():
            self._mesh = self._mesh or mesh_to_marker(self._model)
            self._markers.publish(place_markers(self._mesh, self.box, estimate))
        self._node.publish_diagnostics()

    def _draw(self, estimate: PoseEstimate, given: Evidence | PosedViews) -> None:
        model, pose, interface = self._model, estimate.pose, self._settings.interface
        if isinstance(given, PosedViews):
            self._overlays.publish_views(given, lambda view: overlay_in_view(
                view, model, pose, interface))
        else:
            self._overlays.publish(estimate.header, given.pinhole, lambda picture, camera: overlay(
                picture, camera, as_it_appears(model, pose, interface), pose))

    def _report(self, estimate: PoseEstimate, given: Evidence | PosedViews, latency: float,
                search: dict[str, object]) -> None:
        node, name = self._node, self._model.name
        what = f'capture {estimate.header.stamp_ns}'
        if isinstance(given, PosedViews):
            what = f'{len(given.views)} views, {what}'
        values = search | {'object': name} | estimate.diagnostics()
        if self._settings.tracking != 'none' or isinstance(given, PosedViews):
            sigma = position_sigma(estimate.covariance)
            values['standard deviation [mm]'] = f'{1e3 * sigma:.1f}'
        if not estimate.lost:
            with node.health.lock:
                node.done(latency, f'found {name} in {what}')
                node.health.extra = values
            return
        text = f'lost: no {name} in {what}'
        if estimate.mode == PREDICTED:
            x, y, z = estimate.pose[:3, 3]
            text += f'; predicted at ({x:.3f}, {y:.3f}, {z:.3f}) m'
        node.get_logger().warning(text)
        with node.health.lock:
            node.health.count('lost')
            node.health.warn(text)
            node.health.extra = values


class SeveralObjects:
    """The objects of a joint search: their models, and the topics of each.

    As `OneObject`; equal paths are copies of one object. Raises what loading them raises, and
    LocalizationError where two would have one name.
    """

    def __init__(self, node: StageNode, settings: PmclNodeSettings, overlays: Overlays,
                 markers: LifecyclePublisher) -> None:
        self._node, self._settings = node, settings
        self._overlays, self._markers = overlays, markers
        paths = [resolve(each, 'objects') for each in settings.several]
        distinct = {path: ObjectModel.load(path) for path in dict.fromkeys(paths)}
        self.models = [distinct[path] for path in paths]
        self.names = distinct_names([each.name for each in self.models], paths)
        self._list = ObjectList(node, paths)
        self._poses = [(node.publisher(PoseStamped, f'objects/{name}/pose', SMALL),
                        node.publisher(PoseWithCovarianceStamped,
                                       f'objects/{name}/pose_with_covariance', SMALL))
                       for name in self.names]
        self.frames = [ObjectFrame(node, name) for name in self.names if settings.broadcast_tf]
        self._meshes: list[Marker] = []  # made for the first subscriber
        self.box = region_to_marker(Box(settings.roi_center, settings.roi_size))

    def localizer(self, settings: PmclNodeSettings) -> AnyLocalizer[SceneEstimate]:
        """What finds all of them together; call it on the thread that uses it."""
        return make_scene_localizer(self.models, settings, settings.source == 'posed_views')

    def publish(self, scene: SceneEstimate, given: Evidence | PosedViews, latency: float,
                search: dict[str, object]) -> None:
        """Publish the joint estimate of one capture.

        search: the values that tell the search from others on /diagnostics.
        """
        values = search | {'objects': len(self.names),
                           'interpenetration [mm]': f'{1e3 * scene.depth:.1f}'}
        for k, (name, each) in enumerate(zip(self.names, scene.estimates, strict=True)):
            values[name] = 'lost' if each.lost else f'score {each.score:.0f}'
            if self.frames:
                self.frames[k].broadcast(each)
            if each.lost:
                continue
            for publisher, message in zip(self._poses[k], estimate_to_messages(each),
                                          strict=False):
                publisher.publish(message)
        self._list.publish(self.names, scene.estimates)
        there = [(model, each.pose, name) for model, each, name
                 in zip(self.models, scene.estimates, self.names, strict=True) if not each.lost]
        if isinstance(given, PosedViews):
            self._overlays.publish_views(given, lambda view: outlines_in_view(
                view, there, self._settings.interface))
        else:
            self._overlays.publish(given.header, given.pinhole, lambda picture, camera: outlines(
                picture, camera, there))
        if self._markers.get_subscription_count():
            self._meshes = self._meshes or [
                mesh_to_marker(replace(model, name=name))
                for model, name in zip(self.models, self.names, strict=True)]
            both = zip(self._meshes, scene.estimates, strict=True)
            placed = [place_markers(mesh, self.box, each) for mesh, each in both]
            self._markers.publish(MarkerArray(markers=[
                self.box, *(marker for each in placed for marker in each.markers[1:])]))
        with self._node.health.lock:
            self._report(scene, given.header.stamp_ns, latency)
            self._node.health.extra = values
        self._node.publish_diagnostics()

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
