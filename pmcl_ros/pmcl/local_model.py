"""Contours of a pose -> LocalModel: gradient, curvature and covariance; Gauss-Newton on it.

The evidence is that of one view, or the sum over several.

To first order, a small motion of the object moves each point of its contour along its normal in
the image. The evidence along the normals is smooth: it gives the evidence of all poses nearby
from one rendering, without the steps of a rasteriser.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.nuisances import Eliminated, Nuisances
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.gauss_newton import LEAST_CURVATURE, WIDEST
from pmcl_ros.pmcl.view_terms import REACH, ViewContour, ViewTerms, sums_over_pairs

_LEAST_FREE = 0.25  # share of the degrees of freedom that remain, however short the contour is
_LEAST_VARIANCE = 0.05  # of the slope of a contribution: no capture is without noise
_FARTHEST = 1.0  # px, rms along the contour: largest step; the model does not hold farther off
_CONVERGED = 0.02  # px, rms along the contour, and of nuisances: shortest step
_NEGLIGIBLE = 1e-3  # weight of a point of a contour; points of less are left out


@dataclass(frozen=True)
class LocalModel:
    """Evidence about a pose, expanded in the tangent space there (`Symmetry.tangent_basis`).

    evidence, length: of the contour, sums over it [nat, px].
    basis: (6, d), columns of the tangent space.
    gradient: (d,) of the evidence. information: (d, d) minus its second derivative, H.
    variability: (d, d) covariance of the gradient over the noise of such captures, J.
    model_error: (d, d) covariance of the pose by the model error (`ModelError`).
    moments: (d, d) mean over the contour of the products of its motions [px^2].
    nuisances: that were eliminated, else None.
    """

    evidence: float
    length: float
    basis: NDArray[np.float64]
    gradient: NDArray[np.float64]
    information: NDArray[np.float64]
    variability: NDArray[np.float64]
    model_error: NDArray[np.float64]
    moments: NDArray[np.float64]
    nuisances: Eliminated | None = None

    @classmethod
    def from_views(cls, pose: NDArray[np.float64], symmetry: Symmetry,
                   views: Sequence[ViewContour], error: ModelError | None,
                   nuisances: Nuisances | None = None) -> 'LocalModel':
        """The model about `pose` (4, 4), by its contour in all views.

        symmetry: of the object. error: of the model; None: gradient and information only, without
        the covariances, at a tenth of the cost. nuisances: are eliminated: gradient,
        information and what follows are those of the pose alone.
        """
        basis = symmetry.tangent_basis(pose)
        terms = [ViewTerms.from_view(each, pose, basis, nuisances is not None) for each in views]
        length = sum(each.length for each in terms)
        d, weak = basis.shape[1], weak_information(basis)
        least = weak / LEAST_CURVATURE
        moments = sum((each.moments[:d, :d] for each in terms), least)
        evidence = sum(each.evidence for each in terms)
        eliminated, whole = None, terms
        if nuisances is not None:
            eliminated, terms = nuisances.eliminated(basis, terms)
            evidence += eliminated.evidence
        gradient = np.sum([each.gradient for each in terms], axis=0)
        information = sum((each.information for each in terms), weak)
        variability, off = information, np.zeros_like(information)
        if error is not None and length > 0:
            stretched = [each.stretches() for each in terms if len(each.points.lengths)]
            together, displaced = sums_over_pairs(stretched, error)
            # The slopes at the best pose are smaller than at the true one, as d directions of them
            # were fitted. A stretch of REACH counts as one degree of freedom.
            free = max(1 - len(gradient) * REACH / length, _LEAST_FREE)
            noise = _LEAST_VARIANCE * sum((each.moments for each in terms), least)
            variability = together / free + noise
            # The model error moves the contour; the pose follows by weighted least squares.
            off = np.linalg.solve(information, np.linalg.solve(information, displaced).T)
            off = without_negative(off)  # the limit of `same_side` can make eigenvalues negative
            if eliminated is not None:
                eliminated = eliminated.with_scatter(information, whole, error)
        return cls(evidence, length, basis, gradient, information, variability, off,
                   moments / max(length, 1.0), eliminated)

    @property
    def scale(self) -> float:
        """Factor that turns the evidence into a log likelihood.

        The noise of neighbouring contributions is correlated, so their sum is overconfident.
        Scaled by d / tr(H^-1 J), at most 1, the posterior is on average as wide as the estimates
        scatter (Godambe's information; magnitude adjustment of Ribatet, Cooley, Davison 2012).
        Where there are nuisances it is that of the views without them.
        """
        if self.nuisances is not None:
            return self.nuisances.scale
        loss = float(np.trace(np.linalg.solve(self.information, self.variability)))
        return len(self.gradient) / max(loss, len(self.gradient))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(6, 6) of the posterior, without the model's error."""
        return self.basis @ np.linalg.inv(self.scale * self.information) @ self.basis.T

    @property
    def spread(self) -> NDArray[np.float64]:
        """(6, 6) the same with the model's error."""
        return self.covariance + self.basis @ self.model_error @ self.basis.T

    @property
    def step(self) -> NDArray[np.float64]:
        """(6,) tangent vector to the best pose nearby: a Gauss-Newton step of bounded length."""
        step = np.asarray(self.basis @ np.linalg.solve(self.information, self.gradient), float)
        return step * min(1.0, _FARTHEST / max(self.motion(step), 1e-9))

    def motion(self, step: NDArray[np.float64]) -> float:
        """How far a tangent vector (6,) moves the contour, rms along it [px]."""
        tangent = self.basis.T @ step
        return float(np.sqrt(tangent @ self.moments @ tangent))


@dataclass(frozen=True)
class Observation:
    """The contour and the evidence of an object at a pose.

    pose: (4, 4), object to camera [m]. points: of its contour, as if no other object were there.
    depth: (height, width) float32 of its surface in the image [m], 0 elsewhere.
    local: model of the evidence about the pose. in_view: share of the object in the image.
    """

    pose: NDArray[np.float64]
    points: ContourPoints
    depth: NDArray[np.float32]
    local: LocalModel
    in_view: float

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(6, 6) of the pose [m, rad], with the model error; none about an axis of symmetry."""
        return self.local.spread


def weak_information(basis: NDArray[np.float64]) -> NDArray[np.float64]:
    """(d, d) of a pose of which no view tells anything, in a tangent space with a basis (6, d)."""
    return np.asarray(LEAST_CURVATURE * basis.T @ np.diag(1 / WIDEST ** 2) @ basis)


def without_negative(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """A matrix (d, d), made symmetric, with 0 in place of negative eigenvalues."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray((vectors * np.maximum(values, 0)) @ vectors.T)


def weighted(points: ContourPoints, weights: NDArray[np.float64]) -> ContourPoints:
    """A contour with the lengths multiplied by weights (m,), 0 to 1, without points of about 0."""
    kept = weights > _NEGLIGIBLE
    return replace(
        points, pixels=points.pixels[kept], normals=points.normals[kept],
        depths=points.depths[kept], lengths=(points.lengths * weights)[kept],
        energies=points.energies[kept], evidence=points.evidence[kept],
        piece=points.piece[kept], along=points.along[kept], outer=points.outer[kept])


def gauss_newton(pose: NDArray[np.float64], nuisances: NDArray[np.float64],
                 local_model_at: Callable[[NDArray[np.float64], NDArray[np.float64]], LocalModel],
                 steps: int, feasible: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
                 still: bool = False
                 ) -> tuple[NDArray[np.float64], NDArray[np.float64], LocalModel]:
    """Refine a pose (4, 4) and nuisances (k,) by Gauss-Newton steps on local models of them.

    Returns the best that were reached in `steps` steps at most, and the model there.
    feasible: (n,) which of poses (n, 4, 4) are. still: the pose stays.
    """
    best = local_model_at(pose, nuisances)
    for _ in range(steps):
        step = 0 * best.step if still else best.step
        turn = (0 * nuisances if best.nuisances is None
                else best.nuisances.after(best.basis.T @ step))
        if best.motion(step) < _CONVERGED and np.abs(turn).max(initial=0.0) < _CONVERGED:
            break
        for part in (1.0, 0.5, 0.25):
            tried, moved = retract(pose, part * step[None])[0], nuisances + part * turn
            if not (still or feasible(tried[None])[0]):
                continue
            there = local_model_at(tried, moved)
            if there.evidence > best.evidence:
                pose, nuisances, best = tried, moved, there
                break
        else:
            break
    return pose, nuisances, best
