"""How a sheet of paper with a board is bent, by the pictures that are taken while it rests."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.sheet_pose import LEAST_NOISE, sheet_pose
from pmcl_ros.lightfield.calibration.bend import USUAL_BEND, Sheet, bend_cost, bend_information

_LARGE_BEND = 1e-3  # m
_FREEDOM = 3.0  # of the corners' errors, Student's t: some are much larger, as behind glass
_STEPS, _HALVINGS = 60, 8
_DONE = 1e-6  # of the logarithm of the likelihood, for each corner
USUAL_ASIDE = 0.005  # error of a principal point, in focal lengths
_USUAL_LONGER = 0.1  # share by which a focal length is off: a board seen straight tells none
_CAMERA = 8  # fx, fy, cx, cy [px], k1, k2, p1, p2
_BY_POSE, _BY_CAMERA = slice(0, 6), slice(6, 14)  # columns of OpenCV's derivatives
_BY_PLACE = slice(3, 6)


@dataclass(frozen=True)
class BentBoard:
    """points: (m, 3) the corners as they lie [m], in the frame of the plane through them.
    heights: (m, k) a root of the covariance of their z [m]: times its transpose it is that.
    camera: (8,) fx, fy, cx, cy [px], k1, k2, p1, p2. covariance: (q, q) of what of it was
    adjusted. off: (n, m) distances of each picture's corners from where they are expected [px],
    NaN: not seen.
    """

    points: NDArray[np.float64]
    heights: NDArray[np.float64]
    camera: NDArray[np.float64]
    covariance: NDArray[np.float64]
    off: NDArray[np.float64]

    @property
    def pixels(self) -> NDArray[np.float64]:
        """(n,) rms distances of each picture's corners [px]."""
        return np.asarray(np.sqrt(np.nanmean(np.square(self.off), axis=1)))


def bent(pictures: Mapping[str, NDArray[np.float64]], flat: NDArray[np.float64], pinhole: Pinhole,
         near: Mapping[str, NDArray[np.float64]] | None = None) -> BentBoard:
    """The board as it lies, by pictures of a camera without distortion.

    pictures: by name, (m, 2) corners [px], NaN: not seen; some may be wrong. Each shows eight or
    more, not all on a line. flat: (m, 3) the corners [m], z = 0. near: of the same pictures, the
    corners by which poses begin, fewer of which are wrong.
    Raises LightFieldError for corners that are those of no board.
    """
    return _adjusted(pictures, flat, _undistorted(pinhole), np.zeros((_CAMERA, 0)), np.zeros(0),
                     near)


def bent_with_camera(pictures: Mapping[str, NDArray[np.float64]], flat: NDArray[np.float64],
                     camera: NDArray[np.float64]) -> BentBoard:
    """As `bent`, and the camera, which begins with (8,) and is adjusted, too.

    Raises numpy.linalg.LinAlgError where the pictures do not tell the camera.
    """
    return _adjusted(pictures, flat, camera, np.eye(_CAMERA), np.zeros(_CAMERA))


def bent_with_lens(pictures: Mapping[str, NDArray[np.float64]], flat: NDArray[np.float64],
                   pinhole: Pinhole) -> BentBoard:
    """As `bent`, and focal length and principal point, which are usually nearly those of pinhole.

    The covariance (3, 3) is that of the share by which the focal length differs, and of cx, cy.
    """
    camera, onto = _undistorted(pinhole), np.zeros((_CAMERA, 3))
    onto[[0, 1], 0], onto[2, 1], onto[3, 2] = camera[:2], 1, 1
    usual = np.array([_USUAL_LONGER, *2 * [USUAL_ASIDE * pinhole.fx]])
    return _adjusted(pictures, flat, camera, onto, 1 / usual ** 2)


class _Values(NamedTuple):
    """shared: (q + k,) what is unknown of the camera, and heights of the bend's terms [m]. poses:
    (n, 6) of the pictures: rotation vectors, and origins [m]. variance: square of the scale of the
    corners' errors [px^2].
    """

    shared: NDArray[np.float64]
    poses: NDArray[np.float64]
    variance: float

    def moved(self, step: '_Values', share: float) -> '_Values':
        """By a share of a step, with the same variance."""
        return self._replace(shared=self.shared + share * step.shared,
                             poses=self.poses + share * step.poses)


