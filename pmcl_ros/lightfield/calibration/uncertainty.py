"""How sure a bundle adjustment is: its covariance, and two bootstraps."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.calibration.bundle import Fit, linearised

_DISTINCT = 3  # boards that a resample must hold: fewer do not tell a camera


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations of the camera's parameters (8,), 0: held fixed, as `PARAMETERS`.

    expected: from the covariance of the corners, scaled by the noise.
    of_corners, of_boards: of the bootstrap over the corners of each board, and over the boards,
        which also feels what the corners of one board have in common; NaN: too few boards.
    camera: the larger of the two. poses: (n, 6) of the boards' poses [rad, m].
    """

    expected: NDArray[np.float64]
    of_corners: NDArray[np.float64]
    of_boards: NDArray[np.float64]
    camera: NDArray[np.float64]
    poses: NDArray[np.float64]


def uncertainty(fit: Fit, rng: np.random.Generator, resamples: int = 1000) -> Uncertainty:
    """The uncertainty of a fit.

    Each resample takes one Gauss-Newton step from the fit; the poses follow the camera and are
    eliminated, so that a resample costs a sum of small matrices. Raises numpy's LinAlgError when
    the corners leave a parameter open.
    """
    linear = linearised(fit.observations, fit.model, fit.camera, fit.poses, fit.noise)
    information, gradient = linear.information(), linear.gradient()
    boards, corners = gradient.shape[:2]
    covariance = fit.noise * np.linalg.inv(information.sum(axis=(0, 1)))

    def spread(counts: NDArray[np.integer]) -> NDArray[np.float64]:
        """(free,) of the steps of resamples; counts (resamples, n, m) of every corner."""
        matrices = np.tensordot(counts, information, 2)
        steps = np.linalg.solve(matrices, np.tensordot(counts, gradient, 2)[..., None])[..., 0]
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

