"""Grasps of a surface of revolution, from its profile and the sizes of the gripper.

All grasps lie in the half plane of the profile; rotations about the axis give equivalent ones. The
room before the palm equals that at the fingertips, as an error along the approach has no sign.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy.typing import NDArray

from pmcl_ros.grasps.clearance import Clearance, held, in_grasp_frame, surface_points
from pmcl_ros.grasps.grasp import Grasp
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import GraspError

_STEP = 0.001  # m: between sampled heights of the profile
_TOUCHED = 0.001  # m: a finger's pad touches radii that are smaller than the widest by less
_ASIDE = 0.0123  # rad: the cut avoids vertices, where triangles would be cut twice or not at all


@dataclass(frozen=True)
class Profile:
    """The cut of a surface of revolution with a half plane that ends at the axis.

    segments: (n, 2, 2) ends of line segments, (radius, height) [m]; radius >= 0, height along the
        axis from the mesh's origin.
    axis: (3,) unit vector. side: (3,) unit vector normal to it, along the radius.
    """

    segments: NDArray[np.float64]
    axis: NDArray[np.float64]
    side: NDArray[np.float64]

    @classmethod
    def from_model(cls, model: ObjectModel) -> 'Profile':
        """Cut a model's mesh; GraspError when it has no axis of symmetry."""
        if model.axis is None:
            raise GraspError(f'object {model.name!r} is no surface of revolution: write its '
                             'grasps by hand (docs/howto/grasping.md)')
        from_axis = model.vertices - np.outer(model.vertices @ model.axis, model.axis)
        farthest = from_axis[int(np.linalg.norm(from_axis, axis=1).argmax())]
        side = farthest / np.linalg.norm(farthest)
        side = np.cos(_ASIDE) * side + np.sin(_ASIDE) * np.cross(model.axis, side)
        mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
        cut = trimesh.intersections.mesh_plane(  # type: ignore[no-untyped-call]
            mesh, np.cross(model.axis, side), np.zeros(3))
        both = np.stack([cut @ side, cut @ model.axis], axis=-1)
        both = both[(both[..., 0] > 0).any(axis=1)]
        # Segments that cross the axis end there; they are about level: their height may stay.
        return cls(np.maximum(both, [0, -np.inf]), model.axis, side)

    @property
    def bottom(self) -> float:
        """Least height [m]."""
        return float(self.segments[..., 1].min())

    @property
    def top(self) -> float:
        """Largest height [m]."""
        return float(self.segments[..., 1].max())

    def crossings(self, height: float) -> NDArray[np.float64]:
        """(m,) radii of the surface at a height [m], ascending."""
        radius, heights = self.segments[..., 0], self.segments[..., 1]
        low, high = heights.min(axis=1), heights.max(axis=1)
        at = (low <= height) & (height < high)
        part = (height - heights[at, 0]) / (heights[at, 1] - heights[at, 0])
        found = np.sort(radius[at, 0] + part * (radius[at, 1] - radius[at, 0]))
        # An edge between two facets is met twice.
        return found[np.diff(found, prepend=-1) > 1e-7]

    def outer(self, heights: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) largest radius at heights (n,) [m]; 0 above and below the object."""
        return np.array([self.crossings(each).max(initial=0) for each in heights])

    def upside_down(self) -> 'Profile':
        """The same profile with the axis reversed."""
        return Profile(self.segments * [1, -1], -self.axis, self.side)

    def at(self, radius: float, height: float) -> NDArray[np.float64]:
        """(3,) a point of the half plane in the mesh's frame [m]."""
        return radius * self.side + height * self.axis


def grasps_of(model: ObjectModel, gripper: GripperSettings) -> tuple[Grasp, ...]:
    """Side, top and rim grasps with the gripper's margin on every side of the object.

    Top and rim grasps are made for both ends of the axis, as the reachable one depends on the
    object's pose. The positive end of the axis is called top, the other base.
    Raises GraspError when the object is no surface of revolution.
    """
    profile, points = Profile.from_model(model), surface_points(model)
    ends = (('top', profile), ('base', profile.upside_down()))
    made = [*_side_grasps(profile, gripper),
            *(grasp for end, each in ends for grasp in _top_grasps(each, gripper, end)),
            *(grasp for end, each in ends for grasp in _rim_grasps(each, gripper, end))]
    fitted = []
    for grasp in made:
        between = held(in_grasp_frame(grasp, points), gripper, grasp.opening)
        if len(between) and Clearance.from_points(grasp, points, gripper).least >= gripper.margin:
            fitted.append(replace(grasp, width=float(np.ptp(between[:, 1]))))
    return tuple(fitted)


