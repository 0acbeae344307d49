"""PoseEstimate: `collision_object`, moveit_msgs/CollisionObject as of ROS 2 Jazzy."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.pose import pose_to_message
from pmcl_ros.messages.types import Point
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.object_model import ObjectModel

_ORIGIN = np.eye(4)


class CollisionObjects:
    """What MoveIt's planning scene has to be told of the objects: added, or removed again.

    names: distinct, the objects' ids in the scene; not empty, which would mean all of the scene.
    there: what is in the scene already, by its id; kept up to date.
    """

    def __init__(self, classes: Callable[[str], Any], names: Sequence[str],
                 models: Sequence[ObjectModel], there: dict[str, Header]) -> None:
        self._classes, self._names, self._models = classes, names, models
        self._kind = classes('moveit_msgs/msg/CollisionObject')
        self._meshes: dict[ObjectModel, Any] = {}  # large: made once, for the first pose
        self._there = there

    def update(self, estimates: Sequence[PoseEstimate]) -> list[Any]:
        """A message for each object that was found, and for each that is there and was lost.

        So is what is there and no longer listed. MoveIt replaces an object that is added again.
        """
        unlisted = self._there.keys() - {*self._names}
        messages = [self._removal(name, self._there.pop(name)) for name in sorted(unlisted)]
        for name, model, each in zip(self._names, self._models, estimates, strict=True):
            if not each.lost:
                self._there[name] = each.header
                messages.append(self._message(name, model, each))
            elif self._there.pop(name, None) is not None:
                messages.append(self._removal(name, each.header))
        return messages

    def clear(self) -> list[Any]:
        """Removes what is there."""
        messages = [self._removal(name, header) for name, header in self._there.items()]
        self._there.clear()
        return messages

    def _message(self, name: str, model: ObjectModel, estimate: PoseEstimate) -> Any:
        if model not in self._meshes:
            self._meshes[model] = _mesh(self._classes, model)
        return self._make(name, estimate.header, estimate.pose, model.name, self._kind.ADD,
                          [self._meshes[model]])

    def _removal(self, name: str, header: Header) -> Any:
        return self._make(name, header, _ORIGIN, '', self._kind.REMOVE, [])

    def _make(self, name: str, header: Header, pose: Any, key: str, operation: Any,
              meshes: list[Any]) -> Any:
        kind = self._classes('object_recognition_msgs/msg/ObjectType')
        return self._kind(
            header=header_to_message(header), pose=pose_to_message(pose), id=name,
            type=kind(key=key, db=''), primitives=[], primitive_poses=[], meshes=meshes,
            mesh_poses=[pose_to_message(_ORIGIN) for _ in meshes], planes=[], plane_poses=[],
            subframe_names=[], subframe_poses=[], operation=operation)


def _mesh(classes: Callable[[str], Any], model: ObjectModel) -> Any:
    triangle = classes('shape_msgs/msg/MeshTriangle')
    return classes('shape_msgs/msg/Mesh')(
        triangles=[triangle(vertex_indices=each) for each in model.faces.astype(np.uint32)],
        vertices=[Point(x=x, y=y, z=z) for x, y, z in model.vertices.tolist()])
