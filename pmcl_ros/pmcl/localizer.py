"""EvidenceVolume -> PoseEstimate: the default mode, by the object's contour."""

import contextlib
import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

import moderngl
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.learned import learned_map_evidence
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.pmcl.contour_approximations import LinearizedContour
from pmcl_ros.pmcl.contour_evidence import STAGES, ContourEvidence, scene
from pmcl_ros.pmcl.estimate import FOLLOWED, PoseEstimate
from pmcl_ros.pmcl.estimator import Estimator, Thresholds
from pmcl_ros.pmcl.history import Generation, Watch
from pmcl_ros.pmcl.local_model import LocalModel, Observation, weighted
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.posterior import Feasible, Posterior, Score
from pmcl_ros.pmcl.prior.orientation import Orientation
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.proposals.template_matching import Proposals
from pmcl_ros.pmcl.render.back_end import make_renderer
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.contour_score import ContourScore
from pmcl_ros.pmcl.render.creases import Creases
from pmcl_ros.pmcl.render.gauss_newton import GaussNewton
from pmcl_ros.pmcl.render.scene import Window
from pmcl_ros.pmcl.render.sunken import with_sunken
from pmcl_ros.pmcl.sampler import Gaussian
from pmcl_ros.pmcl.search import ContourSearch, Modes, Stages, refinement
from pmcl_ros.pmcl.second_search import is_needed, second_search
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.support import share_in_view
from pmcl_ros.pmcl.tracking.local_search import sample_near
from pmcl_ros.pmcl.tracking.near_prior import NearPrior, rigid_score
from pmcl_ros.pmcl.view_terms import ViewContour
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.errors import LocalizationError, RenderError
from pmcl_ros.runtime.progress import Progress

_LOG = logging.getLogger(__name__)
# image px: tolerance of the simplified mesh of a followed object; it biases the depth as much
FINEST_DETAIL = 0.05

Shown = Callable[[ContourPoints], NDArray[np.float64]]


