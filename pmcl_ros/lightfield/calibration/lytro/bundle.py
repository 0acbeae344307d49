"""Bundle adjustment: camera, poses and the board's bend from the corners of all pictures."""

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.calibration.bend import bend_cost, bend_information
from pmcl_ros.lightfield.calibration.lytro.camera_model import PARAMETERS, Model, predict
from pmcl_ros.lightfield.calibration.lytro.observations import Observations
from pmcl_ros.runtime.errors import LightFieldError

_LOG = logging.getLogger(__name__)

_OUTLYING, _WILD = 3.0, 6.0  # standard deviations
_STEPS, _HALVINGS = 50, 12  # Gauss-Newton steps, and halvings of one that raises the cost
_DONE = 1e-9  # relative change of the cost
_STEP = 1e-6  # for derivatives, of the usual sizes of the camera's and a pose's parameters:
_SIZES = np.array([1e3, 1e3, 1e2, 1e2, 1e-3, 1, 1, 1, 1, 1, 1, 0.1, 0.1, 0.1])
_PLACE = 0.1  # the same, of a corner's place on the board
_MODELS = [Model(focals, distortions) for focals in (2, 1) for distortions in (2, 1, 0)]


@dataclass(frozen=True)
class Fit:
    """The most likely camera, poses and bend.

    camera: (8,) as `PARAMETERS`. poses: (n, 6) of the boards, rotation vector and origin [m].
    bend: (k,) heights of the terms of the bend [m], of the one sheet that all pictures show.
    residuals: (n, m, 4) measured minus predicted, in standard deviations of the corners' own
        covariances. noise: the variance of these residuals, outliers apart.
    cost: their sum of squares, outliers counted less, and what the bend costs by its prior.
    """

    model: Model
    observations: Observations
    camera: NDArray[np.float64]
    poses: NDArray[np.float64]
    bend: NDArray[np.float64]
    residuals: NDArray[np.float64]
    noise: float
    cost: float


def bundle_adjust(observations: Observations, model: Model, camera: NDArray[np.float64],
                  poses: NDArray[np.float64], noise: float = 1.0,
                  bend: NDArray[np.float64] | None = None) -> Fit:
    """The most likely camera, poses and bend, from a start, by Gauss-Newton steps.

    noise: as in `Fit`; residuals beyond three standard deviations have a linear cost (Huber).
    bend: None: flat.
    Raises LightFieldError when no camera explains the corners.
    """
    basis = model.basis
    camera = basis @ (basis.T @ camera / basis.sum(axis=0))
    bend = np.zeros(observations.sheet.terms.shape[1]) if bend is None else bend
    residuals = _residuals(observations, camera, poses, bend)
    cost = _cost(residuals, bend, noise)
    for _ in range(_STEPS):
        try:
            shared, by_pose = linearize(observations, model, camera, poses, bend, noise).step()
        except np.linalg.LinAlgError:
            break
        by_camera, by_bend = basis @ shared[:model.free], shared[model.free:]
        for part in 0.5 ** np.arange(_HALVINGS):
            moved = camera + part * by_camera, poses + part * by_pose, bend + part * by_bend
            residuals = _residuals(observations, *moved)
            if _cost(residuals, moved[-1], noise) <= cost:
                break
        else:
            break
        (camera, poses, bend), before = moved, cost
        cost = _cost(residuals, bend, noise)
        if before - cost <= _DONE * cost:
            break
    residuals = _residuals(observations, camera, poses, bend)
    if not (np.isfinite(cost) and camera[0] > 0 and camera[4] > 0):
        raise LightFieldError(f'no camera explains the corners of the boards (fx {camera[0]:.4g} '
                              f'px, baseline {camera[4]:.3g} m); are --corners and --square those '
                              'of the board?')
    # Of a Gaussian half lies within 0.67 standard deviations.
    spread = float((np.median(np.abs(residuals[observations.valid])) / 0.6745) ** 2)
    return Fit(model, observations, camera, poses, bend, residuals, spread, cost)


def select_model(observations: Observations, camera: NDArray[np.float64],
                 poses: NDArray[np.float64]) -> tuple[Fit, dict[Model, float]]:
    """The fit of the best model by Schwarz's criterion (BIC), and the gain of every model.

    First, corners beyond six standard deviations from the smallest model are dropped, the worst
    before the others.
    An additional focal length or distortion term must lower the robust sum of squares, in units of
    the largest model's noise, by more than the logarithm of the number of measured values (by
    chance this happens once in some 200 calibrations). The gain of a model is its reduction of
    that sum minus this penalty; the selected model has the largest gain.
    """
    first = bundle_adjust(observations, Model(), camera, poses)
    for _ in range(_STEPS):
        off = np.abs(first.residuals).max(axis=-1)
        wild = off > max(_WILD * np.sqrt(first.noise), off.max() / 2)  # the worst bias the others
        if not wild.any():
            break
        observations = observations.excluding(wild)
        first = bundle_adjust(observations, Model(), first.camera, first.poses, first.noise,
                              first.bend)
    fits: list[Fit] = []
    noise = first.noise
    for model in _MODELS:
        try:
            fit = bundle_adjust(observations, model, first.camera, first.poses, noise, first.bend)
            if not fits:  # the largest: its residuals estimate the noise by which all count
                noise = fit.noise
                fit = bundle_adjust(observations, model, fit.camera, fit.poses, noise, fit.bend)
            fits.append(fit)
        except LightFieldError as error:
            _LOG.info('%s: %s', model, error)  # the corners do not determine this model
    if not fits or fits[-1].model != Model():
        raise LightFieldError('no camera explains the corners of the boards')
    least = fits[-1].cost
    price = np.log(4 * observations.valid.sum())
    gains = {fit.model: float((least - fit.cost) / noise
                              - price * (fit.model.free - Model().free)) for fit in fits}
    return max(fits, key=lambda fit: gains[fit.model]), gains


