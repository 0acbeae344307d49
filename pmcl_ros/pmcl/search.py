"""Proposals -> modes -> Posterior: the default mode's search, coarse contours first."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.history import Generation, Stage, Watch
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.modes import ambiguous_poses, suppress_duplicates
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.posterior import Feasible, Mode, Posterior, Refine, Score
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.gauss_newton import GaussNewton
from pmcl_ros.runtime.progress import Progress

# Numbers of poses refined by coarse contours, by fine ones, by those of the image, kept, and modes
# at the end.
_LIKELY, _HOPEFUL, _JUDGED, _LEFT, _MODES = 100, 32, 12, 4, 3
# nat behind the best pose: from there on a mode has no share in the posterior, also where the
# points of contours are so dependent that a twentieth of the evidence counts.
_HOPELESS = 400.0
_CHALLENGED = 2  # best poses whose ambiguous poses are tried
# Refinements: largest and smallest motion of the contour in a step [image px], number of steps.
_FARTHEST, _CONVERGED, _TRIES = 2.0, 0.1, 8
# Random restarts about each pose that is left: their number, the motion of the contour in each
# direction of freedom [image px, rms], the largest deviation [m, rad].
_AROUND, _ASIDE, _WIDEST = 12, 3.0, np.array([0.03, 0.03, 0.03, 0.4, 0.4, 0.4])


class Modes(Protocol):
    """A posterior whose modes the search finds: `ContourPosterior`, or that of several views."""

    @property
    def model(self) -> ObjectModel:
        """Of the object."""
        ...

    def feasible(self, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,) which of poses (n, 4, 4) are."""
        ...

    def local_model_at(self, pose: NDArray[np.float64], sure: bool) -> LocalModel:
        """The local model at a pose (4, 4); sure: with its uncertainty."""
        ...

    def points_at(self, pose: NDArray[np.float64]) -> ContourPoints:
        """The points of a pose's contour that count."""
        ...

    def share_at(self, pose: NDArray[np.float64]) -> float:
        """Their share of all of it."""
        ...

    def inside_at(self, pose: NDArray[np.float64]) -> float:
        """Mean log odds that the pixels which it covers show a solid [nat / px]; else NaN."""
        ...

    def refine(self, pose: NDArray[np.float64]) -> Mode:
        """The mode near a pose (4, 4)."""
        ...

    def sample(self, modes: list[Mode], rng: np.random.Generator, progress: Progress,
               watch: Watch | None = None) -> Posterior:
        """The posterior about modes, best first."""
        ...


