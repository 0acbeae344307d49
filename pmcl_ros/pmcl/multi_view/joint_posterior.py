"""The posterior of a pose by several views: a Gaussian about each mode.

Several views leave little room for other shapes (Laplace's approximation).
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.learned import LearnedViews, learned_views
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.history import Generation, Watch
from pmcl_ros.pmcl.local_model import LocalModel, gauss_newton
from pmcl_ros.pmcl.modes import SAME_MODE
from pmcl_ros.pmcl.multi_view.camera_errors import CameraScale, understated
from pmcl_ros.pmcl.multi_view.joint_contours import JointContours, ViewFit
from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.posterior import Mode, Posterior
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.sampler import Gaussian
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.tracking.local_search import log_volume, product
from pmcl_ros.runtime.progress import Progress

_REFINEMENTS = 12  # Gauss-Newton steps at most; poses and nuisances converge in less
_SAME_POSE = 1e-6  # m, rad: between poses with one local model
_SCALE = 0.03  # of distances: standard deviation of a scale of which little is known
_CONTOURS = 0.004  # of distances: a contour 120 px across is found a quarter of a pixel off


def numbers_of(joint: JointEvidence, given: LearnedViews | None = None) -> LearnedViews | None:
    """The numbers of several views: those given, by default those that the package ships.

    None for a single view, or evidence that is no contour map. Raises SettingsError.
    """
    several = len(joint.views) > 1 and isinstance(joint.views[0].volume, ContourMap)
    return (given or learned_views()) if several else None


@dataclass(frozen=True)
class JointPosterior:
    """Modes of the evidence of several views, and samples of the Gaussians about them.

    Nuisances, the motions of uncertain cameras and the displacement of contours, are those that
    fit each mode best. numbers: of several views; None: the model error is that of one.
    """

    model: ObjectModel
    settings: PmclSettings
    contours: JointContours
    numbers: LearnedViews | None
    _known: list['KnownMode'] = field(default_factory=list)

    @classmethod
    def opened(cls, joint: JointEvidence, settings: PmclSettings, numbers: LearnedViews | None,
               stack: contextlib.ExitStack) -> 'JointPosterior':
        """Of the object of the evidence, until the stack is closed."""
        displacement = 0.0 if numbers is None else numbers.displaced(joint.independent)
        return cls(joint.model, settings, JointContours.opened(joint, stack, displacement),
                   numbers)

    def feasible(self, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,) which of poses (n, 4, 4) are, as of the evidence."""
        return self.contours.joint.feasible(poses)

    def local_model_at(self, pose: NDArray[np.float64], sure: bool) -> LocalModel:
        """At a pose (4, 4), with the nuisances of the mode nearby; sure: with its uncertainty."""
        known = self.known_near(pose)
        if not sure:
            return self.contours.local_model(pose, False, known.nuisances, known.scale)
        off = self.model.symmetry.local(pose[None], known.pose)
        if known.local is not None and np.abs(off).max() < _SAME_POSE:
            return known.local
        return self._sure(pose, known)

    def points_at(self, pose: NDArray[np.float64]) -> ContourPoints:
        """The contour of a pose (4, 4) in all views, with the same nuisances."""
        return self.contours.points(pose, self.known_near(pose).nuisances)

    def share_at(self, pose: NDArray[np.float64]) -> float:
        """Of the contour of a pose (4, 4) in all views, that of these points."""
        return self.contours.share(pose)

    def inside_at(self, pose: NDArray[np.float64]) -> float:
        """Mean over views of the log odds that what a pose (4, 4) covers is a solid [nat / px]."""
        joint = self.contours.joint
        return float(np.mean([view.inside(np.linalg.inv(camera) @ pose) for view, camera
                              in zip(joint.views, joint.cameras, strict=True)]))

    def known_near(self, pose: NDArray[np.float64]) -> 'KnownMode':
        """The mode next to a pose (4, 4), else one with the nuisances at their nominal values."""
        symmetry = self.model.symmetry
        same = [each for each in self._known
                if symmetry.same_mode(each.pose[None], pose, *SAME_MODE)[0]]
        if not same:
            return KnownMode(pose, self.contours.nominal, 1.0)
        # Not the last one: a duplicate that was refined later is worse, or the same.
        poses = symmetry.nearest_equivalents(np.stack([each.pose for each in same]), pose)
        apart = symmetry.local(poses, pose) / np.repeat(SAME_MODE, 3)
        return same[int(np.linalg.norm(apart, axis=1).argmin())]

    def error_share_near(self, pose: NDArray[np.float64]) -> float:
        """Factor of the model error's variance at the mode near a pose (4, 4)."""
        return self._error_share(self.known_near(pose))

    def disagreement_near(self, pose: NDArray[np.float64]) -> float:
        """Of the views at the mode near a pose (4, 4)."""
        known = self.known_near(pose)
        if known.disagreement is None:
            return self.contours.disagreement(known.pose, known.nuisances)
        return known.disagreement

    def beyond_near(self, pose: NDArray[np.float64]) -> float:
        """Mean evidence beyond the contours of the mode near a pose (4, 4) [nat / px]."""
        known = self.known_near(pose)
        return self.contours.beyond(known.pose, known.nuisances)

    def scale_near(self, pose: NDArray[np.float64]) -> CameraScale:
        """The scale error of the cameras' poses, by the mode near a pose (4, 4)."""
        known, joint = self.known_near(pose), self.contours.joint
        errors = joint.errors.with_scale(joint.cameras, known.pose[:3, 3], _SCALE)
        freer = replace(self, contours=replace(self.contours, joint=replace(joint, errors=errors)))
        pose, nuisances, local = freer._refined_at(
            -1, known.pose, np.insert(known.nuisances, -1, 0), known.scale, False)
        # Where views fit better, their evidence counts more.
        scale = freer.contours.local_model(pose, True, nuisances, None).scale
        local = freer.contours.local_model(pose, False, nuisances, scale)
        assert local.nuisances is not None
        variance = local.nuisances.covariance(local.information)[-2, -2]
        return CameraScale(_SCALE * float(nuisances[-2]),
                           float(np.hypot(_SCALE * np.sqrt(variance), _CONTOURS)))

    def fits_at(self, pose: NDArray[np.float64]) -> list[ViewFit]:
        """How each view agrees with a pose (4, 4), its camera where it is reported to be.

        Contours are displaced as at the mode nearby.
        """
        nuisances = self.contours.nominal
        nuisances[-1] = self.known_near(pose).nuisances[-1]
        return self.contours.fits(pose, nuisances)

    def evidence_at(self, pose: NDArray[np.float64]) -> float:
        """Of a pose (4, 4), with the nuisances that fit it best [nat]."""
        return self._refined(pose, True)[2].evidence

    def fitted_at(self, pose: NDArray[np.float64]) -> LocalModel:
        """At a pose (4, 4), with the nuisances that fit it best."""
        _, nuisances, _, scale = self._refined(pose, True)
        return self.contours.local_model(pose, True, nuisances, scale)

    def displacement_at(self, pose: NDArray[np.float64]) -> float:
        """By how much contours are found outside of those of a pose (4, 4) [px]."""
        return self.contours.displacement * float(self._refined(pose, True)[1][-1])

    def log_likelihoods(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) [nat] of poses (n, 4, 4): `evidence_at` each, scaled as about the best of them."""
        values = np.array([self.evidence_at(each) for each in poses])
        return self.fitted_at(poses[int(values.argmax())]).scale * values

    def refine(self, pose: NDArray[np.float64]) -> Mode:
        """The mode nearby: Gauss-Newton steps of the pose and of the nuisances."""
        pose, nuisances, _, scale = self._refined(pose, False)
        disagreement = (None if self.numbers is None
                        else self.contours.disagreement(pose, nuisances))
        known = self._with_errors(KnownMode(pose, nuisances, scale, disagreement))
        local = self._sure(pose, known)
        self._known.append(replace(known, local=local))
        return Mode(pose, local)

    def _with_errors(self, known: 'KnownMode') -> 'KnownMode':
        """With camera errors as large as the views show them."""
        if self.contours.joint.errors.number == 0:
            return known
        local = self.contours.local_model(known.pose, True, known.nuisances, known.scale)
        if local.nuisances is None or local.nuisances.scatter is None:
            return known  # no view shows a contour
        return replace(known, understated=understated(
            known.nuisances[:-1], local.nuisances.covariance(local.information)[:-1, :-1],
            local.nuisances.scatter[:-1, :-1]))

    def _sure(self, pose: NDArray[np.float64], known: 'KnownMode') -> LocalModel:
        """With its uncertainty, for camera errors that are as large as the views show them."""
        contours, nuisances = self.contours, known.nuisances.copy()
        if known.understated > 1:
            joint = contours.joint
            contours = replace(contours, joint=replace(joint, errors=joint.errors.enlarged(
                known.understated)))
            nuisances[:-1] /= known.understated
        local = contours.local_model(pose, True, nuisances, known.scale)
        return replace(local, model_error=self._error_share(known) * local.model_error)

    def _error_share(self, known: 'KnownMode') -> float:
        """Factor of the model error's variance: large where views disagree."""
        if self.numbers is None or known.disagreement is None:
            return 1.0
        return self.numbers.share(self.contours.joint.independent, known.disagreement)

    def _refined(self, pose: NDArray[np.float64], still: bool
                 ) -> tuple[NDArray[np.float64], NDArray[np.float64], LocalModel, float]:
        """Pose, nuisances, local model and its scale; still: the pose stays."""
        nuisances, scale = self.contours.nominal, 1.0
        if not self.contours.exact:
            scale = self.contours.local_model(pose, True, nuisances, None).scale
        for level in range(len(self.contours.levels)):
            pose, nuisances, best = self._refined_at(level, pose, nuisances, scale, still)
        return pose, nuisances, best, scale

    def _refined_at(self, level: int, pose: NDArray[np.float64], nuisances: NDArray[np.float64],
                    scale: float, still: bool
                    ) -> tuple[NDArray[np.float64], NDArray[np.float64], LocalModel]:
        return gauss_newton(pose, nuisances, lambda each, moved: self.contours.local_model(
            each, False, moved, scale, level), _REFINEMENTS, self.feasible, still)

    def sample(self, modes: list[Mode], rng: np.random.Generator, progress: Progress,
               watch: Watch | None = None) -> Posterior:
        """Particles of the Gaussians about modes, best first; each has its mode as the mean."""
        scale, symmetry = modes[0].local.scale, self.model.symmetry
        gaussians = [Gaussian(
            mode.pose, mode.local.basis,
            np.linalg.cholesky(np.linalg.inv(scale * mode.local.information)), symmetry)
            for mode in modes]
        masses = [scale * mode.local.evidence + each.log_volume
                  for mode, each in zip(modes, gaussians, strict=True)]
        posterior = mixture(modes, gaussians, masses, self.settings.particles, rng)
        if watch is not None:
            watch(Generation('posterior', posterior.poses.copy(), posterior.values.copy()))
        progress(1.0)
        return posterior

    def sample_near(self, prior: Gaussian, modes: list[Mode], count: int,
                    rng: np.random.Generator) -> Posterior:
        """`count` particles of the products of a prior and the Gaussians about modes."""
        scale = modes[0].local.scale
        gaussians = [product(prior, mode, 1.0) for mode in modes]
        masses = [scale * mode.local.evidence + log_volume(prior, mode, each)
                  for mode, each in zip(modes, gaussians, strict=True)]
        return mixture(modes, gaussians, masses, count, rng)


