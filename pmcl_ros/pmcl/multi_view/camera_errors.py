"""Stated errors of the views' camera poses -> nuisance motions of unit variance (`nuisances`)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.posed_evidence import PosedEvidence
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import retract

CLEARLY_LARGER = 1.5  # factor by which errors are clearly larger than stated
_CLEARLY_WRONG = 2.5  # standard deviations of a scale error
_FREEDOM = 4.0  # degrees of freedom of stated errors: they are known to a factor of about 1.5
_ITERATIONS = 50
_UNTOLD = 1e-6  # information about a motion, with a prior of 1: views tell nothing of it
_LEAST_NOISE = 0.1  # of what the curvature lets expect: no capture is without noise


@dataclass(frozen=True)
class CameraErrors:
    """How uncertain motions z (k,), of unit variance, move the cameras.

    root: (views, 6, k): camera v is off by the tangent vector root[v] @ z [m, rad] in its own
    frame. Views of a group share a part of z.
    """

    root: NDArray[np.float64]

    @classmethod
    def from_views(cls, views: Sequence[PosedEvidence]) -> 'CameraErrors':
        """Of what is known of the views' poses; k is 0 where they are exact."""
        variance = np.square([each.sigma for each in views])  # of position and rotation
        common = np.array([[each.common if each.group else 0.0] for each in views]) * variance
        own = variance - common
        own[:, 0] += np.square([each.drift for each in views])
        columns = _columns(own * np.eye(len(views))[:, :, None])
        columns += _columns([
            common * [[each.group == group] for each in views]
            for group in sorted({each.group for each in views if each.group})])
        return cls(np.stack(columns, axis=-1) if columns else np.zeros((len(views), 6, 0)))

    def with_scale(self, cameras: NDArray[np.float64], about: NDArray[np.float64], sigma: float
                   ) -> 'CameraErrors':
        """With a last motion: all cameras (n, 4, 4) farther from a place (3,), by a share.

        sigma: standard deviation of that share.
        """
        away = np.einsum('nji,nj->ni', cameras[:, :3, :3], cameras[:, :3, 3] - about)
        off = np.concatenate([-sigma * away, np.zeros_like(away)], axis=1)
        return CameraErrors(np.concatenate([self.root, off[:, :, None]], axis=2))

    @property
    def number(self) -> int:
        """k, of motions."""
        return self.root.shape[2]

    def enlarged(self, factor: float) -> 'CameraErrors':
        """With standard deviations multiplied by a factor."""
        return CameraErrors(factor * self.root)

    def moved(self, cameras: NDArray[np.float64], motions: NDArray[np.float64]
              ) -> NDArray[np.float64]:
        """Cameras (n, 4, 4) as motions (k,) put them."""
        off = retract(np.tile(np.eye(4), (len(cameras), 1, 1)), self.root @ motions)
        return np.asarray(cameras @ np.linalg.inv(off))

    def seen(self, cameras: NDArray[np.float64], pose: NDArray[np.float64]
             ) -> NDArray[np.float64]:
        """(n, 6, k) tangent vectors by which the cameras see a pose (4, 4) off, in its frame."""
        turn = cameras[:, :3, :3]
        origin = np.linalg.inv(cameras) @ pose[:, 3]
        shift, spin = self.root[:, :3], self.root[:, 3:]
        shift = shift + np.cross(spin, origin[:, :3, None], axis=1)
        return np.concatenate([turn @ shift, turn @ spin], axis=1)

    def pixels(self, pinholes: Sequence[Pinhole], depths: Sequence[float]
               ) -> NDArray[np.float64]:
        """(n,) standard deviation with which an object at depths [m] is seen off [px]."""
        variance = np.square(self.root).sum(axis=2)
        focal = np.array([np.sqrt(each.fx * each.fy) for each in pinholes])
        across = (variance[:, :2].mean(axis=1) / np.square(depths)
                  + variance[:, 3:5].mean(axis=1))
        return np.asarray(focal * np.sqrt(across))


@dataclass(frozen=True)
class CameraScale:
    """Scale error of camera poses, by an object of known size that the views see.

    error: by this share the cameras should be farther apart. sigma: its standard deviation. An
    object that is smaller by this share looks the same.
    """

    error: float
    sigma: float

    @property
    def is_clear(self) -> bool:
        """Whether the scale is wrong."""
        return abs(self.error) > _CLEARLY_WRONG * self.sigma

    def describe(self) -> str:
        """By how much, and how sure that is."""
        off = 'farther apart' if self.error > 0 else 'closer together'
        return (f'cameras {100 * abs(self.error):.1f} % {off} (standard deviation '
                f'{100 * self.sigma:.1f})')


def understated(motions: NDArray[np.float64], covariance: NDArray[np.float64],
                scatter: NDArray[np.float64]) -> float:
    """Factor, at least 1, by which stated standard deviations of camera errors are too small.

    motions: (k,) that fit best. covariance: (k, k) that they are left. scatter: (k, k) with which
    they would be found if the cameras were exact, as of `Eliminated`. Stated errors are Student's
    t distributed: their variance is known up to a factor of inverse gamma distribution, with
    `_FREEDOM` degrees of freedom. Its most likely value by expectation maximisation, on the
    quadratic about `motions`.
    """
    whole = np.linalg.inv(covariance)
    information, directions = np.linalg.eigh(whole - np.eye(len(motions)))  # by the views
    told = information > _UNTOLD
    basis = directions[:, told] / np.sqrt(information[told])
    # The noise of their gradient, relative to what the curvature lets expect. It is more where
    # they hardly tell of a motion: chance would pass for a large one.
    noise, turn = np.linalg.eigh(basis.T @ whole @ scatter @ whole @ basis)
    basis = basis @ turn / np.sqrt(np.maximum(noise, _LEAST_NOISE))
    onto = basis.T @ (directions * np.maximum(information, 0)) @ directions.T
    signal, turn = np.linalg.eigh(onto @ onto.T)  # variance by motions, where the noise has 1
    signal = np.maximum(signal, 0)
    pull = signal ** 0.5 * (turn.T @ basis.T @ whole @ motions)
    precision = 1.0  # relative to that stated
    for _ in range(_ITERATIONS):
        shown = signal / (signal + precision)  # share of a motion that the views tell
        square = np.square(pull / (signal + precision)).sum()
        precision = float((_FREEDOM + shown.sum()) / (_FREEDOM + square))
    return max(precision ** -0.5, 1.0)


def _columns(shared: Iterable[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Motions on six axes that views share, of (views, 2) variances of position and rotation."""
    sigmas = [np.sqrt(np.repeat(each, 3, axis=1)) for each in shared]
    return [each * np.eye(6)[axis] for each in sigmas for axis in range(6) if each[:, axis].any()]
