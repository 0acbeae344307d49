"""DepthLikelihoodVolume -> PoseEstimate."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

import moderngl
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.edges import edges_from_likelihood
from pmcl_ros.dlv.gl_volume import GlVolume
from pmcl_ros.dlv.volume import EdgeVolume
from pmcl_ros.errors import LocalizationError, RenderError
from pmcl_ros.gl import GlContext
from pmcl_ros.pmcl.contour_profile import ContourProfile
from pmcl_ros.pmcl.creases import Creases
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.estimator import Contour, Estimator, Volume
from pmcl_ros.pmcl.faithful import faithful_filter
from pmcl_ros.pmcl.history import Generation, Watch, recorder
from pmcl_ros.pmcl.level_of_detail import simplified
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.local_search import LocalSearch
from pmcl_ros.pmcl.look import Look, weighted
from pmcl_ros.pmcl.model_error import CONTOUR_ERROR
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.posterior import Ascend, ContourPosterior
from pmcl_ros.pmcl.proposals import Proposals
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.back_end import make_renderer
from pmcl_ros.pmcl.render.climb import Climb
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.crease_lines import CreasePoints
from pmcl_ros.pmcl.render.gl_renderer import GlRenderer
from pmcl_ros.pmcl.render.raster import LARGEST
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.sampler import Gaussian
from pmcl_ros.pmcl.search import ContourSearch
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.sliding_contour import SlidingContour
from pmcl_ros.pmcl.summary import tangent
from pmcl_ros.pmcl.support import share_in_view
from pmcl_ros.pmcl.weights import Weights

FOLLOWED = 'followed'  # the mode of what `Localizer.follow` makes
_LOG = logging.getLogger(__name__)
_COARSE, _FINE = 4, 2  # image px per pixel of the z-buffers of the search
_DETAIL = 0.3  # image px: what may be left out of the mesh in them
_FINEST = 0.05  # image px: likewise where an object is followed; it is found as much too near
# Of the climbs, image px: how far aside slopes are taken on coarse, fine and the finest contours,
# how far a step goes at most, and at least. Tries: of steps.
_STEPS, _FARTHEST, _CONVERGED, _TRIES = (1.5, 1.0, 1.0), 2.0, 0.1, 8

Progress = Callable[[float], bool]
Score = Callable[[NDArray[np.float64]], NDArray[np.float64]]
Free = Callable[[NDArray[np.float64]], NDArray[np.bool_]]
Shown = Callable[[ContourPoints], NDArray[np.float64]]


class Localizer:
    """Finds one object in volumes.

    With the renderer gl it owns a headless GL context: make, use, close it in one thread.
    profile: of the contour, in the mode default; by default the learned one.
    creases: that count too; by default the model's where `profile` is left out, else none.
    Raises RenderError when there is no GL, LocalizationError when the region is impossible.
    """

    def __init__(self, model: ObjectModel, settings: PmclSettings,
                 profile: ContourProfile | None = None,
                 creases: Creases | None = None) -> None:
        self._model = model
        self._settings = settings
        self._profile = profile or ContourProfile.learned()
        self._creases = creases or (Creases.of(model) if profile is None else None)
        self._region = Region(settings.roi_center, settings.roi_size)
        self._estimator = Estimator(model, self._region, settings)
        self._renderer = make_renderer(settings.renderer, settings.mode == 'faithful')
        self.renderer = self._renderer.name
        try:
            if settings.mode == 'default':
                Climb.warm_up()
            self._proposals = Proposals(self._renderer, model, self._region)
        except BaseException:
            self._renderer.close()
            raise

    def __enter__(self) -> 'Localizer':
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the GL context, if there is one."""
        self._renderer.close()

    @property
    def context(self) -> GlContext | None:
        """Where poses are scored; a volume made there (`build_gl_volume`) is read where it is."""
        return self._renderer.context if isinstance(self._renderer, GlRenderer) else None

    def localize(self, volume: Volume, rng: np.random.Generator,
                 progress: Progress | None = None,
                 start: NDArray[np.float64] | None = None,
                 watch: Watch | None = None, free: Free | None = None) -> PoseEstimate:
        """The object's pose in one volume, in memory or on the GPU in this localizer's context.

        start: (k, 4, 4) where to look first, in the mode default; proposed from the volume if not
            given.

        progress: called with 0..1; returning False ends the search with what was found so far.
        watch: told every generation of particles; the pose is the same with it and without.
        free: (n,) which of poses (n, 4, 4) are possible, beside being in the region, in the mode
            default.
        Raises LocalizationError when the volume does not reach the region of interest, and with
        the renderer gl RenderError in another thread, after `close`, or when the GL refuses its
        work.
        """
        self._renderer.use()
        self._check_range(volume)
        try:
            if self._settings.mode == 'faithful':
                return self._by_likelihood(volume, rng, progress or (lambda _: True), watch)
            return self._by_contour(volume, rng, progress or (lambda _: True), start, watch,
                                    free)
        except moderngl.Error as error:
            raise RenderError(f'{self.renderer} refused its work: {error}') from error

    def contour(self, volume: Volume, pose: NDArray[np.float64]) -> ContourPoints:
        """The contour of a pose (4, 4) and its evidence, as the mode default judges it.

        Raises as `localize` does.
        """
        self._renderer.use()
        edges, profile = self._edges(volume)
        window = self._region.window(volume.pinhole, self._model.radius)
        with self._renderer.contour_score(self._scene(volume, window), edges, profile) as exact:
            return exact.points(pose)

    def evidence(self, volume: Volume, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) of poses (n, 4, 4), nat: by contours and creases, as the mode default judges them.

        Raises as `localize` does.
        """
        self._renderer.use()
        edges, profile = self._edges(volume)
        creases = None if volume.edges is None else self._creases
        window = self._region.window(volume.pinhole, self._model.radius)
        with self._renderer.contour_score(self._scene(volume, window), edges, profile,
                                          creases) as exact:
            return exact(poses)

    def _edges(self, volume: Volume) -> tuple[EdgeVolume, ContourProfile]:
        """Where contours are looked for, and what edge energies there say."""
        if volume.edges is not None:
            return volume.edges, self._profile
        _LOG.info('no edge volume was given: contours are looked for in the likelihood')
        whole = volume.read() if isinstance(volume, GlVolume) else volume
        # The tables were learned on sharp edge volumes: other edges are judged by their contrast.
        return edges_from_likelihood(whole), ContourProfile.contrast()

    def _by_contour(self, volume: Volume, rng: np.random.Generator,
                    progress: Progress, start: NDArray[np.float64] | None,
                    watch: Watch | None, free: Free | None) -> PoseEstimate:
        edges, profile = self._edges(volume)
        # Their tables were learned on sharp edge volumes, as the contour's.
        creases = None if volume.edges is None else self._creases
        window = self._region.window(volume.pinhole, self._model.radius)
        if start is not None and not len(start):
            raise LocalizationError('no pose to start from was given; leave `start` out to have '
                                    'them proposed')
        if start is None:
            start, scores = self._proposals.propose(edges, self._settings.proposals)
            if watch is not None:
                watch(Generation('proposals', start, scores))
        climbs = self._climbs(volume, edges, profile)
        with self._renderer.contour_score(self._scene(volume, window), edges, profile,
                                          creases) as exact:
            posterior = self._posterior(exact, edges, profile, exact.points, free, exact.creases)
            rough = self._ascent(climbs[0], free, 0)
            coarse, fine, finest = (self._ascent(each, free) for each in climbs)
            if creases is not None:  # no climb sees them
                fine = self._judged(fine, posterior.exact)
            sample = ContourSearch(rough, coarse, fine, finest, posterior).run(start, rng,
                                                                               progress, watch)
            estimate = self._estimator.of_posterior(
                volume, sample, posterior.about, exact.points, profile.least, rng)
            return replace(estimate, evaluations=exact.evaluations + sum(
                each.evaluations for each in climbs))

    def _climbs(self, volume: Volume, edges: EdgeVolume, profile: ContourProfile, count: int = 3
                ) -> list[Climb]:
        """The first of: by coarse contours, by fine ones, at the image's own resolution."""
        window = self._region.window(volume.pinhole, self._model.radius)
        least = -(-max(window.size) // LARGEST)  # they are drawn by the processor
        return [Climb(self._scene(volume, window.coarser(max(scale, least))), edges, profile,
                      self._region, step)
                for scale, step in zip((_COARSE, _FINE, 1)[:count], _STEPS[:count], strict=True)]

    def _ascent(self, climb: Climb, free: Free | None = None, tries: int = _TRIES) -> Ascend:
        def ascend(poses: NDArray[np.float64]
                   ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            found, values = climb(poses, tries, _FARTHEST, _CONVERGED)
            barred = ~self._possible(found, free)
            if barred.any():  # what ends where it cannot be has not moved
                found[barred], values[barred] = climb(poses[barred], 0, 0, 0)
            return found, np.where(self._possible(found, free), values, -np.inf)
        return ascend

    @staticmethod
    def _judged(ascend: Ascend, score: Score) -> Ascend:
        def judged(poses: NDArray[np.float64]
                   ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            found, _ = ascend(poses)
            return found, score(found)
        return judged

    def follow(self, volume: Volume, prior: Gaussian, rng: np.random.Generator,
               particles: int, candidates: int) -> PoseEstimate:
        """The object's pose in one volume, by its contour, near where a prior expects it.

        prior: in the space that the symmetry leaves. It is a part of the posterior. The rest as in
        `localize`; the object is lost where no contour of it is in view.
        """
        self._renderer.use()
        self._check_range(volume)
        edges, profile = self._edges(volume)
        creases = None if volume.edges is None else self._creases
        window = self._region.window(volume.pinhole, self._model.radius)
        with self._renderer.contour_score(self._scene(volume, window, _FINEST), edges,
                                          profile, creases) as exact:
            search = self._posterior(exact, edges, profile, exact.points, None, exact.creases)
            climbs = self._climbs(volume, edges, profile, 2)
            coarse, fine = (self._ascent(each) for each in climbs)
            if creases is not None:  # no climb sees them
                fine = self._judged(fine, search.exact)
            posterior = LocalSearch(exact.points, edges, coarse, fine, search, particles,
                                    candidates).run(prior, rng)
            if posterior is None:
                return replace(self._estimator.of_prior(volume, prior, particles, rng),
                               mode=FOLLOWED)
            estimate = self._estimator.of_posterior(
                volume, posterior, search.about, exact.points, profile.least, rng)
            return replace(estimate, mode=FOLLOWED, evaluations=exact.evaluations + sum(
                each.evaluations for each in climbs))

    def looks(self, volume: Volume, poses: Sequence[NDArray[np.float64]]) -> list[Look]:
        """What the object shows of itself at each of poses (4, 4), by the mode default.

        Raises as `localize` does.
        """
        self._renderer.use()
        edges, profile = self._edges(volume)
        camera = volume.pinhole
        whole = Window(0, 0, (camera.width, camera.height))
        depths = [self._renderer.depths(self._scene(volume, whole, _FINEST), each[None])[0]
                  for each in poses]
        window = self._region.window(camera, self._model.radius)
        with self._renderer.contour_score(self._scene(volume, window, _FINEST), edges,
                                          profile) as exact:
            points = [exact.points(each) for each in poses]
        return [Look(pose, seen, depth, LocalModel.of(pose, self._model.axis, seen, edges, profile,
                                                      CONTOUR_ERROR),
                     share_in_view(self._model, pose, camera))
                for pose, seen, depth in zip(poses, points, depths, strict=True)]

    def refine(self, volume: Volume, pose: NDArray[np.float64], rng: np.random.Generator,
               shown: Shown) -> PoseEstimate:
        """The object's pose near one (4, 4), where a part of its contour does not count.

        shown: (m,) how much each point of a contour counts, 0 to 1. What does not is out of view.
        The rest as in `localize`.
        """
        self._renderer.use()
        edges, profile = self._edges(volume)
        window = self._region.window(volume.pinhole, self._model.radius)
        with self._renderer.contour_score(self._scene(volume, window), edges, profile) as exact:
            def contour(each: NDArray[np.float64]) -> ContourPoints:
                points = exact.points(each)
                return weighted(points, shown(points))

            search = self._posterior(exact, edges, profile, contour)
            mode = search.refined(pose)
            points = exact.points(mode.pose)
            rest = SlidingContour.of(mode.pose, weighted(points, 1 - shown(points)), edges,
                                     profile)

            def partly(poses: NDArray[np.float64]) -> NDArray[np.float64]:
                # What does not count slides along, to first order, and is taken off again.
                off = tangent(poses, mode.pose, self._model.axis)
                return search.exact(poses) - rest.evidence(off)

            posterior = replace(search, exact=partly).sampled([mode], rng, lambda _: True)
            estimate = self._estimator.of_posterior(
                volume, posterior, search.about, contour, profile.least, rng,
                lambda each: float(contour(each).lengths.sum()
                                   / max(exact.points(each).lengths.sum(), 1e-9)))
            return replace(estimate, evaluations=exact.evaluations)

    def _by_likelihood(self, volume: Volume, rng: np.random.Generator,
                       progress: Progress, watch: Watch | None) -> PoseEstimate:
        window = self._region.window(volume.pinhole, self._model.radius)
        with self._renderer.likelihood_score(self._scene(volume, window), volume) as score:
            poses, scores = faithful_filter(self._in_region(score, 0.0), self._region,
                                            self._settings, rng, progress,
                                            recorder(watch, 'filter'))
            estimate = self._estimator.of_particles(volume, poses, Weights.of(scores), score)
            return replace(estimate, evaluations=score.evaluations)

    def _posterior(self, score: Score, edges: EdgeVolume, profile: ContourProfile,
                   contour: Contour, free: Free | None = None,
                   creases: Callable[[NDArray[np.float64]], CreasePoints | None] = lambda _: None
                   ) -> ContourPosterior:
        """contour, creases: what counts of a pose's."""
        def about(pose: NDArray[np.float64], sure: bool) -> LocalModel:
            return LocalModel.of(pose, self._model.axis, contour(pose), edges, profile,
                                 CONTOUR_ERROR if sure else None, creases(pose))

        def near(pose: NDArray[np.float64]) -> SlidingContour:
            return SlidingContour.of(pose, contour(pose), edges, profile, creases(pose))

        return ContourPosterior(self._model, self._settings,
                                self._in_region(score, -np.inf, free), about, near,
                                lambda poses: self._possible(poses, free))

    def _possible(self, poses: NDArray[np.float64], free: Free | None) -> NDArray[np.bool_]:
        inside = self._region.contains(poses[:, :3, 3])
        return inside if free is None else inside & free(poses)

    def _in_region(self, score: Score, outside: float, free: Free | None = None) -> Score:
        """The score of poses whose origin lies in the region of interest: the prior is uniform."""
        def inside(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            known = self._possible(poses, free)
            values = np.full(len(poses), outside)
            values[known] = score(poses[known])  # the rest need not be drawn
            return values
        return inside

    def _scene(self, volume: Volume, window: Window, detail: float = 0.0) -> Scene:
        """detail: what may be left out of the mesh at the image's own resolution [image px]."""
        near, far = self._region.grown(self._model.radius)
        model, camera = self._model, volume.pinhole
        detail = _DETAIL if window.scale > 1 else detail
        if detail > 0:
            model = simplified(model, detail * near / max(camera.fx, camera.fy))
        return Scene(model, camera, window, near, far)

    def _check_range(self, volume: Volume) -> None:
        far, near = volume.depths[0], volume.depths[-1]
        if far <= self._region.near or near >= self._region.far:
            raise LocalizationError(
                f'the volume spans {near:.3f} to {far:.3f} m, the region of interest '
                f'{self._region.near:.3f} to {self._region.far:.3f} m; set near and far of the '
                'volume around the region')
