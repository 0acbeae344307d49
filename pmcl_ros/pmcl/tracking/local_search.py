"""The search of tracking: around where the object is expected, and nowhere else."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.ambiguous_poses import ambiguous_poses
from pmcl_ros.pmcl.modes import suppress_duplicates
from pmcl_ros.pmcl.posterior import Ascend, ContourPosterior, Mode, Posterior
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.rigid_contour import RigidContour, shrunk
from pmcl_ros.pmcl.sampler import Gaussian, sample_posterior

# Different poses that go on: by a wire to coarse contours, from there to fine ones, to the end.
_LIKELY, _HOPEFUL, _MODES = 16, 8, 2
_BLUR = 4  # image px of a pixel of the wire's edges
_WIRE = 64  # points of it
_WIDEN = 1.5  # of a mode's Gaussian: particles are too few to fill the 2.5 of the region's search
_NEGLIGIBLE = 10.0  # nat: so much less mass than the best mode's
_MOVES = 1  # of the sampler at each of its powers


@dataclass(frozen=True)
class LocalSearch:
    """Looks for the object near where a prior expects it.

    contour: the points of a pose's contour, which is looked for in `edges`. coarse, fine: where
    poses (n, 4, 4) come to uphill, and (n,) the evidence there. posterior: what knows the exact
    evidence, refines a pose and models its neighbourhood. particles, candidates: how many.
    """

    contour: Callable[[NDArray[np.float64]], ContourPoints]
    edges: EdgeVolume
    coarse: Ascend
    fine: Ascend
    posterior: ContourPosterior
    particles: int
    candidates: int

    def run(self, prior: Gaussian, rng: np.random.Generator) -> Posterior | None:
        """The posterior: prior times evidence; None where there is nothing to be seen near it.

        It takes about the same time whatever is seen: so many candidates climb so many steps, ten
        steps of refinement, a sampler of so many particles.
        """
        modes = self._modes(self._found(prior, rng))
        if not modes:
            return None
        symmetry = self.posterior.model.symmetry
        scale = modes[0].local.scale

        def before(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            return -0.5 * prior.square_distance(poses)

        def exact(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            return scale * self.posterior.exact(poses) + before(poses)

        starts = [self._begun(prior, mode) for mode in modes]
        # Faint modes are wide: the best one's neighbourhood would count as theirs, where their
        # slid contour is wrong.
        peaks = scale * self.posterior.exact(np.stack([mode.pose for mode in modes]))
        masses = peaks + [_share(prior, mode, start)
                          for mode, start in zip(modes, starts, strict=True)]
        kept = np.flatnonzero(masses >= masses.max() - _NEGLIGIBLE)
        modes, starts = [modes[k] for k in kept], [starts[k] for k in kept]
        scale = modes[0].local.scale
        slides = [self.posterior.near(mode.pose) for mode in modes]

        def rough(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            """By the slid contour of the mode that is likeliest to be about there."""
            nearest = np.stack([each.log_density(poses) for each in starts]).argmax(axis=0)
            values = np.zeros(len(poses))
            for k, (mode, slide) in enumerate(zip(modes, slides, strict=True)):
                own = nearest == k
                values[own] = slide.evidence(symmetry.local(poses[own], mode.pose))
            return np.where(self.posterior.inside(poses), scale * values + before(poses), -np.inf)

        poses, values, own = sample_posterior([rough, exact], starts, self.particles, _MOVES,
                                              rng, lambda _: True)
        return Posterior(tuple(modes), poses, values, own)

    def _begun(self, prior: Gaussian, mode: Mode) -> Gaussian:
        """Where particles of a mode begin: about its product with the prior, or itself.

        A prior that reaches beyond the region may have its share of the product there.
        """
        both = _product(prior, mode)
        return both if self.posterior.inside(both.pose[None])[0] else replace(both, pose=mode.pose)

    def _found(self, prior: Gaussian, rng: np.random.Generator) -> NDArray[np.float64]:
        """(k, 4, 4) different poses uphill from where the prior expects the object, best first."""
        points, model = self.contour(prior.pose), self.posterior.model
        if not len(points.lengths):
            return np.zeros((0, 4, 4))
        wire = RigidContour.of(prior.pose, points, self.edges.pinhole, _WIRE)
        blurred, contrast = shrunk(self.edges, _BLUR), ContourProfile.contrast()
        normal = rng.normal(size=(self.candidates, prior.basis.shape[1]))
        poses = np.concatenate([prior.pose[None], retract(prior.pose, prior.deviations(normal))])
        poses = poses[self.posterior.inside(poses)]
        poses = self._best(lambda each: (each, wire.evidence(each, blurred, contrast)), poses,
                           prior, _LIKELY)
        poses = self._best(self.coarse, poses, prior, _HOPEFUL)
        others = ambiguous_poses(model, poses[0]) if len(poses) else poses
        others = others[self.posterior.inside(others)]
        poses = np.concatenate([poses, self.coarse(others)[0]])
        return self._best(self.fine, poses, prior, _MODES)

    def _best(self, stage: Ascend, poses: NDArray[np.float64], prior: Gaussian, count: int
              ) -> NDArray[np.float64]:
        """At most `count` different ones of where poses come to, best by evidence and prior first.
        """
        poses, values = stage(poses)
        values = values - 0.5 * prior.square_distance(poses)
        poses = poses[np.argsort(-values, kind='stable')]
        return poses[suppress_duplicates(poses, self.posterior.model.symmetry, count)]

    def _modes(self, poses: NDArray[np.float64]) -> list[Mode]:
        """The different modes near poses, best first, of those in the region."""
        modes = [self.posterior.refined(each) for each in poses]
        modes = [each for each in modes if self.posterior.inside(each.pose[None])[0]
                 and each.local.length > 0]
        modes.sort(key=lambda mode: -mode.local.evidence)
        poses = np.array([mode.pose for mode in modes]).reshape(-1, 4, 4)
        return [modes[k] for k in suppress_duplicates(poses, self.posterior.model.symmetry,
                                                      _MODES)]


def _product(prior: Gaussian, mode: Mode) -> Gaussian:
    """About the most likely pose by the prior and a mode's own model, as wide as both allow."""
    local = mode.local
    told = local.scale * local.information
    root = np.linalg.inv(prior.spread) @ prior.basis.T @ local.basis
    expected = root.T @ root
    # How far the prior's mean is from the mode, in the mode's tangent space.
    off = local.basis.T @ prior.symmetry.local(prior.pose[None], mode.pose)[0]
    step = local.basis @ np.linalg.solve(told + expected, expected @ off)
    wide = local.basis @ np.linalg.inv(told / _WIDEN ** 2 + expected) @ local.basis.T
    return Gaussian.of(retract(mode.pose, step[None])[0], wide, prior.symmetry)


def _share(prior: Gaussian, mode: Mode, product: Gaussian) -> float:
    """Log of what of a mode the prior leaves, by Laplace's approximation, but for a constant."""
    from_mode = mode.local.basis.T @ prior.symmetry.local(product.pose[None], mode.pose)[0]
    told = mode.local.scale * mode.local.information
    return float(-0.5 * (from_mode @ told @ from_mode
                         + prior.square_distance(product.pose[None])[0])
                 + np.linalg.slogdet(product.spread)[1])