def _adjusted(pictures: Mapping[str, NDArray[np.float64]], flat: NDArray[np.float64],
              camera: NDArray[np.float64], onto: NDArray[np.float64],
              prior: NDArray[np.float64],
              near: Mapping[str, NDArray[np.float64]] | None = None) -> BentBoard:
    """Poses, bend, and what is unknown of the camera, adjusted together.

    camera: (8,) to begin with. onto: (8, q) its derivatives by what is unknown. prior: (q,)
    inverse variances of that. near: as of `bent`.
    A sheet that seems flat but for corners that are wrong may be bent instead: two beginnings.
    """
    bundle = _Bundle(pictures, flat, camera, onto, prior)
    begun = bundle.start(pictures if near is None else near)
    ends = [bundle.adjusted(start, USUAL_BEND)
            for start in (begun, bundle.adjusted(begun, _LARGE_BEND))]
    found = min(ends, key=lambda values: bundle.cost(values, USUAL_BEND))
    _, information = bundle.step(found, USUAL_BEND)
    every = bundle.spread(found) * np.asarray(np.linalg.inv(information), float)
    unknown = onto.shape[1]
    off = np.linalg.norm(bundle.off(found), axis=2)
    heights = bundle.sheet.terms @ np.linalg.cholesky(every[unknown:, unknown:])
    return BentBoard(bundle.points(found), heights, bundle.camera(found),
                     every[:unknown, :unknown], off)


