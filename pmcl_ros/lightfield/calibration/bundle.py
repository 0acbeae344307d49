"""Bundle adjustment: camera, poses and the board's bend from all corners, and uncertainty."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.sheet_pose import tilts
from pmcl_ros.lightfield.calibration.bend import Sheet, bend_cost, bend_information
from pmcl_ros.lightfield.calibration.camera_model import PARAMETERS, Model, predict
from pmcl_ros.lightfield.calibration.corners import Corners
from pmcl_ros.runtime.errors import LightFieldError

_LOG = logging.getLogger(__name__)

_OUTLYING, _WILD = 3.0, 6.0  # standard deviations
_STEPS, _HALVINGS = 50, 12  # Gauss-Newton steps, and halvings of one that raises the cost
_DONE = 1e-9  # relative change of the cost
_STEP = 1e-6  # for derivatives, of the usual sizes of the camera's and a pose's parameters:
_SIZES = np.array([1e3, 1e3, 1e2, 1e2, 1e-3, 1, 1, 1, 1, 1, 1, 0.1, 0.1, 0.1])
_PLACE = 0.1  # the same, of a corner's place on the board
_MODELS = [Model(focals, distortions) for focals in (2, 1) for distortions in (2, 1, 0)]
_BASELINE, _FOCUS = 7e-4, 2.0  # m, 1/m: typical of an F01, used where corners give no estimate
_OPEN = 1e-6  # least eigenvalue of correlations: less is rounding; that of good boards is 0.005
_DISTINCT = 3  # least number of different boards in a resample


@dataclass(frozen=True)
class Observations:
    """n pictures of a board with m corners.

    points: (m, 3) on the board, metres, z = 0: while it is flat.
    values: (n, m, 4) position and disparity of every corner, as in `Corners`.
    whitening: (n, m, 4, 4) W with W^T W = the inverse of the covariance; 0: not measured.
    """

    points: NDArray[np.float64]
    values: NDArray[np.float64]
    whitening: NDArray[np.float64]

    @classmethod
    def from_corners(cls, boards: Sequence[Corners], square: float) -> 'Observations':
        """square: side of the board's squares [m]."""
        rows, columns = boards[0].valid.shape
        y, x = np.mgrid[:rows, :columns] * square
        points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        values, whitening = [], []
        for board in boards:
            values.append(np.concatenate([board.positions, board.disparities], axis=-1)
                          .reshape(-1, 4))
            valid = board.valid.reshape(-1)
            covariances = np.where(valid[:, None, None], board.covariances.reshape(-1, 4, 4),
                                   np.eye(4))
            roots = np.linalg.inv(np.linalg.cholesky(covariances))
            whitening.append(roots * valid[:, None, None])
        return cls(points, np.stack(values), np.stack(whitening))

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(n, m) which corners were measured."""
        return np.asarray(self.whitening.any(axis=(-1, -2)))

    @cached_property
    def sheet(self) -> Sheet:
        """The board's, which is the same in all pictures."""
        return Sheet(self.points)

    def excluding(self, dropped: NDArray[np.bool_]) -> 'Observations':
        """Without some corners (n, m)."""
        return replace(self, whitening=self.whitening * ~dropped[..., None, None])


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


def initial_guess(observations: Observations, width: int,
                  height: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The camera (8,) and the poses (n, 6), nearly right; width, height: of a view.

    A distant plane looks nearly the same when it is tilted to the other side: the disparities
    decide. Raises LightFieldError when the positions of the corners are those of no
    planes.
    """
    seen = [(observations.points[valid].astype(np.float32),
             values[valid, :2].astype(np.float32))
            for valid, values in zip(observations.valid, observations.values, strict=True)]
    fixed = (cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_PRINCIPAL_POINT
             | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2
             | cv2.CALIB_FIX_K3)
    try:
        _, matrix, _, turns, origins = cv2.calibrateCamera(
            [points for points, _ in seen], [pixels for _, pixels in seen], (width, height),
            np.eye(3), np.zeros(5), flags=fixed)
        either = [[np.concatenate(each) for each
                   in tilts(points, pixels, np.asarray(matrix, float), np.zeros(5))]
                  for points, pixels in seen]
    except cv2.error as error:
        raise LightFieldError(
            f'the corners of the boards are those of no plane ({error.err}); are --corners and '
            '--square those of the board?') from None
    camera = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], _BASELINE, _FOCUS,
                       0, 0])
    poses = np.array([np.concatenate([turn.ravel(), origin.ravel()])
                      for turn, origin in zip(turns, origins, strict=True)])
    camera = _with_baseline(observations, camera, poses)
    for board, candidates in enumerate(either):
        found = np.array([*candidates, poses[board]])
        off = predict(observations.points, camera, found) - observations.values[board]
        off = off[:, observations.valid[board], 2:]
        # The slope over the board depends on the tilt, the middle on the distance.
        off = np.abs(off - np.median(off, axis=1, keepdims=True))
        poses[board] = found[np.median(off, axis=(1, 2)).argmin()]
    return _with_baseline(observations, camera, poses), poses


def _with_baseline(observations: Observations, camera: NDArray[np.float64],
                   poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """The camera with the baseline and the focus that explain the disparities of boards at poses.

    The disparity fx baseline (focus - 1 / z) is a line over 1 / z.
    """
    camera = camera.copy()
    apart = np.array([0.0, 0, 0, 0, 1, 0, 0, 0]) + camera * [1, 1, 1, 1, 0, 0, 0, 0]
    inverse = -predict(observations.points, apart, poses)[..., 2:][observations.valid]
    measured = observations.values[..., 2:][observations.valid]
    focal = camera[0]
    line = np.stack([np.full(inverse.size, focal), -inverse.ravel()], axis=1)
    (offset, baseline), *_ = np.linalg.lstsq(line, measured.ravel(), rcond=None)
    if baseline > 0 and offset > 0:
        camera[4:6] = baseline, offset / baseline
    return camera


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
