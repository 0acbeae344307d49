"""Modes of the evidence -> Posterior, a sample: in one view (of several: `joint_posterior`)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pmcl_ros.pmcl.contour_approximations import LinearizedContour
from pmcl_ros.pmcl.history import Watch, recorder
from pmcl_ros.pmcl.local_model import LocalModel, gauss_newton
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.sampler import Gaussian, sample_posterior
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.progress import Progress

Score = Callable[[NDArray[np.float64]], NDArray[np.float64]]
Contour = Callable[[NDArray[np.float64]], ContourPoints]
Feasible = Callable[[NDArray[np.float64]], NDArray[np.bool_]]
Refine = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]

_REFINEMENTS = 10  # Gauss-Newton steps at most; modes converge in about five
# Standard deviations of the initial Gaussian of a mode, relative to the local model: it must be
# wider than the mode, and cover neighbouring maxima.
_WIDEN = 2.5
_OTHER = 8.0  # standard deviations beyond which a mode is ignored


@dataclass(frozen=True)
class Mode:
    """A maximum of the evidence: its pose (4, 4), and the evidence nearby."""

    pose: NDArray[np.float64]
    local: LocalModel


@dataclass(frozen=True)
class Posterior:
    """poses: (n, 4, 4) equally weighted. own: (n,) index of the mode of each; best mode first.

    values: (n,) log posterior, but for a constant.
    """

    modes: tuple[Mode, ...]
    poses: NDArray[np.float64]
    values: NDArray[np.float64]
    own: NDArray[np.int64]


@dataclass(frozen=True)
class ContourPosterior:
    """Posterior of poses by contour evidence, at the resolution of the image.

    exact: evidence of poses, -inf outside the region of interest. local_model_at: the local model
    at a pose; with True also its uncertainty. linearize_at: the evidence near a pose. feasible:
    whether poses are in the region and satisfy the constraint. points_at: the points of a pose's
    contour that count; share_at: their share of it. inside_at: as of `PoseEstimate`.
    """

    model: ObjectModel
    settings: PmclSettings
    exact: Score
    local_model_at: Callable[[NDArray[np.float64], bool], LocalModel]
    linearize_at: Callable[[NDArray[np.float64]], LinearizedContour]
    feasible: Feasible
    points_at: Contour
    share_at: Callable[[NDArray[np.float64]], float] = lambda _: 1.0
    inside_at: Callable[[NDArray[np.float64]], float] = lambda _: math.nan

    def refine(self, pose: NDArray[np.float64]) -> Mode:
        """The mode near a pose (4, 4): Gauss-Newton steps on the local model."""
        best, _, _ = gauss_newton(pose, np.zeros(0), lambda each, _: self.local_model_at(
            each, False), _REFINEMENTS, self.feasible)
        return Mode(best, self.local_model_at(best, True))

    def sample(self, modes: Sequence[Mode], rng: np.random.Generator, progress: Progress,
               watch: Watch | None = None) -> Posterior:
        """`settings.particles` poses about modes, best first, by `sample_posterior`.

        progress: called with 0..1; returning False ends it with the particles so far. watch:
        called with every generation of them.
        """
        scale, symmetry = modes[0].local.scale, self.model.symmetry
        start_of = [
            Gaussian.from_covariance(mode.pose, _WIDEN ** 2 * mode.local.covariance, symmetry)
            for mode in modes]
        slides = [self.linearize_at(mode.pose) for mode in modes]

        def rough(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            terms = np.full((len(slides), len(poses)), -np.inf)
            for k, (each, slide) in enumerate(zip(start_of, slides, strict=True)):
                off = each.square_distance(poses)
                near = off < _OTHER ** 2
                deviations = symmetry.local(poses[near], each.pose)
                terms[k, near] = scale * slide.evidence(deviations) - 0.5 * off[near]
            return np.where(self.feasible(poses), logsumexp(terms, axis=0), -np.inf)

        poses, values, own = sample_posterior(
            [rough, lambda each: scale * self.exact(each)], start_of,
            self.settings.particles, self.settings.moves, rng, progress,
            [recorder(watch, 'approximate'), recorder(watch, 'posterior')])
        return Posterior(tuple(modes), poses, values, own)
