"""Learns the profile of edge energy across contours from scenes with known poses."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, softmax

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.energies import energies_across
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.particles import perturb, uniform_poses
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.back_end import Renderer
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.creases import Creases
from pmcl_ros.pmcl.render.scene import Scene
from pmcl_ros.runtime.errors import LocalizationError

# px outwards from a contour: three across an edge's width of some 3 px, and the strips beside it.
OFFSETS = np.array([-5, -3, -1.5, 0, 1.5, 3, 5], np.float32)
# Of the ramps of the evidence over an energy [1]: denser below, where most energies are.
KNOTS = np.array([0, 0.15, 0.3, 0.5, 0.8, 1.2, 1.7, 2.5], np.float32)
SHIFTS = np.arange(-3, 3.01, 0.5)  # px: displacements of a contour along its normals
_RIDGE = 3e-3  # of the squared coefficients, relative to the mean loss of a point
# Of creases: the largest likelihood on scenes left out, among 0.003 to 1 by factors of three.
_CREASE_RIDGE = 0.01
_NEAR = np.array([0.003, 0.003, 0.02]), 0.07  # m, rad: standard deviations of near misses
_POSES = 12  # wrong poses for a scene, half of them near misses
_POINTS = 150  # of a contour, at most


@dataclass(frozen=True)
class Example:
    """Evidence of a picture in which an object is at a known pose (4, 4), or is not (`there`)."""

    volume: EvidenceVolume
    model: ObjectModel
    pose: NDArray[np.float64]
    region: Region
    there: bool = True

    @property
    def scene(self) -> Scene:
        """The object and the part of the image in which a renderer scores its poses."""
        near, far = self.region.grown(self.model.radius)
        window = self.region.window(self.volume.pinhole, self.model.radius)
        return Scene(self.model, self.volume.pinhole, window, near, far)


@dataclass(frozen=True)
class Samples:
    """Energies (n, j) across points, whether a contour is there (n,), weights (n,).

    Of each scene contours that are there and contours that are not have equal weight, in all one.
    shifted: (m, k, j) energies of contour points, displaced along their normals by SHIFTS (k,);
    shares: (m,) their weights, in all one for a scene.
    """

    energies: NDArray[np.float64]
    there: NDArray[np.bool_]
    weights: NDArray[np.float64]
    shifted: NDArray[np.float64] = field(
        default_factory=lambda: np.zeros((0, len(SHIFTS), len(OFFSETS))))
    shares: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def joined(cls, parts: 'Sequence[Samples]') -> 'Samples':
        """The samples of several scenes. Raises LocalizationError when there are none."""
        if not parts:
            raise LocalizationError('0 of the scenes show what is to be learned; learn from more '
                                    'scenes, or with creases from scenes of blocks')
        return cls(*(np.concatenate([getattr(each, name.name) for each in parts])
                     for name in fields(cls)))

    def mirrored(self) -> 'Samples':
        """These samples and their mirror images, at half the weight: for lines without a side."""
        return Samples(np.concatenate([self.energies, self.energies[:, ::-1]]),
                       np.tile(self.there, 2), np.tile(self.weights, 2) / 2,
                       np.concatenate([self.shifted, self.shifted[:, ::-1, ::-1]]),
                       np.tile(self.shares, 2) / 2)


def profiles(example: Example, renderer: Renderer, rng: np.random.Generator,
             of_creases: bool = False) -> list[Samples]:
    """Samples of one scene, at the true pose and at wrong ones (random, and near misses).

    Empty where the image shows no contour of the object. of_creases: samples across its creases
    instead, and their mirror images; empty where no crease is visible.
    """
    if not example.there:
        return []
    profile = ContourProfile(OFFSETS, KNOTS, np.zeros((len(OFFSETS), len(KNOTS)), np.float32))
    wrong = np.concatenate([uniform_poses(example.region, _POSES // 2, rng), perturb(
        np.tile(example.pose, (_POSES // 2, 1, 1)), *_NEAR, rng)])
    creases = Creases.from_model(example.model, profile) if of_creases else None
    if of_creases and creases is None:
        return []
    with renderer.contour_score(example.scene, example.volume, profile, creases=creases) as score:
        def points_of(pose: NDArray[np.float64]) -> ContourPoints:
            seen = score.creases(pose)
            return score.points(pose) if seen is None else seen.points

        points = points_of(example.pose)
        others = np.concatenate([points_of(pose).energies for pose in wrong])
    if not len(points.lengths):
        return []
    chosen = rng.permutation(len(points.lengths))[:_POINTS]
    others = others[rng.permutation(len(others))[:_POINTS * _POSES]]
    shifted = energies_across(example.volume, points.pixels[chosen], points.normals[chosen],
                              points.depths[chosen], np.add.outer(SHIFTS, OFFSETS).ravel())
    count = len(chosen)
    found = Samples(np.concatenate([points.energies[chosen], others]),
                    np.arange(count + len(others)) < count,
                    np.concatenate([np.full(count, 0.5 / count),
                                    np.full(len(others), 0.5 / max(len(others), 1))]),
                    shifted.reshape(count, len(SHIFTS), len(OFFSETS)),
                    np.full(count, 1 / count))
    return [found.mirrored() if of_creases else found]


def fitted(given: Samples, ridge: float = _RIDGE) -> ContourProfile:
    """The profile whose evidence is the log odds that a contour is there.

    Tables are linear between knots, with a ridge penalty. The loss is the mean of two: logistic
    regression of a contour being there or not, and a conditional logit of its place among those
    up to 3 px aside. The first alone does not localise it.
    """
    design = np.concatenate([_hats(given.energies), np.ones((len(given.energies), 1))], axis=1)
    shifted, here = _hats(given.shifted), int(np.abs(SHIFTS).argmin())
    weights = given.weights / given.weights.sum()
    shares = given.shares / max(given.shares.sum(), 1e-9)
    sign = np.where(given.there, 1.0, -1.0)
    held = np.append(np.full(design.shape[1] - 1, ridge), 0)

    def loss(coefficients: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        margin = sign * (design @ coefficients)
        value = weights @ np.logaddexp(0, -margin) + 0.5 * held @ coefficients ** 2
        slope = design.T @ (-weights * sign * expit(-margin)) + held * coefficients
        chances = softmax(shifted @ coefficients[:-1], axis=1)
        value -= shares @ np.log(np.maximum(chances[:, here], 1e-300))
        chances[:, here] -= 1
        slope[:-1] += np.tensordot(shares[:, None] * chances, shifted, 2)
        return float(value), slope

    best = minimize(loss, np.zeros(design.shape[1]), jac=True, method='L-BFGS-B',
                    options={'maxiter': 200}).x
    tables = best[:-1].reshape(given.energies.shape[1], len(KNOTS))
    return ContourProfile(OFFSETS, KNOTS, tables.astype(np.float32), float(best[-1]))


def crease_profile(given: Sequence[Samples]) -> ContourProfile:
    """The profile of creases, from mirrored samples: equal on both sides."""
    return fitted(Samples.joined(given), _CREASE_RIDGE)


def _hats(energies: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., j * knots) interpolation weights of the tables at energies (..., j)."""
    hats = np.stack([np.interp(energies, KNOTS, row) for row in np.eye(len(KNOTS))], axis=-1)
    return hats.reshape(*energies.shape[:-1], energies.shape[-1] * len(KNOTS))
