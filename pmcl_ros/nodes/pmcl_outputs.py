"""Outputs of pmcl_node: frames on /tf, overlays, the list of objects, poses of several objects."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from numpy.typing import NDArray
from rclpy.lifecycle import LifecyclePublisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, Image
from visualization_msgs.msg import Marker, MarkerArray

from pmcl_ros.drawing.pictures import contact_sheet, outlines
from pmcl_ros.drawing.view_overlay import outlines_in_view
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.messages.camera_info import pinhole_from
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.image import picture_from, picture_to_message
from pmcl_ros.messages.marker import (
    mesh_to_marker,
    objects_to_markers,
    place_markers,
    region_to_marker,
)
from pmcl_ros.messages.pose import estimate_to_messages, estimate_to_transform
from pmcl_ros.messages.types import message_class
from pmcl_ros.nodes.runtime.base import LATCHED, SMALL, StageNode
from pmcl_ros.pipeline import AnyLocalizer, Evidence, make_scene_localizer
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_object.scene_estimate import SceneEstimate, distinct_names
from pmcl_ros.pmcl.object_model import ObjectModel, mesh_file
from pmcl_ros.pmcl.prior.region import Box
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import BagError, SettingsError

_PICTURES = 4  # kept, and more as long as these are not larger together:
_MOST_BYTES = 1 << 27  # a search may take as long as many captures
_CAPTURES = 256  # of which something is kept
# Latched; but tf2's listeners are volatile: to them what was sent before they came is not sent.
_TF = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

T = TypeVar('T')
Draw = Callable[[NDArray[np.uint8], Pinhole], NDArray[np.uint8]]


class ObjectFrame:
    """Broadcasts poses on /tf, the last one again to each listener that comes later.

    For `set_up` of a node. /tf_static would be wrong: the object is where it was seen at the time
    of the capture, while the camera moves on. name: of the object's frame. Raises SettingsError
    where tf2_msgs is not installed.
    """

    def __init__(self, node: StageNode, name: str) -> None:
        try:
            self._class: Any = message_class('tf2_msgs/msg/TFMessage')
        except BagError as error:
            raise SettingsError(f"parameter 'broadcast_tf' is true, but {error}: set broadcast_tf "
                                'to false and use the topic pose') from None
        self._name, self._last = name, None
        self._publisher = node.publisher(self._class, '/tf', _TF, self._repeat)

    def broadcast(self, estimate: PoseEstimate) -> None:
        """Send the object's pose at the capture's time; of a lost object none, later neither."""
        if estimate.lost:
            self.forget()
            return
        self._last = self._class(transforms=[estimate_to_transform(estimate, self._name)])
        self._publisher.publish(self._last)

    def forget(self) -> None:
        """Repeat it no more: what is latched is replaced by a message without transforms."""
        if self._last is not None:
            self._last = None
            self._publisher.publish(self._class(transforms=[]))

    def _repeat(self) -> None:
        if self._last is not None:
            self._publisher.publish(self._last)


class Overlays:
    """Keeps the last centre views, and publishes the drawing on one of them on `overlay`.

    For `set_up` of a node.
    """

    def __init__(self, node: StageNode) -> None:
        self._node = node
        self._publisher = node.publisher(Image, 'overlay', SMALL)
        self.forget()

    def forget(self) -> None:
        """Drop all messages received so far."""
        self._pictures: dict[int, Image] = {}
        self._cameras: dict[int, Pinhole] = {}

    def on_camera(self, message: CameraInfo) -> None:
        """Callback of center/camera_info."""
        _keep(self._cameras, message, pinhole_from(message))

    def on_picture(self, message: Image) -> None:
        """Callback of center/image."""
        picture_from(message)
        _keep(self._pictures, message, message)

    def publish(self, header: Header, pinhole: Pinhole, draw: Draw) -> None:
        """Draw on the picture of a capture, if it has come and the topic has a subscriber.

        pinhole: of the volume. It is used for the picture too where no center/camera_info came.
        """
        message = self._pictures.get(header.stamp_ns)
        if not self._publisher.get_subscription_count():
            return
        if message is None:
            if header.stamp_ns < min(self._pictures, default=0):
                self._node.get_logger().warning(
                    f'no overlay of capture {header.stamp_ns}: {len(self._pictures)} newer '
                    'center/image have come since', once=True)
            return
        # The volume may be of a part of the picture, or coarser.
        pinhole = self._cameras.get(header.stamp_ns, pinhole)
        picture = picture_from(message)
        if picture.shape[:2] != (pinhole.height, pinhole.width):
            self._node.get_logger().warning(
                'no overlay: center/image is not of the size of the volume, and no '
                'center/camera_info came with it', once=True)
            return
        self._publisher.publish(picture_to_message(header, draw(picture, pinhole)))

    def publish_views(self, views: PosedViews, draw: Callable[[PosedView], NDArray[np.uint8]]
                      ) -> None:
        """Draw on each view, if the topic has a subscriber."""
        if self._publisher.get_subscription_count():
            drawn = [draw(view) for view in views.views]
            self._publisher.publish(picture_to_message(views.header, contact_sheet(drawn)))


def _keep(kept: dict[int, T], message: CameraInfo | Image, value: T) -> None:
    """Add the value of a capture; drop those of old captures."""
    kept[header_from(message.header).stamp_ns] = value
    while len(kept) > _CAPTURES or (len(kept) > _PICTURES and isinstance(message, Image)
                                    and len(kept) * len(message.data) > _MOST_BYTES):
        del kept[next(iter(kept))]


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


class SeveralObjects:
    """The objects of a joint search: their models, and the topics of each.

    For `set_up` of a node. paths: of each object's mesh or YAML; equal paths are copies of one
    object. broadcast_tf: whether the frame of each is broadcast (`frames`). Raises what loading
    them raises, and LocalizationError where two would have one name.
    """

    def __init__(self, node: StageNode, settings: PmclSettings, paths: Sequence[Path],
                 broadcast_tf: bool, overlays: Overlays, markers: LifecyclePublisher) -> None:
        self._node, self._settings, self._overlays = node, settings, overlays
        self._markers = markers
        distinct = {path: ObjectModel.load(path) for path in dict.fromkeys(paths)}
        self.models = [distinct[path] for path in paths]
        self.names = distinct_names([each.name for each in self.models], paths)
        self._list = ObjectList(node, paths)
        self._poses = [(node.publisher(PoseStamped, f'objects/{name}/pose', SMALL),
                        node.publisher(PoseWithCovarianceStamped,
                                       f'objects/{name}/pose_with_covariance', SMALL))
                       for name in self.names]
        self.frames = [ObjectFrame(node, name) for name in self.names if broadcast_tf]
        self._meshes: list[Marker] = []  # made for the first subscriber
        self._box = region_to_marker(Box(settings.roi_center, settings.roi_size))

    def localizer(self, posed: bool) -> AnyLocalizer[SceneEstimate]:
        """A localizer of all of them; call it on the thread that uses it.

        posed: in posed views.
        """
        return make_scene_localizer(self.models, self._settings, posed)

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
            placed = [place_markers(mesh, self._box, each) for mesh, each in both]
            self._markers.publish(MarkerArray(markers=[
                self._box, *(marker for each in placed for marker in each.markers[1:])]))
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
