"""Posterior -> PoseEstimate: pose, covariance with the model error, and whether it is lost."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.learned import NO_SLOPES, SupportSlopes
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.geometry.student_t import tail_factors
from pmcl_ros.pmcl.estimate import PoseEstimate, PoseMode
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.modes import MODE_EXTENT
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.particles import Weights
from pmcl_ros.pmcl.posterior import Posterior
from pmcl_ros.pmcl.prior.orientation import Orientation
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.sampler import Gaussian
from pmcl_ros.pmcl.search import Modes
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.support import contour_support, log_odds, share_in_view

Camera = tuple[Pinhole, NDArray[np.float64]]  # and its pose (4, 4)


@dataclass(frozen=True)
class Thresholds:
    """What a pose must reach, or the object is lost.

    support: along the weakest part of its contour; evidence: mean along all of it [nat / px].
    weight: of its mode. slopes: how the support that is needed depends on other numbers. An object
    that is elsewhere has less support, evidence and weight. Where solids are clearly seen their
    contours are too, and a wrong pose finds more of them: there more is needed.
    """

    support: float
    evidence: float
    weight: float = 0.0
    slopes: SupportSlopes = NO_SLOPES

    @classmethod
    def from_volume(cls, volume: EvidenceVolume, profile: ContourProfile, support: float | None
                    ) -> 'Thresholds':
        """Of one view. support: that is wanted, for all poses; None: as was learned."""
        if support is not None:
            return cls(support, profile.least, volume.least_weight)
        return cls(volume.least_support, profile.least, volume.least_weight,
                   volume.support_slopes)

    def needed(self, evidence: float, weight: float, inside: float) -> float:
        """The support that a pose with these numbers (`PoseEstimate`) needs [nat / px].

        `support` where there is no evidence, minus infinity: such a pose is lost by that.
        """
        if not math.isfinite(evidence):
            return self.support
        return self.support - self.slopes.instead(evidence, log_odds(weight), inside)


@dataclass(frozen=True)
class Estimator:
    """Makes the estimates of one object's poses in a region of interest.

    orientation: of the object, if it is not any.
    """

    model: ObjectModel
    region: Region
    settings: PmclSettings
    orientation: Orientation | None = None

    def from_posterior(self, header: Header, cameras: Sequence[Camera], shown: Modes,
                       posterior: Posterior, least: Thresholds, degrees_of_freedom: float,
                       rng: np.random.Generator, flat: bool = False) -> PoseEstimate:
        """By contours: the weightiest mode; lost where a part of its contour is missing.

        cameras: the one that sees most of the object counts. posterior: the sample of what is
        shown. degrees_of_freedom: of the Student's t of the errors. flat: the prior is uniform.
        The pose is then the mode's where the mean of the posterior is much less likely.
        """
        symmetry, count = self.model.symmetry, len(posterior.poses)
        shares = np.bincount(posterior.own, minlength=len(posterior.modes)) / count
        order = np.argsort(-shares, kind='stable')
        pose, local = self._in_mode(posterior, order[0], shown, flat)
        ours = symmetry.nearest_equivalents(posterior.poses[posterior.own == order[0]], pose)
        # The model error adds to the uncertainty of the posterior.
        error = local.basis @ local.model_error @ local.basis.T
        spread = symmetry.covariance(ours, pose) + error
        centers = np.stack([each.pose for each in posterior.modes])
        centers[order[0]] = pose
        particles = self._with_errors(posterior, pose, centers, error, degrees_of_freedom, rng)
        modes = tuple(PoseMode(
            self._representative(symmetry.canonical_spin(posterior.modes[k].pose)),
            float(shares[k]), posterior.modes[k].local.evidence) for k in order)
        in_view = max(share_in_view(self.model, np.linalg.inv(camera) @ pose, pinhole)
                      for pinhole, camera in cameras)
        support = contour_support(shown.points_at(pose), shown.share_at(pose) * in_view)
        evidence = local.evidence / local.length if local.length > 0 else -np.inf
        weight = float(shares[order[0]])
        inside = shown.inside_at(pose)
        needed = least.needed(evidence, weight, inside)
        # Lost: a part of the contour is missing, the whole is more likely absent than present, or
        # another pose is too likely.
        partly = support < needed
        otherwise = not evidence >= least.evidence or weight < least.weight
        return PoseEstimate(header, pose, spread, particles, np.full(count, -np.log(count)),
                            local.evidence, partly or otherwise, self.settings.mode, modes,
                            support, evidence, inside, incomplete=partly and not otherwise,
                            in_view=in_view, least_support=needed,
                            least_evidence=least.evidence, least_weight=least.weight,
                            degrees_of_freedom=degrees_of_freedom)

    def _in_mode(self, posterior: Posterior, number: int, shown: Modes, flat: bool
                 ) -> tuple[NDArray[np.float64], LocalModel]:
        """The pose (4, 4) that stands for a mode of a posterior, and its local model.

        shown, flat: as of `from_posterior`.
        """
        symmetry, mode = self.model.symmetry, posterior.modes[number]
        mean = symmetry.mean_pose(posterior.poses[posterior.own == number])
        pose = self._representative(mean)
        local = shown.local_model_at(pose, True)
        # The particles of a Gaussian are on average half a nat per degree of freedom less likely
        # than its mean. The mean of several maxima can be less likely than its particles.
        less = posterior.modes[0].local.scale * (mode.local.evidence - local.evidence)
        if flat and less > len(local.gradient) / 2:
            pose = self._representative(symmetry.canonical_spin(mode.pose))
            local = shown.local_model_at(pose, True)
        return pose, local

    def _with_errors(self, posterior: Posterior, pose: NDArray[np.float64],
                     centers: NDArray[np.float64], error: NDArray[np.float64],
                     degrees_of_freedom: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """(n, 4, 4) particles of a posterior, with the model error (6, 6), near a pose (4, 4).

        With the tails of a Student's t about the centers (k, 4, 4) of its modes.
        """
        symmetry, count = self.model.symmetry, len(posterior.poses)
        off = rng.multivariate_normal(np.zeros(6), error, count, method='eigh')
        particles = symmetry.nearest_equivalents(retract(posterior.poses, off), pose)
        if math.isinf(degrees_of_freedom):
            return particles
        dimensions = symmetry.tangent_basis(centers[0]).shape[1]
        factors = tail_factors(count, dimensions, degrees_of_freedom, rng)
        for number in np.unique(posterior.own):
            ours = posterior.own == number
            near = symmetry.nearest_equivalents(particles[ours], centers[number])
            # As `retract` moves them, so that the spin about an axis of symmetry stays.
            more = (factors[ours, None] - 1) * symmetry.local(near, centers[number])
            particles[ours] = retract(particles[ours], more)
        return particles

    def from_prior(self, header: Header, prior: Gaussian, count: int,
                   rng: np.random.Generator) -> PoseEstimate:
        """Lost, as nothing of the object is in view: `count` particles of the prior."""
        normal = rng.normal(size=(count, prior.basis.shape[1]))
        poses = retract(prior.pose, prior.deviations(normal))
        spread = self.model.symmetry.covariance(poses, prior.pose)
        return PoseEstimate(header, prior.pose, spread, poses,
                            np.full(count, -np.log(count)), 0.0, True, self.settings.mode,
                            support=-np.inf, evidence=-np.inf)

    def from_particles(self, volume: DepthLikelihoodVolume, poses: NDArray[np.float64],
                       weights: Weights,
                       score: Callable[[NDArray[np.float64]], NDArray[np.float64]]
                       ) -> PoseEstimate:
        """By the paper's likelihood: the mode about the best of weighted particles (n, 4, 4).

        score: the likelihoods (n,) of poses.
        """
        symmetry = self.model.symmetry
        best = poses[int(weights.log.argmax())]
        near = symmetry.nearest_equivalents(poses, best)
        mode = symmetry.same_mode(near, best, *MODE_EXTENT)
        inside = Weights(weights.log[mode]).normalised
        pose = self._representative(symmetry.mean_pose(near[mode], inside))
        spread = symmetry.covariance(symmetry.nearest_equivalents(near[mode], pose), pose, inside)
        likelihood = float(score(pose[None])[0])
        # The paper has no lost objects; here an object without any likelihood is lost.
        return PoseEstimate(volume.header, pose, spread, symmetry.nearest_equivalents(poses, pose),
                            weights.log_normalised, likelihood, lost=not likelihood > 0,
                            mode=self.settings.mode)

    def _representative(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The canonical one of the equivalents of a pose (4, 4) by the discrete symmetries.

        Among those that are in the region in a possible orientation, if there are any.
        """
        symmetry = self.model.symmetry
        if len(symmetry.discrete) == 1:
            return pose
        poses = symmetry.equivalents(pose)
        inside = self.region.contains(poses[:, :3, 3])
        if self.orientation is not None:
            alone = replace(self.orientation, axes=self.orientation.axes[:1])
            inside &= alone.allows(poses[:, :3, :3])
        return symmetry.canonical(poses[inside] if inside.any() else poses)
