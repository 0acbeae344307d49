"""The profile of a surface of revolution: its cut with a half plane that ends at the axis."""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import GraspError

_ASIDE = 0.0123  # rad: the cut misses vertices, where triangles would be cut twice or not at all


@dataclass(frozen=True)
class Profile:
    """Line segments in the (radius, height) plane.

    segments: (n, 2, 2) [m], radius >= 0; height along the axis, from the mesh's origin.
    axis: (3,) unit vector. side: (3,) unit vector at a right angle to it, where radius grows.
    """

    segments: NDArray[np.float64]
    axis: NDArray[np.float64]
    side: NDArray[np.float64]

    @classmethod
    def of(cls, model: ObjectModel) -> 'Profile':
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
        # Those that cross the axis end there.
        radius, height = both[..., 0], both[..., 1]
        span = radius[:, ::-1] - radius
        with np.errstate(divide='ignore', invalid='ignore'):
            at_axis = height - radius * (height[:, ::-1] - height) / span
        height = np.where(radius < 0, at_axis, height)
        return cls(np.stack([np.maximum(radius, 0), height], axis=-1), model.axis, side)

    @property
    def bottom(self) -> float:
        """Least height [m]."""
        return float(self.segments[..., 1].min())

    @property
    def top(self) -> float:
        """Largest height [m]."""
        return float(self.segments[..., 1].max())

    def crossings(self, height: float) -> NDArray[np.float64]:
        """(m,) growing radii at which the surface has that height [m]."""
        radius, heights = self.segments[..., 0], self.segments[..., 1]
        low, high = heights.min(axis=1), heights.max(axis=1)
        at = (low <= height) & (height < high)
        part = (height - heights[at, 0]) / (heights[at, 1] - heights[at, 0])
        found = np.sort(radius[at, 0] + part * (radius[at, 1] - radius[at, 0]))
        # A facet's edge on the cut is met twice.
        return found[np.diff(found, prepend=-1) > 1e-7]

    def outer(self, heights: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) largest radius at heights (n,) [m]; 0 above and below the object."""
        return np.array([self.crossings(each).max(initial=0) for each in heights])

    def upside_down(self) -> 'Profile':
        """The same profile seen along the axis' other direction."""
        return Profile(self.segments * [1, -1], -self.axis, self.side)

    def at(self, radius: float, height: float) -> NDArray[np.float64]:
        """(3,) a point of the half plane in the mesh's frame [m]."""
        return radius * self.side + height * self.axis
