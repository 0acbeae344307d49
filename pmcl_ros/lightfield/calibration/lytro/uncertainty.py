"""How well the corners determine camera and poses: covariance and bootstrap."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.calibration.lytro.bundle import Fit, linearize

_OPEN = 1e-6  # least eigenvalue of correlations: less is rounding; that of good boards is 0.005
_DISTINCT = 3  # least number of different boards in a resample


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations of the camera's parameters (8,), 0: held fixed, as `PARAMETERS`.

    expected: from the covariance of the corners, scaled by the noise.
    of_corners, of_boards: of the bootstrap over the corners of each board, and over the boards,
        which includes errors common to the corners of one board; NaN: too few boards.
    camera: the larger of the two. poses: (n, 6) of the boards' poses [rad, m].
    """

    expected: NDArray[np.float64]
    of_corners: NDArray[np.float64]
    of_boards: NDArray[np.float64]
    camera: NDArray[np.float64]
    poses: NDArray[np.float64]


def uncertainty(fit: Fit, rng: np.random.Generator, resamples: int = 1000) -> Uncertainty:
    """The uncertainty of a fit.

    Each resample takes one Gauss-Newton step from the fit; the poses follow camera and bend and
    are eliminated, so that a resample costs a sum of small matrices. Raises numpy's LinAlgError
    when the corners leave a parameter open.
    """
    linear = linearize(fit.observations, fit.model, fit.camera, fit.poses, fit.bend, fit.noise)
    information, gradient = linear.information(), linear.gradient()
    boards, corners = gradient.shape[:2]
    total, free = information.sum(axis=(0, 1)) + np.diag(linear.prior), fit.model.free
    with_bend = total[:free, free:] @ np.linalg.solve(total[free:, free:], total[free:, :free])
    camera = total[:free, :free] - with_bend
    unit = 1 / np.sqrt(np.diag(camera))
    if not np.linalg.eigvalsh(camera * np.outer(unit, unit))[0] > _OPEN:
        raise np.linalg.LinAlgError
    covariance = fit.noise * np.linalg.inv(total)

    def spread(counts: NDArray[np.integer]) -> NDArray[np.float64]:
        """(free + k,) of the steps of resamples; counts (resamples, n, m) of every corner.

        The prior is one more measurement, which is drawn from its own errors.
        """
        matrices = np.tensordot(counts, information, 2) + np.diag(linear.prior)
        by_prior = linear.pull + np.sqrt(fit.noise * linear.prior) * rng.standard_normal(
            (len(counts), len(total)))
        slopes = np.tensordot(counts, gradient, 2) + by_prior
        steps = np.linalg.solve(matrices, slopes[..., None])[..., 0]
        low, high = np.percentile(steps, [15.87, 84.13], axis=0)
        return np.asarray((high - low) / 2)

    of_corners = spread(rng.multinomial(corners, np.full(corners, 1 / corners),
                                        (resamples, boards)))
    drawn = rng.multinomial(boards, np.full(boards, 1 / boards), resamples)
    drawn = drawn[(drawn > 0).sum(axis=1) >= _DISTINCT]
    of_boards = np.full(len(of_corners), np.nan)
    if boards > _DISTINCT:
        of_boards = spread(np.repeat(drawn[..., None], corners, axis=2))
    larger = np.fmax(of_corners, of_boards)
    scale = larger / np.sqrt(np.diag(covariance))
    moved = linear.follow @ (covariance * np.outer(scale, scale)) @ linear.follow.swapaxes(1, 2)
    poses = np.sqrt(np.diagonal(moved + fit.noise * linear.freedom, axis1=1, axis2=2))

    def of_camera(free: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.where(fit.model.basis.any(axis=1), free[fit.model.basis.argmax(axis=1)], 0)

    return Uncertainty(of_camera(np.sqrt(np.diag(covariance))), of_camera(of_corners),
                       of_camera(of_boards), of_camera(larger), poses)
