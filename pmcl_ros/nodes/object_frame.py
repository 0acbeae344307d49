"""The object's frame on /tf, for those who want it there: needs tf2_ros of a full ROS."""

from pydantic import Field, model_validator

from pmcl_ros.messages.pose import estimate_to_transform
from pmcl_ros.nodes.runtime.base import StageNode
from pmcl_ros.nodes.runtime.pose_source import tf2
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.tracking.settings import TrackingSettings
from pmcl_ros.runtime.errors import SettingsError


class PmclNodeSettings(TrackingSettings):
    """The search and the tracking, and what is said of its result on /tf."""

    broadcast_tf: bool = Field(
        False, description="publish the frame of the object on /tf, as a child of the camera's, "
        'for each pose; needs tf2_ros (full ROS)')
    object_frame: str = Field('', description='name of that frame; empty: that of the object')
    objects: tuple[str, ...] = Field(
        ('',), description='paths of several objects that are looked for together, instead of '
        'object; a path that is there twice: two copies. Each has its own topics, objects/NAME/'
        'pose and objects/NAME/pose_with_covariance, and frame')

    @property
    def several(self) -> tuple[str, ...]:
        """The objects that are looked for together; none: `object` is looked for."""
        return tuple(each for each in self.objects if each)

    @model_validator(mode='after')
    def _objects_are_searched_anew(self) -> 'PmclNodeSettings':
        if self.several and (self.tracking != 'none' or self.mode != 'default'):
            raise ValueError(f'objects need tracking none and mode default, they are '
                             f'{self.tracking} and {self.mode}')
        if self.several and self.object_frame:
            raise ValueError(f'objects have frames of their own names: object_frame '
                             f'{self.object_frame!r} must be empty')
        return self


class ObjectFrame:
    """Broadcasts poses, for as long as `node` is configured.

    name: of the object's frame. Raises SettingsError where tf2_ros is not installed.
    """

    def __init__(self, node: StageNode, name: str) -> None:
        self._name = name
        module = tf2()
        if module is None:
            raise SettingsError(
                "parameter 'broadcast_tf' is true, but tf2_ros cannot be imported: it is part of "
                'a full ROS, not on PyPI; install it (apt-get install ros-jazzy-tf2-ros-py), or '
                'set broadcast_tf to false and use the topic pose')
        broadcaster = module.TransformBroadcaster(node)
        node.configured.callback(node.destroy_publisher, broadcaster.pub_tf)
        self._send = broadcaster.sendTransform

    def broadcast(self, estimate: PoseEstimate) -> None:
        """Send the object's pose at the capture's time; a lost object is not broadcast."""
        self._send(estimate_to_transform(estimate, self._name))
