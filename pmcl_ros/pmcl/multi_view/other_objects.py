"""Other objects beside the one that is sought: it is outside of them, and they may hide it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.contour_evidence import ContourEvidence, scene
from pmcl_ros.pmcl.local_model import weighted
from pmcl_ros.pmcl.multi_object.visibility import depth_before
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.posterior import Feasible
from pmcl_ros.pmcl.render.back_end import Renderer
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.scene import Window


@dataclass(frozen=True)
class OtherObjects:
    """Other objects that are known to be there.

    feasible: (n,) which of poses (n, 4, 4) are outside of them. placed: each with its pose
    (4, 4). Poses are in the reference frame of the views.
    """

    feasible: Feasible
    placed: Sequence[tuple[ObjectModel, NDArray[np.float64]]]

    def depths(self, renderer: Renderer, view: ContourEvidence, camera: NDArray[np.float64]
               ) -> NDArray[np.float32]:
        """(height, width) depth of their surfaces in a view [m], 0 where there is none."""
        pinhole = view.volume.pinhole
        window = Window(0, 0, (pinhole.width, pinhole.height))
        front = np.full((pinhole.height, pinhole.width), np.inf, np.float32)
        for model, pose in self.placed:
            drawn = scene(model, view.region, pinhole, window, 0.0, view.interface)
            depth = renderer.depths(drawn, (np.linalg.inv(camera) @ pose)[None])[0]
            front = np.where((depth > 0) & (depth < front), depth, front)
        return np.where(np.isfinite(front), front, np.float32(0))


def not_hidden(points: ContourPoints, front: NDArray[np.float32]) -> ContourPoints:
    """A contour without its part behind other objects, where that is not seen through them.

    front: (height, width) depth of these, 0 for none [m]. As their material is unknown, what is
    behind them counts if it has evidence, all in all.
    """
    hidden = np.isfinite(depth_before(points, front))
    if float(points.lengths[hidden] @ points.evidence[hidden]) >= 0:
        return points
    return weighted(points, np.where(hidden, 0.0, 1.0))


def not_masked(points: ContourPoints, masked: NDArray[np.bool_]) -> ContourPoints:
    """A contour without its part where pixels (height, width) are masked, as if out of view."""
    height, width = masked.shape
    column, row = np.rint(points.pixels.T).astype(int)
    return weighted(points, np.where(
        masked[row.clip(0, height - 1), column.clip(0, width - 1)], 0.0, 1.0))
