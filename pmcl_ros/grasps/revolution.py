"""Grasps of a surface of revolution, from its profile and the gripper's sizes.

Each is in the half plane of the profile; turned about the axis it is as good. Its depth leaves the
same room before the palm and at the fingertips: an error along the approach may go either way.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pmcl_ros.grasps.clearance import Clearance, held, in_grasp_frame, surface_points
from pmcl_ros.grasps.grasp import Grasp
from pmcl_ros.grasps.gripper import GripperSettings
from pmcl_ros.grasps.profile import Profile
from pmcl_ros.pmcl.object_model import ObjectModel

_STEP = 0.001  # m: between heights at which the profile is looked at
_TOUCHED = 0.001  # m: of the widest part, what a finger's pad touches


def grasps_of(model: ObjectModel, gripper: GripperSettings) -> tuple[Grasp, ...]:
    """Side, top and rim grasps that hold the object with the gripper's margin on every side.

    Top and rim grasps are made for both ends of the axis: which of them the robot can reach is
    found when the object's pose is known. An axis' positive end is called top, the other base.
    Raises GraspError when the object is no surface of revolution.
    """
    profile, points = Profile.of(model), surface_points(model)
    ends = (('top', profile), ('base', profile.upside_down()))
    made = [*_side_grasps(profile, gripper),
            *(grasp for end, each in ends for grasp in _top_grasps(each, gripper, end)),
            *(grasp for end, each in ends for grasp in _rim_grasps(each, gripper, end))]
    fitted = []
    for grasp in made:
        between = held(in_grasp_frame(grasp, points), gripper, grasp.opening)
        if len(between) and Clearance.of(grasp, points, gripper).least >= gripper.margin:
            fitted.append(replace(grasp, width=float(np.ptp(between[:, 1]))))
    return tuple(fitted)


def _side_grasps(profile: Profile, gripper: GripperSettings) -> Iterator[Grasp]:
    """From the side, half a finger's width apart, where the wall is not too steep to hold."""
    half = gripper.finger_width / 2
    for middle in np.arange(profile.bottom + half, profile.top - half + 1e-9, half):
        heights = np.linspace(middle - half + 1e-6, middle + half - 1e-6, 27)
        radii = profile.outer(heights)
        widest = int(radii.argmax())
        leans = abs(np.gradient(radii, heights))[widest]
        # Touched at the edge of a finger, a wall that leans slips away.
        if widest in (0, len(radii) - 1) and leans > gripper.friction:
            continue
        if _STEP * (radii > radii.max() - _TOUCHED).sum() < gripper.contact:
            continue
        around = np.arange(middle - gripper.palm_height / 2, middle + gripper.palm_height / 2,
                           _STEP)
        reach = profile.outer(around).max()
        ahead = (gripper.tip + gripper.palm + reach) / 2  # of the grasp frame: the axis
        from_bottom = round(1000 * (middle - profile.bottom))
        yield Grasp.of(f'side_{from_bottom}mm', 'side', profile.at(ahead, middle), -profile.side,
                       np.cross(profile.axis, -profile.side), 2 * radii[widest], gripper.opening)


def _top_grasps(profile: Profile, gripper: GripperSettings, end: str) -> Iterator[Grasp]:
    """Over the end of the axis, the fingers left and right of the widest part that they reach."""
    depths = np.arange(_STEP, gripper.finger_length, _STEP)
    radii = profile.outer(profile.top - depths)
    widest = np.maximum.accumulate(radii)
    leans = np.diff(widest, prepend=0) > gripper.friction * _STEP
    # For each depth: the last one above it where the tips would slip off; what is touched.
    slips = np.maximum.accumulate(np.where(leans, depths, 0))
    touched = _STEP * np.array([(radii[:k + 1] > widest[k] - _TOUCHED).sum()
                                for k in range(len(radii))])
    room = np.minimum(gripper.finger_length - depths, depths - slips)
    room[touched < gripper.contact] = 0
    best = int(room.argmax())
    if room[best] <= 0:
        return
    origin = profile.at(0, profile.top - depths[best] + gripper.tip)
    yield Grasp.of(f'over_{end}', 'top', origin, -profile.axis, profile.side, 2 * widest[best],
                   gripper.opening)


def _rim_grasps(profile: Profile, gripper: GripperSettings, end: str) -> Iterator[Grasp]:
    """One finger inside a hollow vessel, one outside; none where the mesh is solid."""
    walls = _walls(profile)
    if len(walls) < 3:
        return
    depth = min(gripper.finger_length, _STEP * len(walls)) / 2
    reached = walls[:max(int(depth / _STEP), 1)]
    hole, outer = reached[:, 0].min(), reached[:, 1].max()
    if hole <= gripper.finger_width / 2:
        return
    # Against the inside of a round wall a finger touches with its edges.
    inner = np.sqrt(hole ** 2 - (gripper.finger_width / 2) ** 2)
    middle = (inner + outer) / 2
    # As much room between the wall and the inner finger as behind it.
    opening = min(outer - middle + middle + inner - gripper.finger_thickness, gripper.opening)
    if opening <= outer - inner:
        return
    origin = profile.at(middle, profile.top - depth + gripper.tip)
    yield Grasp.of(f'rim_{end}', 'rim', origin, -profile.axis, profile.side, outer - inner,
                   opening)


def _walls(profile: Profile) -> np.ndarray:
    """(n, 2) inner and outer radius of the wall about a cavity, from its rim down [m]."""
    walls = []
    for height in np.arange(profile.top - _STEP / 2, profile.bottom, -_STEP):
        radii = profile.crossings(height)
        if len(radii) < 2:
            break
        walls.append(radii[-2:])
    return np.array(walls).reshape(-1, 2)