def _side_grasps(profile: Profile, gripper: GripperSettings) -> Iterator[Grasp]:
    """From the side, half a finger's width apart, where friction holds the wall."""
    half = gripper.finger_width / 2
    for middle in np.arange(profile.bottom + half, profile.top - half + 1e-9, half):
        heights = np.linspace(middle - half + 1e-6, middle + half - 1e-6, 27)
        radii = profile.outer(heights)
        widest = int(radii.argmax())
        leans = abs(np.gradient(radii, heights))[widest]
        # A leaning wall that is touched at the edge of a finger slips away.
        if widest in (0, len(radii) - 1) and leans > gripper.friction:
            continue
        if _STEP * (radii > radii.max() - _TOUCHED).sum() < gripper.contact:
            continue
        around = np.arange(middle - gripper.palm_height / 2, middle + gripper.palm_height / 2,
                           _STEP)
        reach = profile.outer(around).max()
        ahead = (gripper.tip + gripper.palm + reach) / 2  # of the grasp frame, to the axis
        from_bottom = round(1000 * (middle - profile.bottom))
        yield Grasp.from_axes(f'side_{from_bottom}mm', 'side', profile.at(ahead, middle),
                              -profile.side, np.cross(profile.axis, -profile.side),
                              2 * radii[widest], gripper.opening)


def _top_grasps(profile: Profile, gripper: GripperSettings, end: str) -> Iterator[Grasp]:
    """Over an end of the axis, with the fingers on both sides of the widest part in reach."""
    depths = np.arange(_STEP, gripper.finger_length, _STEP)
    radii = profile.outer(profile.top - depths)
    widest = np.maximum.accumulate(radii)
    leans = np.diff(widest, prepend=0) > gripper.friction * _STEP
    # For each depth: the last depth above where the tips would slip off, and the touched length.
    slips = np.maximum.accumulate(np.where(leans, depths, 0))
    touched = _STEP * np.array([(radii[:k + 1] > widest[k] - _TOUCHED).sum()
                                for k in range(len(radii))])
    room = np.minimum(gripper.finger_length - depths, depths - slips)
    room[touched < gripper.contact] = 0
    best = int(room.argmax())
    if room[best] <= 0:
        return
    origin = profile.at(0, profile.top - depths[best] + gripper.tip)
    yield Grasp.from_axes(f'over_{end}', 'top', origin, -profile.axis, profile.side,
                          2 * widest[best], gripper.opening)


def _rim_grasps(profile: Profile, gripper: GripperSettings, end: str) -> Iterator[Grasp]:
    """One finger inside a vessel, one outside; none where the mesh has no cavity."""
    walls = _walls(profile)
    if len(walls) < 3:
        return
    depth = min(gripper.finger_length, _STEP * len(walls)) / 2
    reached = walls[:max(int(depth / _STEP), 1)]
    hole, outer = reached[:, 0].min(), reached[:, 1].max()
    if hole <= gripper.finger_width / 2:
        return
    # The edges of a finger touch the inside of a round wall.
    inner = np.sqrt(hole ** 2 - (gripper.finger_width / 2) ** 2)
    middle = (inner + outer) / 2
    # Equal room on both sides of the inner finger.
    opening = min(outer + inner - gripper.finger_thickness, gripper.opening)
    origin = profile.at(middle, profile.top - depth + gripper.tip)
    yield Grasp.from_axes(f'rim_{end}', 'rim', origin, -profile.axis, profile.side,
                          outer - inner, opening)


def _walls(profile: Profile) -> np.ndarray:
    """(n, 2) inner and outer radius of the wall of a cavity [m], from the rim down."""
    walls = []
    for height in np.arange(profile.top - _STEP / 2, profile.bottom, -_STEP):
        radii = profile.crossings(height)
        if len(radii) < 2:
            break
        walls.append(radii[-2:])
    return np.array(walls).reshape(-1, 2)
