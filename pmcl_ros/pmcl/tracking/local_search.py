"""The search of tracking: poses near the prediction, refined, and a sample of the posterior."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.contour_approximations import RigidContour, shrunk
from pmcl_ros.pmcl.modes import ambiguous_poses, suppress_duplicates
from pmcl_ros.pmcl.posterior import ContourPosterior, Mode, Posterior, Refine
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.sampler import Gaussian, sample_posterior

# Distinct poses that are kept: by the rigid contour, after coarse refinement, in the end.
_LIKELY, _HOPEFUL, _MODES = 16, 8, 2
_BLUR = 4  # image px: side of a pixel of the edges that the rigid contour is compared with
_CONTOUR_POINTS = 64  # of the rigid contour
# Standard deviations of the initial Gaussian about a mode, relative to the local model's. The
# search of the region takes 2.5, which 64 particles do not fill.
_WIDEN = 1.5
_NEGLIGIBLE = 10.0  # nat: log mass of a mode below that of the best one
_MOVES = 1  # Metropolis moves of the sampler after each step in temperature


@dataclass(frozen=True)
class LocalSearch:
    """Searches for the object near a prior.

    contour: gives the contour of a pose (4, 4), which is compared with `edges`.
    coarse, fine: refine poses (n, 4, 4), and give (n,) their evidence.
    posterior: exact evidence, refinement and local models. particles, candidates: numbers.
    """

    contour: Callable[[NDArray[np.float64]], ContourPoints]
    edges: EvidenceVolume
    coarse: Refine
    fine: Refine
    posterior: ContourPosterior
    particles: int
    candidates: int

    def run(self, prior: Gaussian, rng: np.random.Generator) -> Posterior | None:
        """The posterior, prior times evidence; None where no contour is in view near the prior.

        The time hardly depends on the picture: the numbers of candidates, of steps of refinement
        and of particles are fixed.
        """
        modes = self._modes(self._candidates(prior, rng))
        if not modes:
            return None
        symmetry = self.posterior.model.symmetry
        scale = modes[0].local.scale

        def log_prior(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            return -0.5 * prior.square_distance(poses)

        def exact(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            return scale * self.posterior.exact(poses) + log_prior(poses)

        starts = [self._start(prior, mode) for mode in modes]
        # Drop negligible modes: their wide Gaussians would claim the best mode's region, where
        # their linearized contour is wrong.
        peaks = scale * self.posterior.exact(np.stack([mode.pose for mode in modes]))
        masses = peaks + [_log_volume(prior, mode, start)
                          for mode, start in zip(modes, starts, strict=True)]
        kept = np.flatnonzero(masses >= masses.max() - _NEGLIGIBLE)
        modes, starts = [modes[k] for k in kept], [starts[k] for k in kept]
        scale = modes[0].local.scale
        contours = [self.posterior.linearize_at(mode.pose) for mode in modes]

        def rough(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            """By the linearized contour of the mode whose Gaussian is densest at a pose."""
            nearest = np.stack([each.log_density(poses) for each in starts]).argmax(axis=0)
            values = np.zeros(len(poses))
            for k, (mode, contour) in enumerate(zip(modes, contours, strict=True)):
                own = nearest == k
                values[own] = contour.evidence(symmetry.local(poses[own], mode.pose))
            inside = self.posterior.feasible(poses)
            return np.where(inside, scale * values + log_prior(poses), -np.inf)

        poses, values, own = sample_posterior([rough, exact], starts, self.particles, _MOVES,
                                              rng, lambda _: True)
        return Posterior(tuple(modes), poses, values, own)

    def _start(self, prior: Gaussian, mode: Mode) -> Gaussian:
        """The initial Gaussian of a mode: its product with the prior.

        Its mean is the mode itself where the mean of the product is outside of the region.
        """
        both = _product(prior, mode)
        feasible = self.posterior.feasible(both.pose[None])[0]
        return both if feasible else replace(both, pose=mode.pose)

    def _candidates(self, prior: Gaussian, rng: np.random.Generator) -> NDArray[np.float64]:
        """(k, 4, 4) refined poses drawn from the prior, no two of one mode, best first."""
        points, model = self.contour(prior.pose), self.posterior.model
        if not len(points.lengths):
            return np.zeros((0, 4, 4))
        rigid = RigidContour.from_contour(prior.pose, points, self.edges.pinhole, _CONTOUR_POINTS)
        if isinstance(self.edges, EdgeVolume):
            blurred: EvidenceVolume = shrunk(self.edges, _BLUR)
            profile = ContourProfile.contrast()
        else:
            blurred, profile = self.edges.blurred(_BLUR / 2), self.edges.profile
        normal = rng.normal(size=(self.candidates, prior.basis.shape[1]))
        poses = np.concatenate([prior.pose[None], retract(prior.pose, prior.deviations(normal))])
        poses = poses[self.posterior.feasible(poses)]
        poses = self._best(lambda each: (each, rigid.evidence(each, blurred, profile)), poses,
                           prior, _LIKELY)
        poses = self._best(self.coarse, poses, prior, _HOPEFUL)
        others = ambiguous_poses(model, poses[0]) if len(poses) else poses
        others = others[self.posterior.feasible(others)]
        poses = np.concatenate([poses, self.coarse(others)[0]])
        return self._best(self.fine, poses, prior, _MODES)

    def _best(self, stage: Refine, poses: NDArray[np.float64], prior: Gaussian, count: int
              ) -> NDArray[np.float64]:
        """The best `count` poses after a stage, by evidence and prior, no two of one mode."""
        poses, values = stage(poses)
        values = values - 0.5 * prior.square_distance(poses)
        poses = poses[np.argsort(-values, kind='stable')]
        return poses[suppress_duplicates(poses, self.posterior.model.symmetry, count)]

    def _modes(self, poses: NDArray[np.float64]) -> list[Mode]:
        """The modes near poses, best first, in the region, no two the same."""
        modes = [self.posterior.refine(each) for each in poses]
        modes = [each for each in modes if self.posterior.feasible(each.pose[None])[0]
                 and each.local.length > 0]
        modes.sort(key=lambda mode: -mode.local.evidence)
        poses = np.array([mode.pose for mode in modes]).reshape(-1, 4, 4)
        return [modes[k] for k in suppress_duplicates(poses, self.posterior.model.symmetry,
                                                      _MODES)]


def _product(prior: Gaussian, mode: Mode) -> Gaussian:
    """The product of the prior and the Gaussian of a mode, widened by `_WIDEN`."""
    local = mode.local
    information = local.scale * local.information
    root = np.linalg.inv(prior.spread) @ prior.basis.T @ local.basis
    expected = root.T @ root
    off = local.basis.T @ prior.symmetry.local(prior.pose[None], mode.pose)[0]
    step = local.basis @ np.linalg.solve(information + expected, expected @ off)
    wide = local.basis @ np.linalg.inv(information / _WIDEN ** 2 + expected) @ local.basis.T
    return Gaussian.from_covariance(retract(mode.pose, step[None])[0], wide, prior.symmetry)


def _log_volume(prior: Gaussian, mode: Mode, product: Gaussian) -> float:
    """Log of a mode's volume under the prior, by Laplace's approximation, unnormalised."""
    from_mode = mode.local.basis.T @ prior.symmetry.local(product.pose[None], mode.pose)[0]
    information = mode.local.scale * mode.local.information
    return float(-0.5 * (from_mode @ information @ from_mode
                         + prior.square_distance(product.pose[None])[0])
                 + np.linalg.slogdet(product.spread)[1])