@dataclass(frozen=True)
class KnownMode:
    """A mode's pose (4, 4), and there: nuisances (k + 1,), scale, by how much the views disagree
    if that was asked for, the local model with its uncertainty if it was refined, and by what
    factor the stated errors of the cameras are too small."""

    pose: NDArray[np.float64]
    nuisances: NDArray[np.float64]
    scale: float
    disagreement: float | None = None
    local: LocalModel | None = None
    understated: float = 1.0


def mixture(modes: Sequence[Mode], gaussians: Sequence[Gaussian], masses: Sequence[float],
            count: int, rng: np.random.Generator) -> Posterior:
    """Particles of Gaussians of log masses; each Gaussian has its mean as theirs.

    modes: of the Gaussians, best first.
    """
    pairs = np.sort(rng.choice(len(modes), (count + 1) // 2, p=np.exp(masses - logsumexp(masses))))
    own = np.repeat(pairs, 2)[:count]
    poses, values = np.empty((count, 4, 4)), np.empty(count)
    for number, (each, mass) in enumerate(zip(gaussians, masses, strict=True)):
        ours = np.flatnonzero(own == number)
        normal = rng.normal(size=((len(ours) + 1) // 2, len(each.spread)))
        normal = np.stack([normal, -normal], axis=1).reshape(-1, len(each.spread))[:len(ours)]
        poses[ours] = retract(each.pose, each.deviations(normal))
        values[ours] = mass - each.log_volume - np.square(normal).sum(axis=1) / 2
    return Posterior(tuple(modes), poses, values, own)
