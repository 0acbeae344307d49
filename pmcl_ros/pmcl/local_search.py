"""The search of tracking: around where the object is expected, and nowhere else."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import EdgeVolume
from pmcl_ros.pmcl.contour_profile import ContourProfile
from pmcl_ros.pmcl.moved_contour import MovedContour, shrunk
from pmcl_ros.pmcl.posterior import ContourPosterior, Mode, Posterior
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.sampler import Gaussian, sample_posterior
from pmcl_ros.pmcl.summary import moved, same_mode, tangent

# Of each round: image px of a pixel of its edges, how far particles move, relative to the prior's
# spread (none: they are drawn from the prior), and how many groups of them go on.
_ROUNDS = ((4, 0.0, 24), (4, 0.4, 16), (2, 0.2, 12), (1, 0.1, 4))
_CONTOUR = 64  # points of a contour that are looked at
_MODES = 2  # that are refined
_WIDEN = 2.5  # of a mode's Gaussian, as in the search
_MOVES = 1  # of the sampler at each of its powers
_ALIKE_DISTANCE, _ALIKE_ANGLE = 0.01, 0.15  # m, rad: closer poses are of one mode


@dataclass(frozen=True)
class LocalSearch:
    """Looks for the object near where a prior expects it.

    search: what knows the exact evidence, refines a pose and models its neighbourhood.
    contour: the points of a pose's contour. particles, candidates: how many.
    """

    search: ContourPosterior
    contour: Callable[[NDArray[np.float64]], ContourPoints]
    edges: EdgeVolume
    profile: ContourProfile
    particles: int
    candidates: int

    def run(self, prior: Gaussian, rng: np.random.Generator) -> Posterior | None:
        """The posterior: prior times evidence; None where there is nothing to be seen near it.

        It takes about the same time whatever is seen: so many candidates in each of four rounds,
        ten steps of refinement, a sampler of so many particles.
        """
        found = self._found(prior, rng)
        if found is None:
            return None
        modes = self._modes(found)
        if not modes:
            return None
        axis = self.search.model.axis
        scale = modes[0].local.scale
        starts = [self._begun(prior, mode) for mode in modes]
        slides = [self.search.near(mode.pose) for mode in modes]

        def before(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            return -0.5 * prior.square_distance(poses, axis)

        def rough(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            """By the slid contour of the nearest mode."""
            off = np.stack([each.square_distance(poses, axis) for each in starts])
            nearest = off.argmin(axis=0)
            values = np.zeros(len(poses))
            for k, (mode, slide) in enumerate(zip(modes, slides, strict=True)):
                own = nearest == k
                values[own] = slide.evidence(tangent(poses[own], mode.pose, axis))
            return np.where(self.search.inside(poses), scale * values + before(poses), -np.inf)

        def exact(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            return scale * self.search.exact(poses) + before(poses)

        poses, values, own = sample_posterior([rough, exact], starts, axis, self.particles,
                                              _MOVES, rng, lambda _: True)
        return Posterior(tuple(modes), poses, values, own)

    def _begun(self, prior: Gaussian, mode: Mode) -> Gaussian:
        """Where particles of a mode begin: about its product with the prior, or itself.

        A prior that reaches beyond the region may have its share of the product there.
        """
        both = _product(prior, mode, self.search.model.axis)
        return both if self.search.inside(both.pose[None])[0] else replace(both, pose=mode.pose)

    def _found(self, prior: Gaussian, rng: np.random.Generator) -> NDArray[np.float64] | None:
        """(k, 4, 4) the best poses around the prior's, best first."""
        axis, count = self.search.model.axis, self.candidates
        contrast = ContourProfile.contrast()
        best = prior.pose[None]
        wire = self._wire(prior.pose)
        if wire is None:
            return None
        coarser = {scale: shrunk(self.edges, scale) for scale, _, _ in _ROUNDS}
        for scale, step, kept in _ROUNDS:
            normal = rng.normal(size=(count, prior.basis.shape[1]))
            if step == 0:
                tried = moved(prior.pose, prior.deviations(normal))
            else:
                wire = self._wire(best[0]) or wire
                origins = np.repeat(best, -(-count // len(best)), axis=0)[:count]
                tried = moved(origins, prior.deviations(step * normal))
            tried = np.concatenate([best, tried])
            tried = tried[self.search.inside(tried)]
            if not len(tried):
                return None
            values = wire.evidence(tried, coarser[scale],
                                   self.profile if scale == 1 else contrast)
            values -= 0.5 * prior.square_distance(tried, axis)
            best = tried[np.argsort(-values, kind='stable')[:kept]]
        return best

    def _wire(self, pose: NDArray[np.float64]) -> MovedContour | None:
        points = self.contour(pose)
        if not len(points.lengths):
            return None
        return MovedContour.of(pose, points, self.edges.pinhole, _CONTOUR)

    def _modes(self, poses: NDArray[np.float64]) -> list[Mode]:
        """The best distinct modes near poses, best first, of those in the region."""
        axis = self.search.model.axis
        modes: list[Mode] = []
        for pose in poses:
            near = [same_mode(pose[None], each.pose, axis, _ALIKE_DISTANCE, _ALIKE_ANGLE)[0]
                    for each in modes]
            if not any(near) and len(modes) < _MODES:
                modes.append(self.search.refined(pose))
        modes = [each for each in modes if self.search.inside(each.pose[None])[0]]
        modes.sort(key=lambda mode: -mode.local.evidence)
        if len(modes) > 1 and same_mode(modes[1].pose[None], modes[0].pose, axis, _ALIKE_DISTANCE,
                                        _ALIKE_ANGLE)[0]:
            return modes[:1]
        return modes


def _product(prior: Gaussian, mode: Mode, axis: NDArray[np.float64] | None) -> Gaussian:
    """About the most likely pose by the prior and a mode's own model, as wide as both allow."""
    local = mode.local
    told = local.scale * local.information
    root = np.linalg.inv(prior.spread) @ prior.basis.T @ local.basis
    expected = root.T @ root
    # How far the prior's mean is from the mode, in the mode's tangent space.
    off = local.basis.T @ tangent(prior.pose[None], mode.pose, axis)[0]
    step = local.basis @ np.linalg.solve(told + expected, expected @ off)
    wide = local.basis @ np.linalg.inv(told / _WIDEN ** 2 + expected) @ local.basis.T
    return Gaussian.of(moved(mode.pose, step[None])[0], wide, axis)
