"""The posterior about maxima of the evidence, and a sample of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pmcl_ros.pmcl.ascent import ascent
from pmcl_ros.pmcl.history import Watch, recorder
from pmcl_ros.pmcl.linearized_contour import LinearizedContour
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.sampler import Gaussian, sample_posterior
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.progress import Progress

Score = Callable[[NDArray[np.float64]], NDArray[np.float64]]
Ascend = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]

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
class ContourPosterior:
    """What contour evidence says of poses, at the image's own resolution.

    exact: evidence of poses, -inf outside the region of interest. about: the local model about a
    pose; with True also how sure it is. near: the evidence near a pose. inside: whether poses are
    in the region.
    """

    model: ObjectModel
    settings: PmclSettings
    exact: Score
    about: Callable[[NDArray[np.float64], bool], LocalModel]
    near: Callable[[NDArray[np.float64]], LinearizedContour]
    inside: Callable[[NDArray[np.float64]], NDArray[np.bool_]]

    def refined(self, pose: NDArray[np.float64]) -> Mode:
        """The mode nearby: Gauss-Newton steps on the local model."""
        best, _ = ascent(pose, lambda each: self.about(each, False), _REFINEMENTS, _CONVERGED,
                         lambda each: bool(self.inside(each[None])[0]))
        return Mode(best, self.about(best, True))

    def sampled(self, modes: Sequence[Mode], rng: np.random.Generator, progress: Progress,
                watch: Watch | None = None) -> Posterior:
        """The posterior about modes, best first."""
        scale, symmetry = modes[0].local.scale, self.model.symmetry
        start_of = [Gaussian.of(mode.pose, _WIDEN ** 2 * mode.local.covariance, symmetry)
                    for mode in modes]
        slides = [self.near(mode.pose) for mode in modes]

        def rough(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            terms = np.full((len(slides), len(poses)), -np.inf)
            for k, (each, slide) in enumerate(zip(start_of, slides, strict=True)):
                off = each.square_distance(poses)
                near = off < _OTHER ** 2
                deviations = symmetry.local(poses[near], each.pose)
                terms[k, near] = scale * slide.evidence(deviations) - 0.5 * off[near]
            return np.where(self.inside(poses), logsumexp(terms, axis=0), -np.inf)

        poses, values, own = sample_posterior(
            [rough, lambda each: scale * self.exact(each)], start_of,
            self.settings.particles, self.settings.moves, rng, progress,
            [recorder(watch, 'approximate'), recorder(watch, 'posterior')])
        return Posterior(tuple(modes), poses, values, own)
