"""The default mode's search: proposals, a tournament, refined modes, a sample of the posterior."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pmcl_ros.pmcl.ascent import ascent
from pmcl_ros.pmcl.history import Generation, Record, Watch, recorder
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.rivals import rivals
from pmcl_ros.pmcl.sampler import Gaussian, sample_posterior
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.sliding_contour import SlidingContour
from pmcl_ros.pmcl.summary import same_mode, tangent
from pmcl_ros.pmcl.tournament import Progress, Score, tournament

_COARSE_SURVIVORS, _SURVIVORS, _MODES = 12, 4, 3
# m: moves of the particles across the line of sight, first and last
_COARSE_STEPS, _FINE_STEPS, _RIVAL_STEPS = (0.006, 0.002), (0.003, 0.001), (0.005, 0.0007)
_CHALLENGED = 2  # of the best poses, whose rivals are tried
_ALIKE_DISTANCE, _ALIKE_ANGLE = 0.01, 0.15  # m, rad: closer poses are of one mode
_REFINEMENTS = 10
_CONVERGED = 0.02  # px: rms along the contour
# Standard deviations of a mode's Gaussian, relative to the local model's: wider than the mode, as
# the sampler wants it, and wide enough for a neighbouring hump.
_WIDEN = 2.5
_OTHER = 8.0  # such standard deviations away a mode has no say


@dataclass(frozen=True)
class Mode:
    """A maximum of the evidence: its pose (4, 4), and the evidence nearby."""

    pose: NDArray[np.float64]
    local: LocalModel


@dataclass(frozen=True)
class Posterior:
    """poses: (n, 4, 4) equally weighted. own: (n,) of which of the modes, which are best first.

    values: (n,) log posterior, but for a constant.
    """

    modes: tuple[Mode, ...]
    poses: NDArray[np.float64]
    values: NDArray[np.float64]
    own: NDArray[np.int64]


@dataclass(frozen=True)
class ContourSearch:
    """Looks for the poses that contour evidence supports.

    coarse, fine, exact: evidence of poses, -inf outside the region of interest: with blurred
    edges, with sharp ones, and at the image's own resolution. about: the local model about a pose
    by the exact evidence; with True also how sure it is. near: the evidence near a pose.
    inside: whether poses are in the region.
    """

    model: ObjectModel
    settings: PmclSettings
    coarse: Score
    fine: Score
    exact: Score
    about: Callable[[NDArray[np.float64], bool], LocalModel]
    near: Callable[[NDArray[np.float64]], SlidingContour]
    inside: Callable[[NDArray[np.float64]], NDArray[np.bool_]]

    def run(self, start: NDArray[np.float64], rng: np.random.Generator, progress: Progress,
            watch: Watch | None = None) -> Posterior:
        """The posterior, from proposals (k, 4, 4).

        progress: called with 0..1; once it returns False what was found so far is summed up.
        watch: told every generation of particles.
        """
        stages = _Stages(progress)
        found = self._tournament(self.coarse, start, _COARSE_SURVIVORS, _COARSE_STEPS, rng,
                                 stages.part(0, 0.3), recorder(watch, 'coarse'))
        found = self._tournament(self.fine, found, _SURVIVORS, _FINE_STEPS, rng,
                                 stages.part(0.3, 0.6), recorder(watch, 'fine'))
        found = self._distinct(found)
        if not stages.stopped:
            others = [rivals(self.model, each) for each in found[:_CHALLENGED]]
            found = self._tournament(self.fine, np.concatenate([found, *others]), _MODES,
                                     _RIVAL_STEPS, rng, stages.part(0.6, 0.8),
                                     recorder(watch, 'rivals'))
        modes = self._modes(self._distinct(found)[:_MODES])
        if watch is not None:
            watch(Generation('modes', np.stack([mode.pose for mode in modes]),
                             np.array([mode.local.evidence for mode in modes])))
        return self.sampled(modes, rng, stages.part(0.8, 1), watch)

    def sampled(self, modes: Sequence[Mode], rng: np.random.Generator, progress: Progress,
                watch: Watch | None = None) -> Posterior:
        """The posterior about modes, best first."""
        scale = modes[0].local.scale
        start_of = [Gaussian.of(mode.pose, _WIDEN ** 2 * mode.local.covariance, self.model.axis)
                    for mode in modes]
        slides = [self.near(mode.pose) for mode in modes]

        def rough(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            terms = np.full((len(slides), len(poses)), -np.inf)
            for k, (each, slide) in enumerate(zip(start_of, slides, strict=True)):
                off = each.square_distance(poses, self.model.axis)
                near = off < _OTHER ** 2
                deviations = tangent(poses[near], each.pose, self.model.axis)
                terms[k, near] = scale * slide.evidence(deviations) - 0.5 * off[near]
            return np.where(self.inside(poses), logsumexp(terms, axis=0), -np.inf)

        poses, values, own = sample_posterior(
            [rough, lambda each: scale * self.exact(each)], start_of, self.model.axis,
            self.settings.particles, self.settings.moves, rng, progress,
            [recorder(watch, 'approximate'), recorder(watch, 'posterior')])
        return Posterior(tuple(modes), poses, values, own)

    def _modes(self, poses: NDArray[np.float64]) -> list[Mode]:
        """The different modes near poses (n, 4, 4), best first."""
        modes = sorted((self.refined(each) for each in poses),
                       key=lambda mode: -mode.local.evidence)
        poses = np.stack([mode.pose for mode in modes])
        return [modes[k] for k in self._different(poses)]

    def refined(self, pose: NDArray[np.float64]) -> Mode:
        """The mode nearby: Gauss-Newton steps on the local model."""
        best, _ = ascent(pose, lambda each: self.about(each, False), _REFINEMENTS, _CONVERGED)
        return Mode(best, self.about(best, True))

    def _tournament(self, score: Score, start: NDArray[np.float64], survivors: int,
                    steps: tuple[float, float], rng: np.random.Generator, progress: Progress,
                    record: Record | None) -> NDArray[np.float64]:
        return tournament(score, start, survivors, self.model.radius, self.settings.particles,
                          self.settings.moves, steps, rng, progress, record)[0]

    def _distinct(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        return poses[self._different(poses)]

    def _different(self, poses: NDArray[np.float64]) -> list[int]:
        """Which of poses (n, 4, 4), best first, are not of the mode of an earlier one."""
        kept: list[int] = []
        for k, pose in enumerate(poses):
            earlier = self.model.symmetry.folded(poses[kept], pose)
            if not same_mode(earlier, pose, self.model.axis, _ALIKE_DISTANCE,
                             _ALIKE_ANGLE).any():
                kept.append(k)
        return kept


class _Stages:
    """Tells the progress of each stage as a part of the whole; asked no more once stopped."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self.stopped = False

    def part(self, begin: float, end: float) -> Progress:
        """What to call with 0..1 in a stage that is from `begin` to `end` of the whole."""
        def progress(done: float) -> bool:
            if not self.stopped:
                self.stopped = not self._progress(begin + done * (end - begin))
            return not self.stopped
        return progress