class _Bundle:
    """Pictures, by name (m, 2) [px], of a board that is (m, 3) while it is flat [m].

    camera: (8,) to begin with. onto: (8, q) its derivatives by what is unknown. prior: (q,)
    inverse variances of that.
    """

    def __init__(self, pictures: Mapping[str, NDArray[np.float64]], flat: NDArray[np.float64],
                 camera: NDArray[np.float64], onto: NDArray[np.float64],
                 prior: NDArray[np.float64]) -> None:
        self._corners = np.stack([*pictures.values()])
        self._shown: NDArray[np.bool_] = np.asarray(np.isfinite(self._corners).all(axis=2))
        self._flat, self.sheet = flat, Sheet(flat)
        self._camera, self._onto, self._prior = camera, onto, prior
        self._unknown = onto.shape[1]
        self.count = int(self._shown.sum())

    def start(self, pictures: Mapping[str, NDArray[np.float64]]) -> _Values:
        """Flat, by each picture's corners (m, 2) alone."""
        poses = []
        for seen in pictures.values():
            own = np.isfinite(seen).all(axis=1)
            corners = seen[own]
            pose = sheet_pose(self._flat[own], corners, _matrix(self._camera), self._camera[4:])
            poses.append(np.concatenate(pose))
        values = _Values(
            np.zeros(self._unknown + self.sheet.terms.shape[1]), np.array(poses), np.inf)
        return self._with_variance(values, self._squares(values))

    def adjusted(self, values: _Values, size: float) -> _Values:
        """The most likely values nearby, of bends whose terms have a size [m].

        A bundle adjustment by Gauss-Newton steps; the scale of the corners' errors is estimated,
        too (expectation maximisation).
        """
        squares = self._squares(values)
        cost = self._cost(values, squares, size)
        for _ in range(_STEPS):
            step, _ = self.step(values, size)
            for halving in range(_HALVINGS):
                ahead = values.moved(step, 0.5 ** halving)
                left = self._squares(ahead)
                if self._cost(ahead, left, size) < cost:
                    values, squares = ahead, left
                    break
            values = self._with_variance(values, squares)
            before, cost = cost, self._cost(values, squares, size)
            if before - cost < _DONE * self.count:
                break
        return values

    def camera(self, values: _Values) -> NDArray[np.float64]:
        """(8,)."""
        return self._camera + self._onto @ values.shared[:self._unknown]

    def points(self, values: _Values) -> NDArray[np.float64]:
        """(m, 3) [m]."""
        return self.sheet.points(values.shared[self._unknown:])

    def off(self, values: _Values) -> NDArray[np.float64]:
        """(n, m, 2) seen less expected [px], NaN: not seen."""
        return self._projected(values)[0]

    def cost(self, values: _Values, size: float) -> float:
        """Negative logarithm of the likelihood and of the prior, without what is constant."""
        return self._cost(values, self._squares(values), size)

    def _cost(self, values: _Values, squares: NDArray[np.float64], size: float) -> float:
        off = squares / values.variance
        return float(
            self._prior @ np.square(values.shared[:self._unknown]) / 2
            + (_FREEDOM + 2) / 2 * np.log1p(off / _FREEDOM).sum()
            + self.count * np.log(values.variance)
            + bend_cost(values.shared[self._unknown:], size))

    def _with_variance(self, values: _Values, squares: NDArray[np.float64]) -> _Values:
        """The same with the variance that these weights give. squares: of the corners there."""
        mean = (_weights(squares / values.variance) * squares).sum() / self._free(values)
        return values._replace(variance=max(float(mean), LEAST_NOISE ** 2))

    def _free(self, values: _Values) -> int:
        """Numbers of the corners more than those that are adjusted, at least 1."""
        return max(2 * self.count - values.poses.size - len(values.shared), 1)

    def spread(self, values: _Values) -> float:
        """By what the inverse of the information is multiplied to be the covariance.

        That of an M-estimator (Huber, "Robust Statistics", 1981, section 7.6).
        """
        squares = self._squares(values) / values.variance
        weights = _weights(squares)
        pull = max((np.square(weights) * squares).sum() / self._free(values),
                   (weights.mean() * LEAST_NOISE) ** 2 / values.variance)
        slope = (weights * _FREEDOM / (_FREEDOM + squares)).mean()
        return float(pull / slope ** 2 * weights.mean())

    def step(self, values: _Values, size: float) -> tuple[_Values, NDArray[np.float64]]:
        """The Gauss-Newton step, and the information on what is shared, whatever the poses are."""
        variance = values.variance
        prior = np.concatenate([
            self._prior, bend_information(values.shared[self._unknown:], size)])
        off, by_pose, by_shared = self._slopes(values)
        off = np.where(self._shown[..., None], off, 0)
        weights = self._shown * _weights(np.square(off).sum(axis=2)
                                         / variance) / variance
        root = np.sqrt(weights).repeat(2, axis=1)[..., None]
        left, shared = root * off.reshape(root.shape), root * by_shared
        basis, triangle = np.linalg.qr(root * by_pose)
        onto = basis.transpose(0, 2, 1)
        apart = np.concatenate(shared - basis @ (onto @ shared))  # without what poses take up
        information = np.diag(prior) + apart.T @ apart
        slope = apart.T @ left.ravel() - prior * values.shared
        unit = 1 / np.sqrt(np.diag(information))  # of values with different units
        step = unit * np.linalg.solve(information * np.outer(unit, unit), unit * slope)
        poses = np.linalg.solve(triangle, onto @ (left - (shared @ step)[..., None]))
        return _Values(step, poses[..., 0], variance), information

    def _squares(self, values: _Values) -> NDArray[np.float64]:
        """(count,) of all corners [px^2]."""
        return np.asarray(np.square(self.off(values)[self._shown]).sum(axis=1))

    def _slopes(self, values: _Values) -> tuple[NDArray[np.float64], ...]:
        """As `off`, and derivatives of what is expected, x and y in turn: by the poses
        (n, 2 m, 6), and by what is shared (n, 2 m, q + k).
        """
        off, slopes = self._projected(values)
        turns = np.stack([cv2.Rodrigues(each)[0] for each in values.poses[:, :3]])
        by_place = (slopes[..., _BY_PLACE] @ turns).reshape(*off.shape, 3)
        by_bend = by_place @ self.sheet.derivatives(values.shared[self._unknown:])
        return off, slopes[..., _BY_POSE], np.concatenate([
            slopes[..., _BY_CAMERA] @ self._onto,
            by_bend.reshape(*slopes.shape[:2], -1)], axis=2)

    def _projected(self, values: _Values) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """As `off`, and OpenCV's derivatives (n, 2 m, 14) of what is expected."""
        points, camera = self.points(values), self.camera(values)
        matrix = _matrix(camera)
        found = [cv2.projectPoints(points, pose[:3], pose[3:], matrix, camera[4:])
                 for pose in values.poses]
        expected, slopes = (np.stack([np.asarray(each, float) for each in of])
                            for of in zip(*found, strict=True))
        return self._corners - expected[:, :, 0], slopes


def _weights(squares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of corners by the squares of how far they are off, in scales of their errors."""
    return (_FREEDOM + 2) / (_FREEDOM + squares)


def _undistorted(pinhole: Pinhole) -> NDArray[np.float64]:
    """(8,) as of `BentBoard.camera`."""
    return np.array([pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy, 0, 0, 0, 0], float)


def _matrix(camera: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([[camera[0], 0, camera[2]], [0, camera[1], camera[3]], [0, 0, 1]])