@dataclass(frozen=True)
class Linearization:
    """In what the pictures share: the camera's free parameters and the bend.

    The poses are eliminated (Schur complement).
    jacobian: (n, m, 4, free + k) of the predictions, while every pose follows what is shared to
        its own best fit by `follow` (n, 6, free + k). freedom: (n, 6, 6) inverse of the
        information on each pose. residuals: (n, m, 4). All are weighted: outliers count less.
    prior: (free + k,) information of the prior, 0: none. pull: (free + k,) its gradient.
    to_pose: (n, 6) step of each pose where nothing else moves.
    """

    jacobian: NDArray[np.float64]
    follow: NDArray[np.float64]
    freedom: NDArray[np.float64]
    residuals: NDArray[np.float64]
    prior: NDArray[np.float64]
    pull: NDArray[np.float64]
    to_pose: NDArray[np.float64]

    def information(self) -> NDArray[np.float64]:
        """(n, m, free + k, free + k) of each corner."""
        return np.asarray(self.jacobian.swapaxes(-1, -2) @ self.jacobian)

    def gradient(self) -> NDArray[np.float64]:
        """(n, m, free + k) of each corner."""
        return np.asarray((self.jacobian.swapaxes(-1, -2) @ self.residuals[..., None])[..., 0])

    def step(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Gauss-Newton steps of what is shared (free + k,) and of the poses (n, 6)."""
        shared = np.linalg.solve(self.information().sum(axis=(0, 1)) + np.diag(self.prior),
                                 self.gradient().sum(axis=(0, 1)) + self.pull)
        return shared, self.to_pose - self.follow @ shared


def linearize(observations: Observations, model: Model, camera: NDArray[np.float64],
              poses: NDArray[np.float64], bend: NDArray[np.float64], noise: float,
              ) -> Linearization:
    """About a camera, poses and a bend; numpy's LinAlgError when a board's pose is open."""
    of_camera, of_pose, of_bend = _derivatives(observations, camera, poses, bend)
    residuals = _residuals(observations, camera, poses, bend)
    limit = _OUTLYING * np.sqrt(noise)
    weights = np.sqrt(limit / np.maximum(np.abs(residuals), limit))
    boards, corners = residuals.shape[:2]
    left = (residuals * weights).reshape(boards, corners * 4)
    of_shared = np.concatenate([of_camera @ model.basis, of_bend], axis=-1)
    a = (of_shared * weights[..., None]).reshape(boards, corners * 4, -1)
    p = (of_pose * weights[..., None]).reshape(boards, corners * 4, -1)
    freedom = np.linalg.inv(p.swapaxes(1, 2) @ p)
    solve = freedom @ p.swapaxes(1, 2)
    follow = solve @ a
    none = np.zeros(model.free)
    prior = noise * bend_information(bend)
    return Linearization((a - p @ follow).reshape(boards, corners, 4, -1), follow, freedom,
                         left.reshape(residuals.shape), np.append(none, prior),
                         np.append(none, -prior * bend), (solve @ left[..., None])[..., 0])


def _derivatives(observations: Observations, camera: NDArray[np.float64],
                 poses: NDArray[np.float64], bend: NDArray[np.float64],
                 ) -> tuple[NDArray[np.float64], ...]:
    """Of the whitened predictions: (n, m, 4, 8) to the camera, (n, m, 4, 6) to a board's own pose,
    (n, m, 4, k) to the bend.

    Central differences: a corner depends on 14 numbers and its own place only.
    """
    points, sizes = observations.sheet.points(bend), np.append(_SIZES, 3 * [_PLACE])
    of_pose, of_place = len(PARAMETERS), len(_SIZES)

    def difference(parameter: int) -> NDArray[np.float64]:
        step = np.eye(len(sizes))[parameter] * _STEP * sizes
        ahead, behind = (predict(points + sign * step[of_place:], camera + sign * step[:of_pose],
                                 poses + sign * step[of_pose:of_place]) for sign in (1, -1))
        return np.asarray((ahead - behind) / (2 * step.sum()))

    columns = np.stack([difference(each) for each in range(len(sizes))], axis=-1)
    whitened = observations.whitening @ columns
    return (whitened[..., :of_pose], whitened[..., of_pose:of_place],
            whitened[..., of_place:] @ observations.sheet.derivatives(bend))


def _residuals(observations: Observations, camera: NDArray[np.float64],
               poses: NDArray[np.float64], bend: NDArray[np.float64]) -> NDArray[np.float64]:
    left = observations.values - predict(observations.sheet.points(bend), camera, poses)
    return np.asarray((observations.whitening @ left[..., None])[..., 0])


def _cost(residuals: NDArray[np.float64], bend: NDArray[np.float64], noise: float) -> float:
    """Huber's: the square up to the limit, linear beyond; and the prior's."""
    size, limit = np.abs(residuals), _OUTLYING * np.sqrt(noise)
    return float(np.where(size <= limit, size ** 2, 2 * limit * size - limit ** 2).sum()
                 + 2 * noise * bend_cost(bend))
