"""Draws grasps on an object's profile."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from pmcl_ros.drawing.charts import picture
from pmcl_ros.grasps.clearance import Clearance
from pmcl_ros.grasps.grasp import Grasp
from pmcl_ros.grasps.revolution import Profile
from pmcl_ros.grasps.settings import GripperSettings

_SCALE = 12.0  # inches / m
_AROUND = 0.08  # m: shown on each side of the object
_HEAD = 0.4  # inches: for the text above each drawing
_COLUMNS = 4
_GLASS, _FINGER, _PALM, _AXIS = '#0072b2', '#d55e00', '#e69f00', '#c8c8c8'


def grasp_picture(profile: Profile, gripper: GripperSettings, grasps: Sequence[Grasp],
                  clearances: Sequence[Clearance]) -> NDArray[np.uint8]:
    """(height, width, 3) RGB: a drawing for each grasp, the gripper open before it closes.

    The paper is the plane of the axis and of the approach, or of the closing direction where the
    approach goes along the axis.
    """
    columns = min(_COLUMNS, len(grasps))
    rows = -(-len(grasps) // columns)
    reach = profile.segments[..., 0].max() + _AROUND
    low, high = profile.bottom - _AROUND, profile.top + _AROUND
    drawn = Figure((columns * 2 * reach * _SCALE, rows * ((high - low) * _SCALE + _HEAD)),
                   layout='constrained')
    for number, (grasp, clearance) in enumerate(zip(grasps, clearances, strict=True), 1):
        axes = drawn.add_subplot(rows, columns, number)
        _draw(axes, profile, gripper, grasp)
        (left, back), (right, front) = 1000 * np.array(clearance.room)
        axes.set_title(f'{grasp.name}: {1000 * grasp.width:.0f} of {1000 * grasp.opening:.0f} mm\n'
                       f'room: beside {min(-left, right):.0f}, palm {-back:.0f}, tips '
                       f'{front:.0f} mm', loc='left', fontsize='small')
        axes.set(aspect='equal', xlim=(-reach, reach), ylim=(low, high))
        axes.set_axis_off()
    return picture(drawn)


def _draw(axes: Axes, profile: Profile, gripper: GripperSettings, grasp: Grasp) -> None:
    across = np.cross(profile.axis, np.cross(grasp.approach, profile.axis))
    if np.linalg.norm(across) < 0.1:
        across = np.cross(profile.axis, np.cross(grasp.closing, profile.axis))
    plane = np.stack([across / np.linalg.norm(across), profile.axis])
    axes.plot([0, 0], [profile.bottom - 0.02, profile.top + 0.02], color=_AXIS)
    for box, colour in zip(gripper.corners(grasp.opening), (_FINGER, _FINGER, _PALM), strict=True):
        corners = (box @ grasp.pose[:3, :3].T + grasp.pose[:3, 3]) @ plane.T
        outline = corners[ConvexHull(corners).vertices]
        axes.fill(*outline.T, facecolor=colour + '59', edgecolor=colour, linewidth=1.5)
    for side in (1, -1):
        axes.plot(*np.moveaxis(profile.segments * [side, 1], -1, 0).swapaxes(1, 2), color=_GLASS)
