"""Grasps: `grasps`, `pre_grasps`, `grasps/details`, `grasp_markers`."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import Point, PoseArray, PoseStamped, Vector3
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA, Float32MultiArray, MultiArrayDimension, MultiArrayLayout
from visualization_msgs.msg import Marker, MarkerArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.grasps.ranking import Candidate
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.pose import pose_to_message

# The columns of `grasps/details`.
DETAILS = ('score', 'probability', 'width', 'opening')
_DRAWN = 8  # grasps whose gripper is drawn, the best
_LINE = 0.003  # m


class GraspMessages(NamedTuple):
    """`grasps`, `pre_grasps` and `grasps/details`, in the order in which they are published."""

    grasps: PoseArray
    pre_grasps: PoseArray
    details: Float32MultiArray


def grasps_to_messages(header: Header, candidates: Sequence[Candidate], gripper: GripperSettings,
                       approach: float) -> GraspMessages:
    """The poses of the gripper's parent link in the header's frame, best first; empty for none.

    approach: how far back along its x the pre-grasp is [m]. Row i of the details belongs to the
    i-th grasp: the first dimension's label holds the stamp, `grasps;stamp=NS`, the second's the
    columns, by commas; lengths in metres. width is that of the object between the fingers, opening
    the gap between them on the approach.
    """
    head = header_to_message(header)
    rows = [value for each in candidates for value in
            (each.score, each.probability, each.grasp.width, each.grasp.opening)]
    size = len(DETAILS)
    layout = MultiArrayLayout(dim=[
        MultiArrayDimension(label=f'grasps;stamp={header.stamp_ns}', size=len(candidates),
                            stride=len(rows)),
        MultiArrayDimension(label=','.join(DETAILS), size=size, stride=size)])
    return GraspMessages(
        PoseArray(header=head, poses=[pose_to_message(each.pose @ gripper.parent_pose)
                                      for each in candidates]),
        PoseArray(header=head, poses=[pose_to_message(each.before(approach) @ gripper.parent_pose)
                                      for each in candidates]),
        Float32MultiArray(layout=layout, data=[float(each) for each in rows]))


def first_of(poses: PoseArray) -> PoseStamped:
    """The best of a ranked array."""
    return PoseStamped(header=poses.header, pose=poses.poses[0])


def grippers_to_markers(header: Header, candidates: Sequence[Candidate], gripper: GripperSettings,
                        approach: float) -> MarkerArray:
    """The outline of the open gripper at the best grasps, and the way to the first.

    Green where it is sure to clear the object, red where it is not. What was there is taken away.
    """
    markers = [Marker(action=Marker.DELETEALL)]
    head = header_to_message(header)
    for number, each in enumerate(candidates[:_DRAWN]):
        color = ColorRGBA(r=1 - each.probability, g=each.probability, b=0.1,
                          a=1.0 if number == 0 else 0.25)
        markers.append(Marker(
            header=head, ns='grasps', id=number, type=Marker.LINE_LIST,
            pose=pose_to_message(each.pose), scale=Vector3(x=_LINE), color=color,
            points=_points(_outline(gripper, each.grasp.opening))))
    if candidates:
        best = candidates[0]
        markers.append(Marker(
            header=head, ns='approach', type=Marker.ARROW, pose=pose_to_message(np.eye(4)),
            scale=Vector3(x=2 * _LINE, y=4 * _LINE), color=ColorRGBA(r=0.1, g=0.4, b=1.0, a=1.0),
            points=_points(np.stack([best.before(approach)[:3, 3], best.pose[:3, 3]]))))
    return MarkerArray(markers=markers)


def _outline(gripper: GripperSettings, opening: float) -> NDArray[np.float64]:
    """(n, 3) pairs of points: the edges of the fingers and the palm, in the grasp frame [m]."""
    first = np.arange(8)
    edges = [(a, a | bit) for bit in (1, 2, 4) for a in first if not a & bit]
    return gripper.corners(opening)[:, np.array(edges)].reshape(-1, 3)


def _points(points: NDArray[np.float64]) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in points.tolist()]
