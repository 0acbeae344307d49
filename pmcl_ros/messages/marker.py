"""MarkerArray: objects and their region."""

from collections.abc import Sequence
from pathlib import Path

from geometry_msgs.msg import Point, Pose, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.pose import pose_to_message
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Box


def mesh_to_marker(model: ObjectModel) -> Marker:
    """The object as triangles in its own frame; `place_markers` says where it is."""
    corners = model.vertices[model.faces.ravel()].tolist()
    return Marker(ns=model.name, type=Marker.TRIANGLE_LIST, scale=Vector3(x=1.0, y=1.0, z=1.0),
                  color=ColorRGBA(r=0.1, g=0.6, b=1.0, a=0.6),
                  points=[Point(x=x, y=y, z=z) for x, y, z in corners])


def region_to_marker(region: Box) -> Marker:
    """The box that the object's origin is looked for in; `place_markers` says of which capture."""
    x, y, z = region.center
    return Marker(ns='region', type=Marker.CUBE, color=ColorRGBA(r=1.0, g=0.8, b=0.2, a=0.15),
                  scale=Vector3(**dict(zip('xyz', region.size, strict=True))),
                  pose=Pose(position=Point(x=x, y=y, z=z)))


def place_markers(mesh: Marker, region: Marker, estimate: PoseEstimate) -> MarkerArray:
    """The region, and `mesh` at the estimated pose; no mesh where the object is lost."""
    mesh.header = region.header = header_to_message(estimate.header)
    mesh.action = Marker.DELETE if estimate.lost else Marker.ADD
    mesh.pose = pose_to_message(estimate.pose)
    return MarkerArray(markers=[region, mesh])


def objects_to_markers(names: Sequence[str], meshes: Sequence[tuple[Path, float]],
                       estimates: Sequence[PoseEstimate]) -> MarkerArray:
    """The list of objects: ns is the name, text found or lost, pose that of the mesh.

    meshes: file and metres per unit of each. A lost one is where it would be most likely, faint.
    """
    markers = []
    for k, (name, (path, scale), each) in enumerate(zip(names, meshes, estimates, strict=True)):
        colour = ColorRGBA(r=0.8, g=0.2, b=0.1, a=0.05) if each.lost else ColorRGBA(
            r=0.1, g=0.6, b=1.0, a=0.6)
        markers.append(Marker(
            header=header_to_message(each.header), ns=name, id=k, type=Marker.MESH_RESOURCE,
            action=Marker.ADD, pose=pose_to_message(each.pose), color=colour,
            scale=Vector3(x=scale, y=scale, z=scale), text='lost' if each.lost else 'found',
            mesh_resource=path.absolute().as_uri()))
    return MarkerArray(markers=markers)


def no_markers() -> MarkerArray:
    """Takes every marker away."""
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL)])