class ContourSearch:
    """Finds the modes of the posterior, and samples it.

    optimizers: Gauss-Newton on coarse contours, fine ones, those of the image. score: evaluates
    what the last two have refined, as of `refinement`.
    """

    def __init__(self, optimizers: Sequence[GaussNewton], posterior: Modes,
                 score: Score | None = None) -> None:
        self.posterior, self._optimizers = posterior, optimizers
        coarse, fine, finest = optimizers
        self._rough = refinement(coarse, posterior.feasible, 0)
        self._coarse = refinement(coarse, posterior.feasible)
        self._fine = refinement(fine, posterior.feasible, score=score)
        self._finest = refinement(finest, posterior.feasible, score=score)

    @property
    def evaluations(self) -> int:
        """Number of poses that were drawn to refine them."""
        return sum(each.evaluations for each in self._optimizers)

    def find(self, start: NDArray[np.float64], rng: np.random.Generator, stages: 'Stages',
             watch: Watch | None = None) -> 'ScoredPoses':
        """The best poses from proposals (k, 4, 4).

        stages: of the search, 0 to 0.5; once it is stopped what was found so far is returned.
        watch: called with the poses after each refinement.
        """
        found = start
        if stages.go_on(0):
            values = self._rough(found)[1]
            found = found[np.argsort(-values, kind='stable')[:_LIKELY]]
            found = self._refined(self._coarse, found, _HOPEFUL, 'coarse', watch)
        scored = _NONE
        if stages.go_on(0.3):
            scored = self._scored(found, scored, 'fine', watch)
        if stages.go_on(0.4):
            others = np.concatenate([ambiguous_poses(self.posterior.model, each)
                                     for each in scored.poses[:_CHALLENGED]])
            if len(others):
                scored = self._scored(self._coarse(others)[0], scored, 'ambiguous', watch)
        if stages.go_on(0.5):
            scored = self._scored(self._scattered(scored.poses, rng), scored, 'scattered', watch)
        if not len(scored.poses):
            return ScoredPoses(*self._finest(found[:_MODES]))
        return scored.first(_MODES)

    def find_near(self, poses: NDArray[np.float64], watch: Watch | None = None
                  ) -> 'ScoredPoses':
        """The best poses from those of a posterior by less evidence (k, 4, 4)."""
        found = self._refined(self._coarse, poses, _HOPEFUL, 'coarse', watch)
        scored = self._scored(found, _NONE, 'fine', watch)
        others = ambiguous_poses(self.posterior.model, scored.poses[0])
        if len(others):
            # Fine contours, of a few views, show already that most of them are hopeless.
            refined, values = self._fine(np.concatenate(
                [scored.poses[:1], self._coarse(others)[0]]))
            hopeful = refined[1:][values[1:] >= values[0] - _HOPELESS]
            if len(hopeful):
                scored = self._scored(hopeful, scored, 'ambiguous', watch)
        return scored.first(_MODES)

    def sharpen(self, poses: NDArray[np.float64], rng: np.random.Generator, stages: 'Stages',
                watch: Watch | None = None) -> 'ScoredPoses':
        """The best of poses (k, 4, 4) that were found with larger pixels, refined with these.

        stages: of the search, at 0.55: once it is stopped there are no restarts.
        """
        found = self._refined(self._coarse, poses, _LEFT, 'sharpened', watch)
        scored = self._scored(found, _NONE, 'sharpened', watch)
        if stages.go_on(0.55):
            scored = self._scored(self._scattered(scored.poses[:1], rng), scored, 'scattered',
                                  watch)
        return scored.first(_MODES)

    def sample(self, poses: NDArray[np.float64], rng: np.random.Generator, stages: 'Stages',
               watch: Watch | None = None) -> Posterior:
        """The posterior about the modes near poses (n, 4, 4).

        stages: as of `find`, 0.6 to 1. watch: called with every generation of particles.
        """
        modes = self._modes(poses)
        if watch is not None:
            watch(Generation('modes', np.stack([mode.pose for mode in modes]),
                             np.array([mode.local.evidence for mode in modes])))
        return self.posterior.sample(modes, rng, stages.part(0.6), watch)

    def _refined(self, refine: Refine, poses: NDArray[np.float64], count: int, stage: Stage,
                 watch: Watch | None) -> NDArray[np.float64]:
        """Refined poses without duplicates, best first, `count` at most."""
        poses, values = refine(poses)
        if watch is not None:
            watch(Generation(stage, poses, values))
        poses = poses[np.argsort(-values, kind='stable')]
        return poses[suppress_duplicates(poses, self.posterior.model.symmetry, count)]

    def _scored(self, poses: NDArray[np.float64], kept: 'ScoredPoses', stage: Stage,
                watch: Watch | None) -> 'ScoredPoses':
        """The best `_LEFT` of those kept before and of poses, refined.

        Fine contours choose some; contours at the resolution of the image judge them, as these
        alone tell a contour in its place from one near by.
        """
        found, values = self._finest(self._refined(self._fine, poses, _JUDGED, stage, watch))
        found = np.concatenate([kept.poses, found])
        values = np.concatenate([kept.values, values])
        best = np.argsort(-values, kind='stable')
        if np.isfinite(values).any():  # fewer are left rather than one that is impossible
            best = best[np.isfinite(values[best])]
        best = best[suppress_duplicates(found[best], self.posterior.model.symmetry, _LEFT)]
        return ScoredPoses(found[best], values[best])

    def _scattered(self, poses: NDArray[np.float64], rng: np.random.Generator
                   ) -> NDArray[np.float64]:
        """Random poses about each, as far as the contour moves by a few pixels."""
        result = []
        for pose in poses:
            local = self.posterior.local_model_at(pose, False)
            widest = local.basis.T @ np.diag((_ASIDE / _WIDEST) ** 2) @ local.basis
            root = np.linalg.cholesky(np.linalg.inv(local.moments + widest))
            off = _ASIDE * rng.normal(size=(_AROUND, len(root))) @ root.T
            result.append(retract(pose, off @ local.basis.T))
        return np.concatenate(result)

    def _modes(self, poses: NDArray[np.float64]) -> list[Mode]:
        """The different modes near poses (n, 4, 4), best first."""
        modes = sorted((self.posterior.refine(each) for each in poses),
                       key=lambda mode: -mode.local.evidence)
        kept = suppress_duplicates(np.stack([mode.pose for mode in modes]),
                                   self.posterior.model.symmetry, _MODES)
        return [modes[k] for k in kept]


@dataclass(frozen=True)
class ScoredPoses:
    """Poses (n, 4, 4) and their evidence (n,) at the resolution of the image, best first."""

    poses: NDArray[np.float64]
    values: NDArray[np.float64]

    @property
    def contenders(self) -> NDArray[np.float64]:
        """(n, 4, 4) those that can have a share in the posterior."""
        return self.poses[self.values >= self.values.max() - _HOPELESS]

    def first(self, count: int) -> 'ScoredPoses':
        """The best of them."""
        return ScoredPoses(self.poses[:count], self.values[:count])


_NONE = ScoredPoses(np.zeros((0, 4, 4)), np.zeros(0))


def refinement(gauss_newton: GaussNewton, feasible: Feasible, tries: int | None = None,
               score: Score | None = None) -> Refine:
    """Refines poses by Gauss-Newton steps, and evaluates them there.

    tries: steps at most. score: evaluates them; by default the evidence of `gauss_newton`,
    without creases.
    """
    def refine(poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        found, values = gauss_newton(poses, _TRIES if tries is None else tries, _FARTHEST,
                                     _CONVERGED)
        barred = ~feasible(found)
        if barred.any():  # infeasible results go back to the start
            found[barred], values[barred] = gauss_newton(poses[barred], 0, 0, 0)
        if score is not None:
            return found, score(found)
        return found, np.where(feasible(found), values, -np.inf)
    return refine


class Stages:
    """Reports the progress of a search as a part of the whole, until that returns False."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._stopped = False

    def go_on(self, done: float) -> bool:
        """Whether to, with this part of the whole done."""
        self._stopped = self._stopped or not self._progress(done)
        return not self._stopped

    def part(self, begin: float) -> Progress:
        """What to call with 0..1 in the stage that is from `begin` to the end."""
        return lambda done: self.go_on(begin + done * (1 - begin))
