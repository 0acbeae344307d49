"""DepthLikelihoodVolume -> PoseEstimate."""

import logging
from collections.abc import Callable

import moderngl
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.edges import edges_from_likelihood
from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.errors import LocalizationError, RenderError
from pmcl_ros.gl import GlContext
from pmcl_ros.pmcl.annealed import CORRELATION, annealed_filter
from pmcl_ros.pmcl.contour_score import ContourScore
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.faithful import faithful_filter
from pmcl_ros.pmcl.likelihood_score import LikelihoodScore
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.proposals import Proposals
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.summary import covariance, mean_pose, same_mode
from pmcl_ros.pmcl.weights import Weights
from pmcl_ros.pmcl.zbuffers import Window, ZBuffers

_LOG = logging.getLogger(__name__)
_MODE_DISTANCE, _MODE_ANGLE = 0.02, 0.25  # m, rad: farther from the best is another mode
_SCALE = 2  # image px per pixel of the contour search's z-buffers
_BLUR = 1.5  # image px: of the edge energy in the coarse half of the search
_BATCH = 96  # poses drawn at once

Progress = Callable[[float], bool]
Score = Callable[[NDArray[np.float64]], NDArray[np.float64]]


class Localizer:
    """Finds one object in volumes. Owns a headless GL context: make, use, close it in one thread.

    Raises RenderError when there is no GL, LocalizationError when the region is impossible.
    """

    def __init__(self, model: ObjectModel, settings: PmclSettings) -> None:
        self._model = model
        self._settings = settings
        self._region = Region(settings.roi_center, settings.roi_size)
        self._context = GlContext()
        self.renderer = self._context.renderer
        try:
            self._proposals = Proposals(self._context, model, self._region)
        except BaseException:
            self._context.close()
            raise

    def __enter__(self) -> 'Localizer':
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the GL context."""
        self._context.close()

    def localize(self, volume: DepthLikelihoodVolume, rng: np.random.Generator,
                 progress: Progress | None = None) -> PoseEstimate:
        """The object's pose in one volume.

        progress: called with 0..1; returning False ends the search with what was found so far.
        Raises LocalizationError when the volume does not reach the region of interest, RenderError
        in another thread, after `close`, or when the GL refuses its work.
        """
        self._context.use()
        self._check_range(volume)
        search = {'default': self._by_contour, 'faithful': self._by_likelihood}
        try:
            return search[self._settings.mode](volume, rng, progress or (lambda _: True))
        except moderngl.Error as error:
            raise RenderError(f'{self.renderer} refused its work: {error}') from error

    def _by_contour(self, volume: DepthLikelihoodVolume, rng: np.random.Generator,
                    progress: Progress) -> PoseEstimate:
        edges = volume.edges
        if edges is None:
            _LOG.info('no edge volume was given: contours are looked for in the likelihood')
            edges = edges_from_likelihood(volume)
        window = self._region.window(volume.pinhole, self._model.radius).coarser(_SCALE)
        start, _ = self._proposals.propose(edges, self._settings.proposals)
        with (self._zbuffers(volume, window) as zbuffers,
              ContourScore(zbuffers, edges, self._model.radius, _BLUR) as coarse,
              ContourScore(zbuffers, edges, self._model.radius) as fine):
            poses, scores = annealed_filter(
                self._in_region(coarse, -np.inf), self._in_region(fine, -np.inf), start,
                self._model.radius, self._settings.particles, self._settings.moves, rng, progress)
            weights = Weights(scores / CORRELATION)
            pose, spread = self._summary(poses, weights)
            evidence, length = fine.batch(pose[None])[0]
        lost = evidence < self._settings.least_evidence * max(length, 1.0)
        return PoseEstimate(volume.header, pose, spread, poses, weights.log_normalised,
                            float(evidence), bool(lost), self._settings.mode)

    def _by_likelihood(self, volume: DepthLikelihoodVolume, rng: np.random.Generator,
                       progress: Progress) -> PoseEstimate:
        window = self._region.window(volume.pinhole, self._model.radius)
        with (self._zbuffers(volume, window) as zbuffers,
              LikelihoodScore(zbuffers, volume) as score):
            poses, scores = faithful_filter(self._in_region(score, 0.0), self._region,
                                            self._settings, rng, progress)
            weights = Weights.of(scores)
            pose, spread = self._summary(poses, weights)
            likelihood = float(score(pose[None])[0])
        # The paper knows no lost object; one that no ray supports at all is.
        return PoseEstimate(volume.header, pose, spread, poses, weights.log_normalised,
                            likelihood, lost=not likelihood > 0, mode=self._settings.mode)

    def _summary(self, poses: NDArray[np.float64], weights: Weights
                 ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean and covariance of the mode about the best particle."""
        axis = self._model.axis
        best = poses[int(weights.log.argmax())]
        mode = same_mode(poses, best, axis, _MODE_DISTANCE, _MODE_ANGLE)
        inside = Weights(weights.log[mode])
        pose = mean_pose(poses[mode], inside, axis)
        return pose, covariance(poses[mode], inside, pose, axis)

    def _in_region(self, score: Score, outside: float) -> Score:
        """The score of poses whose origin lies in the region of interest: the prior is uniform."""
        def inside(poses: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.where(self._region.contains(poses[:, :3, 3]), score(poses), outside)
        return inside

    def _zbuffers(self, volume: DepthLikelihoodVolume, window: Window) -> ZBuffers:
        near, far = self._region.grown(self._model.radius)
        return ZBuffers(self._context, self._model.vertices, self._model.faces, volume.pinhole,
                        window, near, far, closed=self._model.closed, capacity=_BATCH)

    def _check_range(self, volume: DepthLikelihoodVolume) -> None:
        far, near = volume.depths[0], volume.depths[-1]
        if far <= self._region.near or near >= self._region.far:
            raise LocalizationError(
                f'the volume spans {near:.3f} to {far:.3f} m, the region of interest '
                f'{self._region.near:.3f} to {self._region.far:.3f} m; set near and far of the '
                'volume around the region')
