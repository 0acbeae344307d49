"""What an edge profile across a contour tells, learned from scenes with known poses."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

from pmcl_ros.dlv.volume import DepthLikelihoodVolume, EdgeVolume
from pmcl_ros.errors import LocalizationError
from pmcl_ros.pmcl.contour_profile import ContourProfile
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.motion import perturb, uniform_poses
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.back_end import Renderer
from pmcl_ros.pmcl.render.scene import Scene
from pmcl_ros.pmcl.settings import PmclSettings

OFFSETS = np.array([-5, -3, -1.5, 0, 1.5, 3, 5], np.float32)
KNOTS = np.array([0, 0.15, 0.3, 0.5, 0.8, 1.2, 1.7, 2.5], np.float32)
_RIDGE = 3e-3  # of the squared coefficients, relative to the mean loss of a point
_NEAR = np.array([0.003, 0.003, 0.02]), 0.07  # m, rad: of poses that nearly fit
_POSES = 12  # wrong ones for a scene: half of them near the true one
_POINTS = 600  # of a contour, at most
_OTHERS = 2  # objects looked for in a scene that are in others


@dataclass(frozen=True)
class Example:
    """An edge volume in which an object is at a known pose (4, 4)."""

    edges: EdgeVolume
    model: ObjectModel
    pose: NDArray[np.float64]
    region: Region


@dataclass(frozen=True)
class Samples:
    """Profiles across contours: energies (n, j), whether the object ends there (n,), weights (n,).

    Of each scene contours that are there and contours that are not weigh alike, in all one.
    """

    energies: NDArray[np.float64]
    there: NDArray[np.bool_]
    weights: NDArray[np.float64]


def samples(examples: Iterable[Example], renderer: Renderer, rng: np.random.Generator) -> Samples:
    """Profiles at the true poses, and at wrong ones: random in the region, and near misses."""
    profile = ContourProfile(OFFSETS, KNOTS, np.zeros((len(OFFSETS), len(KNOTS)), np.float32))
    energies, there, weights = [], [], []
    for each in examples:
        near, far = each.region.grown(each.model.radius)
        window = each.region.window(each.edges.pinhole, each.model.radius)
        scene = Scene(each.model, each.edges.pinhole, window, near, far)
        wrong = np.concatenate([uniform_poses(each.region, _POSES // 2, rng), perturb(
            np.tile(each.pose, (_POSES // 2, 1, 1)), *_NEAR, rng)])
        with renderer.contour_score(scene, each.edges, profile) as score:
            for truly, poses in ((True, each.pose[None]), (False, wrong)):
                found = np.concatenate([score.points(pose).energies for pose in poses])
                if not len(found):
                    continue
                found = found[rng.permutation(len(found))[:_POINTS * len(poses)]]
                energies.append(found)
                there.append(np.full(len(found), truly))
                weights.append(np.full(len(found), 0.5 / len(found)))
    if not energies:
        raise LocalizationError('no scene to learn from shows a contour')
    return Samples(np.concatenate(energies), np.concatenate(there), np.concatenate(weights))


def fitted(given: Samples, ridge: float = _RIDGE) -> ContourProfile:
    """The profile whose evidence is the log odds that the object ends there.

    Logistic regression, with tables that are linear between knots, their squares held down.
    """
    design = np.concatenate([_hats(column) for column in given.energies.T], axis=1)
    design = np.concatenate([design, np.ones((len(design), 1))], axis=1)
    weights = given.weights / given.weights.sum()
    sign = np.where(given.there, 1.0, -1.0)
    held = np.append(np.full(design.shape[1] - 1, ridge), 0)

    def loss(coefficients: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        margin = sign * (design @ coefficients)
        value = weights @ np.logaddexp(0, -margin) + 0.5 * held @ coefficients ** 2
        slope = design.T @ (-weights * sign * expit(-margin)) + held * coefficients
        return float(value), slope

    best = minimize(loss, np.zeros(design.shape[1]), jac=True, method='L-BFGS-B',
                    options={'maxiter': 500}).x
    tables = best[:-1].reshape(given.energies.shape[1], len(KNOTS))
    return ContourProfile(OFFSETS, KNOTS, tables.astype(np.float32), float(best[-1]))


@dataclass(frozen=True)
class Supports:
    """Of the best pose found for objects (`pmcl.support`): there (n,), elsewhere (m,)."""

    there: NDArray[np.float64]
    elsewhere: NDArray[np.float64]

    def threshold(self, false_alarms: float) -> float:
        """The least support that only this share of the objects that are elsewhere has."""
        return float(np.quantile(self.elsewhere, 1 - false_alarms))

    def missed(self, least: float) -> float:
        """Share of the objects there whose support is less."""
        return float((self.there < least).mean())


def supports(examples: Iterable[Example], profile: ContourProfile, seed: int) -> Supports:
    """Look in each scene for its own object, and for those of the scenes before.

    The edge volumes must reach as far as any of the objects does.
    """
    there, elsewhere = [], []
    before: list[ObjectModel] = []
    for each in examples:
        there.append(_support(each, each.model, profile, seed))
        elsewhere += [_support(each, other, profile, seed) for other in before]
        before = [*before, each.model][-_OTHERS:]
    if not elsewhere:
        raise LocalizationError('it takes two scenes to look for an object that is not there')
    return Supports(np.array(there), np.array(elsewhere))


def _support(example: Example, model: ObjectModel, profile: ContourProfile, seed: int) -> float:
    edges = example.edges
    nothing = np.zeros((edges.pinhole.height, edges.pinhole.width, 2), np.float32)
    volume = DepthLikelihoodVolume(edges.header, nothing, edges.depths[[0, -1]], edges.pinhole,
                                   edges)
    settings = PmclSettings(roi_center=example.region.center, roi_size=example.region.size,
                            renderer='numba')
    with Localizer(model, settings, profile) as localizer:
        return localizer.localize(volume, np.random.default_rng(seed)).support


def _hats(energies: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, knots) weights by which a table is read at energies (n,)."""
    return np.stack([np.interp(energies, KNOTS, row) for row in np.eye(len(KNOTS))], axis=1)
