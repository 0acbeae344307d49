"""Learns the displacement of contours from the model, by comparing found and true poses."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize, minimize_scalar
from scipy.special import betaln

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.geometry.student_t import COMMON, credible_level, shape_scale
from pmcl_ros.learning.contour_tables import Example
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.render.back_end import Renderer
from pmcl_ros.pmcl.view_terms import ViewContour, ViewTerms
from pmcl_ros.runtime.errors import LocalizationError

LENGTH = 40.0  # px: correlation length of local displacements; chosen, not fitted
_FIRST = 0.25  # px: initial size of both errors
_LEAST, _MOST = 0.1, 10.0  # bounds of the scale, times the most likely errors
_DEGREES = 1.0, 1000.0  # of freedom: at the last a Student's t is a Gaussian


@dataclass(frozen=True)
class Deviation:
    """Deviation of a true pose from the one found, and the covariances that explain it.

    deviation: (d,) in the tangent space at the pose found [m, rad]. noise: (d, d) covariance of
    the posterior without a model error. common, local: (d, d) by model errors of 1 px. moved: (d,)
    by how much contours that are found 1 px too far outwards move the pose.
    """

    deviation: NDArray[np.float64]
    noise: NDArray[np.float64]
    common: NDArray[np.float64]
    local: NDArray[np.float64]
    moved: NDArray[np.float64]

    @classmethod
    def from_estimate(cls, example: Example, estimate: PoseEstimate, profile: ContourProfile,
                      renderer: Renderer) -> 'Deviation':
        """estimate: a right pose of the example's object, found with `profile` and no error."""
        pose, symmetry = estimate.pose, example.model.symmetry
        with renderer.contour_score(example.scene, example.volume, profile) as score:
            view = ViewContour(score.points(pose), example.volume, profile)
        common, local = (
            LocalModel.from_views(pose, symmetry, [view], error)
            for error in (ModelError(1, 0, LENGTH), ModelError(0, 1, LENGTH)))
        basis = common.basis
        noise = basis.T @ estimate.covariance @ basis
        terms = ViewTerms.from_view(view, pose, basis)
        moved = np.linalg.solve(common.information, terms.contributions.curvatures.sum(axis=0))
        truth = symmetry.nearest_equivalents(example.pose[None], pose)
        return cls(basis.T @ symmetry.local(truth, pose)[0], noise,
                   common.model_error, local.model_error, moved)

    def spread(self, common: float, local: float) -> NDArray[np.float64]:
        """(d, d) covariance by noise and model errors of these sizes [px]."""
        return self.noise + common ** 2 * self.common + local ** 2 * self.local

    def square(self, common: float, local: float) -> float:
        """The squared Mahalanobis distance of the truth, with model errors of these sizes [px]."""
        return float(self.deviation @ np.linalg.solve(self.spread(common, local), self.deviation))


def fitted_offset(given: Sequence[Deviation]) -> float:
    """Where contours are found, from where these searches read them, outwards [px].

    It is the most likely mean displacement. Raises LocalizationError where there are no poses.
    """
    common, local = _most_likely(given, lambda common, local: _mean(given, common, local))
    return _mean(given, common, local)


def _mean(given: Sequence[Deviation], common: float, local: float) -> float:
    """The mean displacement [px] by generalised least squares, for such model errors [px]."""
    weighted = [np.linalg.solve(each.spread(common, local), each.moved) for each in given]
    total = sum(float(weight @ each.moved) for each, weight in zip(given, weighted, strict=True))
    # The pose found is that of the displaced contour, the deviation leads back to the true one.
    return -sum(float(weight @ each.deviation)
                for each, weight in zip(given, weighted, strict=True)) / total


def _most_likely(given: Sequence[Deviation], mean: Callable[[float, float], float]
                 ) -> tuple[float, float]:
    """The common and the local error of the highest likelihood [px].

    mean: displacement of all contours, for such errors. Raises LocalizationError without poses.
    """
    if not given:
        raise LocalizationError('0 poses bound no displacement of contours; learn from more '
                                'scenes')

    def unlikely(logarithms: NDArray[np.float64]) -> float:
        common, local = np.exp(logarithms)
        offset, total = mean(common, local), 0.0
        for each in given:
            spread = each.spread(common, local)
            off = each.deviation + offset * each.moved
            total += 0.5 * (off @ np.linalg.solve(spread, off) + np.linalg.slogdet(spread)[1])
        return float(total)

    common, local = np.exp(minimize(unlikely, np.log([_FIRST, _FIRST]), method='Nelder-Mead').x)
    return float(common), float(local)


def fitted_error(given: Sequence[Deviation]) -> ModelError:
    """The model error of the most likely ratio, scaled to the nominal coverage.

    Errors have longer tails than Gaussians. So the common and the local error are scaled by one
    factor until regions of the level `COMMON` hold that share of the truths.
    Raises LocalizationError where no factor does.
    """
    common, local = _most_likely(given, lambda *_: 0.0)

    def excess(scale: float) -> float:
        levels = credible_level([each.square(scale * common, scale * local) for each in given],
                                [len(each.deviation) for each in given], math.inf)
        return float(np.quantile(levels, COMMON)) - COMMON

    if excess(_LEAST) < 0 or excess(_MOST) > 0:
        raise LocalizationError(f'{len(given)} poses do not bound the displacement of contours; '
                                'learn from more scenes')
    scale = brentq(excess, _LEAST, _MOST)
    return ModelError(scale * common, scale * local, LENGTH)


def fitted_degrees_of_freedom(squares: Sequence[float], dimensions: Sequence[int]) -> float:
    """The most likely Student's t of errors, among those whose 90 % region is a Gaussian's.

    squares: (n,) squared Mahalanobis distances of truths by that Gaussian. dimensions: (n,).
    """
    square, d = np.asarray(squares, float), np.asarray(dimensions, float)

    def unlikely(logarithm: float) -> float:
        degrees = math.exp(logarithm)
        scale = shape_scale(d, degrees) * degrees
        # The square over the scale is beta prime distributed; what does not depend on the degrees
        # is left out.
        return float((betaln(d / 2, degrees / 2) + d / 2 * np.log(scale)
                      + (d + degrees) / 2 * np.log1p(square / scale)).sum())

    best = minimize_scalar(unlikely, bounds=np.log(_DEGREES), method='bounded').x
    return float(f'{math.exp(best):.2g}')
