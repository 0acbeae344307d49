"""ViewsEvidence -> PoseEstimate: one object in several posed views, in their reference frame."""

import contextlib
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.learned import LearnedViews, learned_map_evidence, learned_views
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.pmcl.contour_evidence import STAGES
from pmcl_ros.pmcl.estimate import FOLLOWED, PoseEstimate
from pmcl_ros.pmcl.estimator import Estimator, Thresholds
from pmcl_ros.pmcl.history import Generation, Watch
from pmcl_ros.pmcl.multi_view.exchange import order_of_views
from pmcl_ros.pmcl.multi_view.found import Found
from pmcl_ros.pmcl.multi_view.joint_contours import JointContours
from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence
from pmcl_ros.pmcl.multi_view.joint_posterior import JointPosterior, numbers_of
from pmcl_ros.pmcl.multi_view.joint_proposals import JointProposals
from pmcl_ros.pmcl.multi_view.other_objects import OtherObjects
from pmcl_ros.pmcl.multi_view.second_hypothesis import second_hypothesis, shown_in
from pmcl_ros.pmcl.multi_view.surface import with_surface
from pmcl_ros.pmcl.multi_view.view_warnings import (
    warn_of_order,
    warn_of_unused,
    warn_of_views,
)
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.posterior import Posterior
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.gauss_newton import GaussNewton
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.sampler import Gaussian
from pmcl_ros.pmcl.search import ContourSearch, Stages, refinement
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.tracking.near_prior import NearPrior
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.progress import Progress


@dataclass(frozen=True)
class _Request:
    """What a search is asked for, as of `MultiViewLocalizer`.

    also: (k, 4, 4) where to look besides. with_scale: whether the cameras' scale is checked.
    """

    start: NDArray[np.float64] | None = None
    watch: Watch | None = None
    others: OtherObjects | None = None
    near: NDArray[np.float64] | None = None
    also: NDArray[np.float64] | None = None
    with_scale: bool = False