class Localizer(Closing):
    """Finds one object by its contour in evidence volumes: the mode default.

    With the renderer gl it owns a headless GL context: make, use, close it in one thread.
    profile: of the contour; by default that of the evidence, with the model's creases beside.
    error: of the model; by default that of the evidence.
    Raises RenderError when there is no GL, LocalizationError when the region is impossible.
    """

    def __init__(self, model: ObjectModel, settings: PmclSettings,
                 profile: ContourProfile | None = None, error: ModelError | None = None) -> None:
        self._model = model
        self._settings = settings
        if profile is None:  # a broken file is an error here, not at the first capture
            ContourProfile.learned()
            if error is None and settings.evidence != 'edges':
                learned_map_evidence()
        self._profile = profile
        self._error = error
        self._creases = Creases.from_model(model) if profile is None else None
        self._region = Region(settings.roi_center, settings.roi_size)
        self._warned = False  # that its middle is out of view
        self._orientation = Orientation.from_settings(settings, model)
        self._estimator = Estimator(model, self._region, settings, self._orientation)
        self._renderer = make_renderer(settings.renderer, likelihoods=False)
        self.renderer = self._renderer.name
        try:
            GaussNewton.warm_up()
            self._proposals = Proposals(self._renderer, model, self._region)
        except BaseException:
            self._renderer.close()
            raise

    def close(self) -> None:
        """Release the GL context, if there is one."""
        self._renderer.close()

    def localize(self, volume: EvidenceVolume, rng: np.random.Generator,
                 progress: Progress | None = None,
                 start: NDArray[np.float64] | None = None,
                 watch: Watch | None = None, feasible: Feasible | None = None) -> PoseEstimate:
        """The object's pose in one capture.

        Other evidence of the capture (`EdgeVolume.other`), if there is any, is searched too where
        `second_search` says so.
        progress: called with 0..1; returning False ends the search with what was found so far.
        start: (k, 4, 4) where alone to look; proposed from the evidence if not given.
        watch: called with every generation of poses; the pose is the same with it and without.
        feasible: (n,) which of poses (n, 4, 4) are allowed, beside being in the region.
        Raises LocalizationError when the volume's labels do not reach the region of interest, and
        with the renderer gl RenderError in another thread, after `close`, or when the GL refuses
        its work.
        """
        self._renderer.use()
        progress = progress or (lambda _: True)
        try:
            found = self._search(volume, rng, progress, start, watch, feasible,
                                 self._settings.chosen_support)
            stages = Stages(progress)
            if (start is None and isinstance(volume, EdgeVolume) and volume.other is not None
                    and is_needed(found) and stages.go_on(1.0)):
                # Spawned whether other evidence comes or not: later captures do not depend on it.
                second = rng.spawn(1)[0]
                return second_search(
                    found, volume, volume.other, self, lambda other, seen: self._search(
                        other, second, lambda _: stages.go_on(1.0), None, seen, feasible,
                        least_support=None), stages, watch)
            return found
        except moderngl.Error as error:
            raise RenderError(f'{self.renderer} refused its work: {error}') from error

    def contour(self, volume: EvidenceVolume, pose: NDArray[np.float64]) -> ContourPoints:
        """The contour of a pose (4, 4) and its evidence, as the search judges it.

        Raises as `localize` does.
        """
        self._renderer.use()
        with replace(self._evidence(volume), creases=None).score() as exact:
            return exact.points(pose)

    def evidence(self, volume: EvidenceVolume, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) evidence of poses (n, 4, 4), by contours and creases, as the search sums it [nat].

        Raises as `localize` does.
        """
        self._renderer.use()
        with self._evidence(volume).score() as exact:
            return exact(poses)

    def log_likelihoods(self, volume: EvidenceVolume, poses: NDArray[np.float64]
                        ) -> NDArray[np.float64]:
        """(n,) [nat] of poses (n, 4, 4), by contours and creases.

        Scaled as for a posterior about the best of them. Raises as `localize` does.
        """
        self._renderer.use()
        evidence = self._evidence(volume)
        with evidence.score() as exact:
            values = exact(poses)
            best = evidence.posterior(exact).local_model_at(poses[values.argmax()], True)
            return best.scale * values

    def _evidence(self, volume: EvidenceVolume) -> ContourEvidence:
        return ContourEvidence.from_volume(volume, self._renderer, self._model, self._settings,
                                          self._profile, self._error, self._creases)

    def _search(self, volume: EvidenceVolume, rng: np.random.Generator, progress: Progress,
                start: NDArray[np.float64] | None, watch: Watch | None,
                feasible: Feasible | None, least_support: float | None) -> PoseEstimate:
        """least_support: as of `Thresholds.from_volume`: what was chosen for edges is of no other.
        """
        self._region.check_depths(volume.depths)
        if not self._warned and (problem := self._region.middle_out_of_view(volume.pinhole)):
            self._warned = True
            _LOG.warning('%s', problem)
        evidence = replace(self._evidence(volume), constraint=feasible)
        if start is not None and not len(start):
            raise LocalizationError('no pose to start from was given; leave `start` out to have '
                                    'them proposed')
        if start is None:
            start = self._proposed(volume, watch)
        stages = Stages(progress)
        with contextlib.ExitStack() as stack:
            search, exact = _opened(evidence, stack)
            refined = [search]
            if volume.coarser is None:
                poses = search.find(start, rng, stages, watch).poses
            else:
                coarser, _ = _opened(replace(self._evidence(volume.coarser), constraint=feasible),
                                     stack)
                refined.append(coarser)
                poses = search.sharpen(coarser.find(start, rng, stages, watch).poses, rng, stages,
                                       watch).poses
            sample = search.sample(poses, rng, stages, watch)
            estimate = self._estimate(evidence, search.posterior, sample, least_support, rng,
                                      flat=True)
            return replace(estimate, evaluations=exact.evaluations + sum(
                each.evaluations for each in refined))

    def _estimate(self, evidence: ContourEvidence, shown: Modes, posterior: Posterior,
                  least_support: float | None, rng: np.random.Generator, flat: bool = False
                  ) -> PoseEstimate:
        """As `Estimator.from_posterior`."""
        volume = evidence.volume
        return self._estimator.from_posterior(
            volume.header, [(volume.pinhole, np.eye(4))], shown, posterior,
            Thresholds.from_volume(volume, evidence.profile, least_support),
            evidence.error.degrees_of_freedom, rng, flat)

    def _proposed(self, evidence: EvidenceVolume, watch: Watch | None) -> NDArray[np.float64]:
        """(k, 4, 4) poses where a search begins."""
        start, scores = self._proposals.propose(
            evidence.coarser or evidence, self._settings.proposals, self._orientation)
        if watch is not None:
            watch(Generation('proposals', start, scores))
        return with_sunken(start, self._model, self._settings.interface)

    def follow(self, volume: EvidenceVolume, prior: Gaussian, rng: np.random.Generator,
               particles: int, candidates: int) -> PoseEstimate:
        """The object's pose in one capture near a prior, which is a part of the posterior.

        prior: in the tangent space without the axis of symmetry. The rest as in `localize`; the
        object is lost where no contour of it is in view.
        """
        self._renderer.use()
        self._region.check_depths(volume.depths)
        evidence = replace(self._evidence(volume), detail=FINEST_DETAIL)
        optimizers = evidence.optimizers(STAGES[:2])
        with evidence.score() as exact:
            search = evidence.posterior(exact)
            score = search.exact if evidence.creases is not None else None

            def rigid(pose: NDArray[np.float64]) -> Score | None:
                points = exact.points(pose)
                return rigid_score(pose, points, evidence.volume) if len(points.lengths) else None

            modes = NearPrior(
                self._model, rigid, refinement(optimizers[0], search.feasible),
                refinement(optimizers[1], search.feasible, score=score), search.refine,
                search.feasible, candidates).modes(prior, rng)
            if not modes:
                return replace(self._estimator.from_prior(volume.header, prior, particles, rng),
                               mode=FOLLOWED)
            posterior = sample_near(search, prior, modes, particles, rng)
            estimate = self._estimate(evidence, search, posterior,
                                      self._settings.chosen_support, rng)
            return replace(estimate, mode=FOLLOWED, evaluations=exact.evaluations + sum(
                each.evaluations for each in optimizers))

    def observe(self, volume: EvidenceVolume, poses: Sequence[NDArray[np.float64]]
                ) -> list[Observation]:
        """The object's contour, depth picture and local model at each of poses (4, 4).

        Raises as `localize` does.
        """
        self._renderer.use()
        evidence = replace(self._evidence(volume), creases=None, detail=FINEST_DETAIL)
        camera = volume.pinhole
        whole = scene(self._model, self._region, camera,
                      Window(0, 0, (camera.width, camera.height)), FINEST_DETAIL,
                      evidence.interface)
        depths = [self._renderer.depths(whole, each[None])[0] for each in poses]
        with evidence.score() as exact:
            points = [exact.points(each) for each in poses]
        return [Observation(pose, seen, depth,
                            LocalModel.from_views(
                                pose, self._model.symmetry,
                                [ViewContour(seen, evidence.volume, evidence.profile)],
                                evidence.error),
                            share_in_view(self._model, pose, camera))
                for pose, seen, depth in zip(poses, points, depths, strict=True)]

    def refine(self, volume: EvidenceVolume, pose: NDArray[np.float64], rng: np.random.Generator,
               shown: Shown) -> PoseEstimate:
        """The object's pose near one (4, 4), with a part of its contour hidden.

        shown: (m,) weight of each point of a contour, 0 to 1; 0 counts as out of view.
        The rest as in `localize`.
        """
        self._renderer.use()
        evidence = replace(self._evidence(volume), creases=None)
        with evidence.score() as exact:
            def share(each: NDArray[np.float64]) -> float:
                return float(search.points_at(each).lengths.sum()
                             / max(exact.points(each).lengths.sum(), 1e-9))

            search = evidence.posterior(exact, lambda points: weighted(points, shown(points)))
            search = replace(search, share_at=share)
            mode = search.refine(pose)
            points = exact.points(mode.pose)
            hidden = weighted(points, 1 - shown(points))
            rest = LinearizedContour.from_view(
                mode.pose, ViewContour(hidden, evidence.volume, evidence.profile))

            def partly(poses: NDArray[np.float64]) -> NDArray[np.float64]:
                # Subtract the evidence of the hidden part, to first order.
                off = self._model.symmetry.local(poses, mode.pose)
                return search.exact(poses) - rest.evidence(off)

            posterior = replace(search, exact=partly).sample([mode], rng, lambda _: True)
            estimate = self._estimate(evidence, search, posterior,
                                      self._settings.chosen_support, rng)
            return replace(estimate, evaluations=exact.evaluations)


def _opened(evidence: ContourEvidence, stack: contextlib.ExitStack
            ) -> tuple[ContourSearch, ContourScore]:
    """A search, and what scores its poses, until the stack is closed."""
    exact = stack.enter_context(evidence.score())
    posterior = evidence.posterior(exact)
    score = posterior.exact if evidence.creases is not None else None
    return ContourSearch(evidence.optimizers(), posterior, score), exact
