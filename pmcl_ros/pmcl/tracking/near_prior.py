"""Poses near a prior that the evidence of one view or several speaks for."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.contour_approximations import RigidContour, shrunk
from pmcl_ros.pmcl.modes import ambiguous_poses, suppress_duplicates
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.posterior import Mode, Refine, Score
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.sampler import Gaussian

# Distinct poses that are kept: by the rigid contour, after coarse refinement, in the end.
_LIKELY, _HOPEFUL, _MODES = 16, 8, 2
_BLUR = 4  # image px: side of a pixel of the volume that the rigid contour is compared with
_CONTOUR_POINTS = 64  # of the rigid contour


def rigid_score(pose: NDArray[np.float64], points: ContourPoints, volume: EvidenceVolume) -> Score:
    """Evidence (n,) of poses (n, 4, 4) by the contour of one (4, 4), moved as a rigid wire."""
    rigid = RigidContour.from_contour(pose, points, volume.pinhole, _CONTOUR_POINTS)
    if isinstance(volume, EdgeVolume):
        blurred: EvidenceVolume = shrunk(volume, _BLUR)
        profile = ContourProfile.contrast()
    else:
        blurred, profile = volume.blurred(_BLUR / 2), volume.profile
    return lambda poses: rigid.evidence(poses, blurred, profile)


@dataclass(frozen=True)
class NearPrior:
    """Searches near a prior.

    rigid: the score of poses about a pose (4, 4) by its rigid contour; None where no contour of
    it is in view. coarse, fine: refine poses (n, 4, 4), and give (n,) their evidence. mode: the
    mode near a pose (4, 4). feasible: (n,) which of poses are. count: of poses that are drawn.
    """

    model: ObjectModel
    rigid: Callable[[NDArray[np.float64]], Score | None]
    coarse: Refine
    fine: Refine
    mode: Callable[[NDArray[np.float64]], Mode]
    feasible: Callable[[NDArray[np.float64]], NDArray[np.bool_]]
    count: int

    def modes(self, prior: Gaussian, rng: np.random.Generator) -> list[Mode]:
        """The modes near poses drawn from the prior, best first, in the region, no two the same.

        The time hardly depends on the picture: the numbers of candidates and of steps of
        refinement are fixed.
        """
        modes = [self.mode(each) for each in self._candidates(prior, rng)]
        modes = [each for each in modes if self.feasible(each.pose[None])[0]
                 and each.local.length > 0]
        modes.sort(key=lambda mode: -mode.local.evidence)
        poses = np.array([mode.pose for mode in modes]).reshape(-1, 4, 4)
        return [modes[k] for k in suppress_duplicates(poses, self.model.symmetry, _MODES)]

    def _candidates(self, prior: Gaussian, rng: np.random.Generator) -> NDArray[np.float64]:
        """(k, 4, 4) refined poses drawn from the prior, no two of one mode, best first."""
        score = self.rigid(prior.pose)
        if score is None:
            return np.zeros((0, 4, 4))
        normal = rng.normal(size=(self.count, prior.basis.shape[1]))
        poses = np.concatenate([prior.pose[None], retract(prior.pose, prior.deviations(normal))])
        poses = poses[self.feasible(poses)]
        poses = self._best(lambda each: (each, score(each)), poses, prior, _LIKELY)
        poses = self._best(self.coarse, poses, prior, _HOPEFUL)
        others = ambiguous_poses(self.model, poses[0]) if len(poses) else poses
        others = others[self.feasible(others)]
        poses = np.concatenate([poses, self.coarse(others)[0]])
        return self._best(self.fine, poses, prior, _MODES)

    def _best(self, stage: Refine, poses: NDArray[np.float64], prior: Gaussian, count: int
              ) -> NDArray[np.float64]:
        """The best `count` poses after a stage, by evidence and prior, no two of one mode."""
        poses, values = stage(poses)
        values = values - 0.5 * prior.square_distance(poses)
        poses = poses[np.argsort(-values, kind='stable')]
        return poses[suppress_duplicates(poses, self.model.symmetry, count)]