class MultiViewLocalizer(Closing):
    """Finds one object by its contours in several views. It draws on the processor.

    The settings' region of interest is a box in the reference frame, and so are the estimates.
    numbers: of several views, while they are learned; by default those that the package ships.
    """

    def __init__(self, model: ObjectModel, settings: PmclSettings,
                 numbers: LearnedViews | None = None) -> None:
        self.model, self._settings, self._numbers = model, settings, numbers
        self._renderer = NumbaRenderer()
        self.renderer = self._renderer.name
        self._proposals = JointProposals(model, self._renderer, settings.proposals)
        if numbers is None and settings.evidence != 'edges':
            # A broken file is an error here, not at the first views.
            learned_map_evidence()
            learned_views()
        GaussNewton.warm_up()

    def localize(self, evidence: ViewsEvidence, rng: np.random.Generator,
                 progress: Progress | None = None, start: NDArray[np.float64] | None = None,
                 watch: Watch | None = None, others: OtherObjects | None = None) -> PoseEstimate:
        """The object's pose in the reference frame.

        progress: called with 0..1; returning False ends the search with what was found so far.
        start: (k, 4, 4) where to look first, in the reference frame; proposed by two of the views
        if not given. watch: called with every generation of poses, in the frame of the first view
        that sees the region. others: other objects: it is outside of them, and what they hide of
        it is not missing.
        Raises LocalizationError where no view sees the region of interest.
        """
        stages = Stages(progress or (lambda _: True))
        request = _Request(start, watch, others, with_scale=self._numbers is None)
        first = found = self._localized(evidence, rng, stages, request)
        used = evidence
        if found.estimate.lost and self._numbers is None and stages.go_on(1.0):
            # The progress that is reported is at its end; it can still stop the search.
            ending = Stages(lambda _: stages.go_on(1.0))
            found, used = second_hypothesis(evidence, first, lambda views: self._localized(
                views, rng, ending, replace(request, also=first.modes)))
        if (order := self._other_order(evidence, found)) is not None:
            warn_of_order(order)
            return replace(first.estimate, lost=True)
        return self._told(evidence, len(first.fits), found, used)

    def localize_near(self, evidence: ViewsEvidence, rng: np.random.Generator,
                      near: NDArray[np.float64], progress: Progress | None = None,
                      watch: Watch | None = None) -> PoseEstimate:
        """As `localize`, near poses (k, 4, 4) by fewer views alone, in the reference frame.

        The log says nothing of an object that is lost: it may be elsewhere in the region.
        """
        found = self._localized(evidence, rng, Stages(progress or (lambda _: True)),
                                _Request(watch=watch, near=near))
        if found.estimate.lost or self._other_order(evidence, found) is not None:
            return replace(found.estimate, lost=True)
        return self._told(evidence, len(found.fits), found, evidence)

    def candidate(self, evidence: ViewsEvidence, rng: np.random.Generator, progress: Progress,
                  others: OtherObjects) -> PoseEstimate:
        """As `localize`, of an object that other evidence judges: this says no more about it.

        That pictures are in another order is left to the judge, too.
        """
        found = self._localized(evidence, rng, Stages(progress), _Request(others=others))
        warn_of_unused(evidence, self.model, self._settings, len(found.fits), found.estimate.lost)
        return found.estimate

    def _other_order(self, evidence: ViewsEvidence, found: Found) -> tuple[int, ...] | None:
        """The order of the poses that fits, if it is another, which makes what was found wrong."""
        if self._numbers is not None or found.estimate.lost:
            return None
        return order_of_views(evidence, found)

    def _told(self, evidence: ViewsEvidence, seen: int, found: Found, used: ViewsEvidence
              ) -> PoseEstimate:
        """What was found, by the surface too where that helps; the log warns of what looks wrong.

        seen: views of the evidence that see the region. used: evidence that it was found in.
        """
        if self._numbers is not None:  # they are being learned
            warn_of_unused(evidence, self.model, self._settings, seen, found.estimate.lost)
            return found.estimate
        warn_of_views(evidence, seen, found, self.model, self._settings)
        return with_surface(found.estimate, used, self.model, self._settings)

    def contours(self, evidence: ViewsEvidence, pose: NDArray[np.float64]
                 ) -> dict[int, ContourPoints]:
        """The contour of a pose (4, 4), in the reference frame, in the pixels of each view.

        By the numbers of the views that see the region; cameras are where they are reported to be.
        """
        joint = self._joint(evidence)
        with contextlib.ExitStack() as stack:
            drawn = JointContours.opened(joint, stack)
            seen = drawn.contours(joint.seen(pose), drawn.nominal)
        made = {}
        for number, view in zip(joint.numbers, seen, strict=True):
            whole, part = evidence.views[number].evidence.pinhole, view.volume.pinhole
            shift = np.array([whole.cx - part.cx, whole.cy - part.cy])
            made[number] = replace(view.points, pixels=view.points.pixels + shift)
        return made

    def _localized(self, evidence: ViewsEvidence, rng: np.random.Generator, stages: Stages,
                   request: _Request) -> Found:
        """The pose by all of some views."""
        coarser, watch = evidence.coarser if request.near is None else None, request.watch
        found, evaluations = ((None, 0) if coarser is None
                              else self._found(coarser, rng, stages, request))
        joint = self._joint(evidence, request.others)
        with contextlib.ExitStack() as stack:
            search, posterior = self._opened(joint, stack)
            if request.near is not None:
                scored = search.find_near(joint.seen(request.near), watch)
            elif found is None:
                scored = search.find(self._begin(joint, request), rng, stages, watch)
            else:
                scored = search.sharpen(joint.seen(found), rng, stages, watch)
            sample = search.sample(scored.contenders, rng, stages, watch)
            estimate = self._estimate(evidence, joint, posterior, sample, rng)
            fits = posterior.fits_at(estimate.pose)
            modes = np.stack([each.pose for each in sample.modes])
            shown = (shown_in([posterior.fits_at(each) for each in modes]) if estimate.lost
                     else ())
            understated = posterior.known_near(estimate.pose).understated
            if request.with_scale and posterior.numbers is not None:
                estimate = replace(estimate, camera_scale=posterior.scale_near(estimate.pose))
        evaluations += search.evaluations
        return Found(replace(estimate, evaluations=evaluations).in_frame(joint.first), fits,
                     joint.first @ modes, shown, understated)

    def _joint(self, evidence: ViewsEvidence, others: OtherObjects | None = None) -> JointEvidence:
        return JointEvidence.from_views(evidence, self._renderer, self.model, self._settings,
                                        others)

    def _found(self, coarser: ViewsEvidence, rng: np.random.Generator, stages: Stages,
               request: _Request) -> tuple[NDArray[np.float64], int]:
        """(n, 4, 4) the best poses with larger pixels, in the reference frame; evaluations."""
        joint = self._joint(coarser, request.others)
        begin = self._begin(joint, request)
        with contextlib.ExitStack() as stack:
            search, _ = self._opened(joint, stack)
            found = joint.first @ search.find(begin, rng, stages, request.watch).poses
        return found, search.evaluations

    def _begin(self, joint: JointEvidence, request: _Request) -> NDArray[np.float64]:
        """(k, 4, 4) where the search begins, in the frame of the first camera."""
        begin = (self._proposals.propose(joint) if request.start is None
                 else joint.seen(request.start))
        if request.also is not None:
            begin = np.concatenate([begin, joint.seen(request.also)])
        if request.watch is not None:
            request.watch(Generation('proposals', begin, np.zeros(len(begin))))
        return begin

    def _opened(self, joint: JointEvidence, stack: contextlib.ExitStack
                ) -> tuple[ContourSearch, JointPosterior]:
        """A search, and its posterior, until the stack is closed."""
        posterior = self._posterior(joint, stack)
        return ContourSearch(joint.optimizers(), posterior), posterior

    def follow(self, evidence: ViewsEvidence, prior: Gaussian, rng: np.random.Generator,
               particles: int, candidates: int) -> PoseEstimate:
        """The object's pose in one capture near a prior, as `Localizer.follow`.

        prior, and the estimate: in the reference frame.
        """
        joint = self._joint(evidence)
        near = prior.seen_from(joint.first)
        optimizers = joint.optimizers(STAGES[1:])
        with contextlib.ExitStack() as stack:
            posterior = self._posterior(joint, stack)
            modes = NearPrior(
                self.model, posterior.contours.rigid_score,
                refinement(optimizers[0], joint.feasible),
                refinement(optimizers[1], joint.feasible), posterior.refine, joint.feasible,
                candidates).modes(near, rng)
            if modes:
                sample = posterior.sample_near(near, modes, particles, rng)
                estimate = self._estimate(evidence, joint, posterior, sample, rng)
            else:
                estimate = self._estimator(joint).from_prior(evidence.header, near, particles,
                                                             rng)
        return replace(estimate.in_frame(joint.first), mode=FOLLOWED,
                       evaluations=sum(each.evaluations for each in optimizers))

    def log_likelihoods(self, evidence: ViewsEvidence, poses: NDArray[np.float64]
                        ) -> NDArray[np.float64]:
        """(n,) [nat] of poses (n, 4, 4) in the reference frame, summed over views.

        Scaled as for a posterior about the best of them.
        """
        joint = self._joint(evidence)
        with contextlib.ExitStack() as stack:
            return self._posterior(joint, stack).log_likelihoods(joint.seen(poses))

    def bound(self, evidence: ViewsEvidence, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """(6, 6) Cramér-Rao bound of a true pose (4, 4), in the frame of the first view there.

        By the noise of the evidence about this pose, with the cameras where they fit it best, and
        by the errors of their poses, without a model error.
        """
        joint = self._joint(evidence)
        with contextlib.ExitStack() as stack:
            posterior = JointPosterior.opened(joint, self._settings, None, stack)
            return posterior.fitted_at(joint.seen(pose)).covariance

    def _estimate(self, evidence: ViewsEvidence, joint: JointEvidence, posterior: JointPosterior,
                  sample: Posterior, rng: np.random.Generator
                  ) -> PoseEstimate:
        """In the frame of the first view that sees the region."""
        apart = beyond = math.nan
        if posterior.numbers is not None:
            likeliest = sample.modes[np.bincount(sample.own).argmax()]
            apart = posterior.disagreement_near(likeliest.pose)
            beyond = posterior.beyond_near(likeliest.pose)
        least = self._least(joint, posterior.numbers, apart, beyond)
        estimate = self._estimator(joint).from_posterior(
            evidence.header, [(view.volume.pinhole, camera) for view, camera
                              in zip(joint.views, joint.cameras, strict=True)],
            posterior, sample, least,
            (joint.views[0].volume.model_error if posterior.numbers is None
             else posterior.numbers).degrees_of_freedom, rng)
        return replace(estimate, disagreement=apart, beyond=beyond)

    def _posterior(self, joint: JointEvidence, stack: contextlib.ExitStack) -> JointPosterior:
        """Of what the views show, until the stack is closed."""
        return JointPosterior.opened(joint, self._settings, numbers_of(joint, self._numbers),
                                     stack)

    def _estimator(self, joint: JointEvidence) -> Estimator:
        return Estimator(self.model, joint.region, self._settings, joint.orientation)

    def _least(self, joint: JointEvidence, numbers: LearnedViews | None, apart: float,
               beyond: float) -> Thresholds:
        """numbers: None for those of one view. apart: by how much the views disagree. beyond: mean
        evidence beyond the contours."""
        first = joint.views[0]
        chosen = self._settings.chosen_support
        alone = Thresholds.from_volume(first.volume, first.profile, chosen)
        if numbers is None:
            return alone
        if chosen is not None:
            return replace(alone, evidence=numbers.least_evidence)
        return Thresholds(numbers.needed(joint.independent, apart, beyond, alone.support),
                          numbers.least_evidence, alone.weight,
                          numbers.slopes(joint.independent, alone.slopes))

    def evidence(self, evidence: ViewsEvidence, poses: NDArray[np.float64],
                 others: OtherObjects | None = None) -> NDArray[np.float64]:
        """(n,) evidence of poses (n, 4, 4) in the reference frame, summed over views [nat].

        Nuisances are those that fit best. others: as of `localize`.
        """
        joint = self._joint(evidence, others)
        with contextlib.ExitStack() as stack:
            posterior = self._posterior(joint, stack)
            return np.array([posterior.evidence_at(each) for each in joint.seen(poses)])
