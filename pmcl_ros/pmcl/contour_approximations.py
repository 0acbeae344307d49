"""Approximations of the contour evidence near a pose, without rendering."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.energies import evidence_across
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.view_terms import ViewContour, normal_motion
from pmcl_ros.runtime.kernels import compiled

_FARTHEST, _STEP = 4.0, 0.5  # px: ends and steps of the table of `LinearizedContour`
_NEAREST = 0.01  # m: closer points are not seen


@dataclass(frozen=True)
class LinearizedContour:
    """Evidence of poses near one, to first order in the motion of each point of its contour.

    Points move along their normals only. A pose costs a hundredth of the exact evidence.

    motion: (n, 6) motion of the points per unit of a tangent vector [px]
        (`local_model.normal_motion`). table: (n, k) evidence of a point at each step [nat].
    covered: evidence of the pixels that the object covers there [nat].
    """

    motion: NDArray[np.float64]
    table: NDArray[np.float64]
    covered: float

    @classmethod
    def from_view(cls, pose: NDArray[np.float64], view: ViewContour) -> 'LinearizedContour':
        """About `pose` (4, 4), whose contour in a view, in the frame of its camera, is given."""
        shifts = np.arange(-_FARTHEST, _FARTHEST + _STEP / 2, _STEP)
        table, points = view.evidence_across(shifts)
        motion = normal_motion(points, view.volume.pinhole, pose[:3, 3])
        return cls(np.ascontiguousarray(motion), points.lengths[:, None] * table, points.covered)

    def evidence(self, deviations: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m,) evidence [nat] of poses that deviate by tangent vectors (m, 6) [m, rad].

        Constant beyond the ends of the table.
        """
        result = np.full(len(deviations), self.covered)
        _slid(self.motion, self.table, np.ascontiguousarray(deviations), _FARTHEST, _STEP, result)
        return result


@compiled()
def _slid(motion, table, deviations, farthest, step, result):  # type: ignore[no-untyped-def]
    last = table.shape[1] - 1
    for m in range(len(deviations)):
        total = 0.0
        a, b, c, d, e, f = deviations[m]
        for n in range(len(motion)):
            row = motion[n]
            shift = (a * row[0] + b * row[1] + c * row[2] + d * row[3] + e * row[4] + f * row[5]
                     + farthest) / step
            shift = min(max(shift, 0.0), float(last))
            k = min(int(shift), last - 1)
            total += table[n, k] + (shift - k) * (table[n, k + 1] - table[n, k])
        result[m] += total


@dataclass(frozen=True)
class RigidContour:
    """Points of an object's contour that move with it as a rigid wire.

    It holds for any translation, but for small rotations only, as the contour slides over a
    smooth object that rotates. A pose costs a few microseconds.

    pose: (4, 4) of the contour. points: (n, 3) [m]. tips: (n, 3) [m], 1 px outward along the
    normals, at the same depth. lengths: (n,) of the contour that the points represent [image px].
    """

    pose: NDArray[np.float64]
    points: NDArray[np.float64]
    tips: NDArray[np.float64]
    lengths: NDArray[np.float64]

    @classmethod
    def from_contour(cls, pose: NDArray[np.float64], contour: ContourPoints, pinhole: Pinhole,
                     count: int) -> 'RigidContour':
        """Of about `count` points of a contour, evenly along it."""
        total = float(contour.lengths.sum())
        reached = np.cumsum(contour.lengths)
        wanted = (np.arange(count) + 0.5) / count * total
        chosen = np.unique(np.minimum(np.searchsorted(reached, wanted), len(reached) - 1))
        pixels, depths = contour.pixels[chosen], contour.depths[chosen]
        tips = pixels + contour.normals[chosen]
        points, tips = (depths[:, None] * pinhole.rays(each) for each in (pixels, tips))
        return cls(pose, points, tips, np.full(len(chosen), total / max(len(chosen), 1)))

    def evidence(self, poses: NDArray[np.float64], volume: EvidenceVolume, profile: ContourProfile
                 ) -> NDArray[np.float64]:
        """(n,) evidence [nat] of poses (n, 4, 4); points out of view have none.

        The profile's offsets are in pixels of `volume`, whose camera may be coarser.
        """
        motions = poses @ np.linalg.inv(self.pose)
        turns, shifts = motions[:, :3, :3], motions[:, None, :3, 3]
        places = self.points @ turns.transpose(0, 2, 1) + shifts
        tips = self.tips @ turns.transpose(0, 2, 1) + shifts
        depths = places[..., 2]
        ahead = (depths > _NEAREST) & (tips[..., 2] > _NEAREST)
        pixels = volume.pinhole.project(np.where(ahead[..., None], places, [0, 0, 1]))
        normals = volume.pinhole.project(np.where(ahead[..., None], tips, [0, 0, 1])) - pixels
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
        size = np.array([volume.pinhole.width, volume.pinhole.height])
        seen = ahead & ((pixels > -0.5) & (pixels < size - 0.5)).all(axis=-1)
        result = np.zeros(depths.shape)
        result[seen] = evidence_across(volume, pixels[seen], normals[seen], depths[seen], profile,
                                       np.zeros(1))[:, 0]
        return np.asarray(result @ self.lengths)


def shrunk(edges: EdgeVolume, scale: int) -> EdgeVolume:
    """The mean over each scale x scale pixels, as one pixel of a coarser camera."""
    rows, columns = (max(1, side // scale) for side in edges.tensor.shape[:2])
    if scale == 1 or min(edges.tensor.shape[:2]) < scale:
        return edges
    whole = edges.tensor[:rows * scale, :columns * scale]
    blocks = whole.reshape(rows, scale, columns, scale, *edges.tensor.shape[2:])
    tensor = np.zeros((rows, columns, *edges.tensor.shape[2:]), np.float32)
    for down in range(scale):
        for across in range(scale):
            tensor += blocks[:, down, :, across]
    tensor /= scale ** 2
    pinhole = edges.pinhole.crop(0, 0, columns * scale, rows * scale).resized(columns, rows)
    return EdgeVolume(edges.header, tensor, edges.depths, pinhole)
