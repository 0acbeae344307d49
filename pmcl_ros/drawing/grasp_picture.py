"""Grasps drawn on an object's profile: (height, width, 3) uint8 RGB, without a screen."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.grasps.clearance import Clearance
from pmcl_ros.grasps.grasp import Grasp
from pmcl_ros.grasps.gripper import GripperSettings
from pmcl_ros.grasps.profile import Profile

_SCALE = 1200  # px / m
_AROUND = 0.08  # m: shown on each side of the object
_HEAD = 40  # px: for the text above each drawing
_COLUMNS = 4
_FRACTION = 4  # bits of a pixel's fraction in OpenCV's drawing functions
_GLASS, _FINGER, _PALM = (0, 114, 178), (213, 94, 0), (230, 159, 0)
_AXIS, _TEXT = (200, 200, 200), (40, 40, 40)


def grasp_picture(profile: Profile, gripper: GripperSettings, grasps: Sequence[Grasp],
                  clearances: Sequence[Clearance]) -> NDArray[np.uint8]:
    """One drawing for each grasp: the open gripper as it stands before it closes.

    The paper is the plane of the axis and of the approach, or of the closing direction where the
    approach goes along the axis.
    """
    drawings = [_drawing(profile, gripper, grasp, clearance)
                for grasp, clearance in zip(grasps, clearances, strict=True)]
    blank = np.full_like(drawings[0], 255)
    columns = min(_COLUMNS, len(drawings))
    drawings += [blank] * (-len(drawings) % columns)
    return np.vstack([np.hstack(drawings[k:k + columns])
                      for k in range(0, len(drawings), columns)])


def _drawing(profile: Profile, gripper: GripperSettings, grasp: Grasp, clearance: Clearance
             ) -> NDArray[np.uint8]:
    across = np.cross(profile.axis, np.cross(grasp.approach, profile.axis))
    if np.linalg.norm(across) < 0.1:
        across = np.cross(profile.axis, np.cross(grasp.closing, profile.axis))
    plane = np.stack([across / np.linalg.norm(across), profile.axis])
    reach = profile.segments[..., 0].max() + _AROUND
    size = np.array([2 * reach, profile.top - profile.bottom + 2 * _AROUND]) * _SCALE
    canvas = np.full((int(size[1]) + _HEAD, int(size[0]), 3), 255, np.uint8)
    corner = np.array([-reach, profile.top + _AROUND])

    def pixels(points: NDArray[np.float64]) -> NDArray[np.int32]:
        xy = (points - corner) * [_SCALE, -_SCALE] + [0, _HEAD]
        return np.rint(xy * 2 ** _FRACTION).astype(np.int32)

    _line(canvas, pixels(np.array([[0, profile.bottom - 0.02], [0, profile.top + 0.02]])), _AXIS)
    for box, colour in zip(gripper.corners(grasp.opening), (_FINGER, _FINGER, _PALM), strict=True):
        placed = box @ grasp.pose[:3, :3].T + grasp.pose[:3, 3]
        outline = cv2.convexHull(pixels(placed @ plane.T)[:, None])
        tint = canvas.copy()
        cv2.fillPoly(tint, [outline], colour, cv2.LINE_AA, _FRACTION)
        canvas[:] = cv2.addWeighted(tint, 0.35, canvas, 0.65, 0)
        cv2.polylines(canvas, [outline], True, colour, 2, cv2.LINE_AA, _FRACTION)
    for segment in profile.segments:
        for sign in (1, -1):
            _line(canvas, pixels(segment * [sign, 1]), _GLASS)
    low, high = clearance.room
    sides, along = 1000 * min(-low[0], high[0]), 1000 * np.array([-low[1], high[1]])
    for row, text in enumerate((
            f'{grasp.name}: {1000 * grasp.width:.0f} of {1000 * grasp.opening:.0f} mm',
            f'room: beside {sides:.0f}, palm {along[0]:.0f}, tips {along[1]:.0f} mm')):
        cv2.putText(canvas, text, (6, 15 + 17 * row), cv2.FONT_HERSHEY_SIMPLEX, 0.42, _TEXT, 1,
                    cv2.LINE_AA)
    return canvas


def _line(canvas: NDArray[np.uint8], ends: NDArray[np.int32], colour: tuple[int, int, int]
          ) -> None:
    start, end = ends.tolist()
    cv2.line(canvas, start, end, colour, 2, cv2.LINE_AA, _FRACTION)
