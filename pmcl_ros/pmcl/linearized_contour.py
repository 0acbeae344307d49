"""The evidence near a pose by a table: its contour slides along its normals, and nothing else."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.energies import evidence_across
from pmcl_ros.pmcl.local_model import normal_motion
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.crease_lines import CreasePoints
from pmcl_ros.runtime.kernels import compiled

_FARTHEST, _STEP = 4.0, 0.5  # px: the table's ends, and its steps


@dataclass(frozen=True)
class LinearizedContour:
    """Evidence of poses near one, to first order in the motion of each point of its contour.

    Nothing is rendered: a pose costs a hundredth of the exact evidence.

    motion: (n, 6) how far points go [px] (`local_model.normal_motion`). table: (n, k) what a point
        is worth at each step [nat].
    """

    motion: NDArray[np.float64]
    table: NDArray[np.float64]

    @classmethod
    def of(cls, pose: NDArray[np.float64], points: ContourPoints, edges: EdgeVolume,
           profile: ContourProfile, creases: CreasePoints | None = None) -> 'LinearizedContour':
        """About `pose` (4, 4), whose contour's points are `points`; creases: seen, if any count.
        """
        shifts = np.arange(-_FARTHEST, _FARTHEST + _STEP / 2, _STEP)
        table = evidence_across(edges, points.pixels, points.normals, points.depths, profile,
                                shifts)
        if creases is not None and creases.shown:
            table = np.concatenate([table, creases.evidence(edges, shifts)])
            points = points.joined(creases.points)
        return cls(np.ascontiguousarray(normal_motion(points, edges.pinhole, pose[:3, 3])),
                   points.lengths[:, None] * table)

    def evidence(self, deviations: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m,) [nat] of poses that deviate by tangent vectors (m, 6).

        Beyond the table its end counts.
        """
        result = np.zeros(len(deviations))
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
        result[m] = total
