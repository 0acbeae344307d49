"""DepthLikelihoodVolume -> PoseEstimate: the paper's particle filter, literally (section V).

It is the baseline that every improvement is measured against: the mode faithful.
"""

from dataclasses import replace

import moderngl
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.pmcl.contour_evidence import scene, where
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.estimator import Estimator
from pmcl_ros.pmcl.history import Record, Watch, recorder
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.particles import Weights, perturb, uniform_poses
from pmcl_ros.pmcl.posterior import Score
from pmcl_ros.pmcl.prior.orientation import Orientation
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.back_end import make_renderer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.progress import Progress


class ParticleFilterLocalizer(Closing):
    """Finds one object by the mean likelihood of its rendered pixels: the mode faithful.

    With the renderer gl it owns a headless GL context: make, use, close it in one thread.
    Raises RenderError when there is no GL, LocalizationError when the region is impossible.
    """

    def __init__(self, model: ObjectModel, settings: PmclSettings) -> None:
        self._model, self._settings = model, settings
        self._region = Region(settings.roi_center, settings.roi_size)
        self._orientation = Orientation.from_settings(settings, model)
        self._estimator = Estimator(model, self._region, settings, self._orientation)
        self._renderer = make_renderer(settings.renderer, likelihoods=True)
        self.renderer = self._renderer.name

    def close(self) -> None:
        """Release the GL context, if there is one."""
        self._renderer.close()

    def localize(self, volume: DepthLikelihoodVolume, rng: np.random.Generator,
                 progress: Progress | None = None, watch: Watch | None = None) -> PoseEstimate:
        """The object's pose in one volume.

        progress: called with 0..1; returning False ends the search with what was found so far.
        watch: called with the particles of every iteration; the pose is the same with it.
        Raises as `Localizer.localize` does.
        """
        self._renderer.use()
        self._region.check_depths(volume.depths)
        window = self._region.window(volume.pinhole, self._model.radius)
        drawn = scene(self._model, self._region, volume.pinhole, window)
        try:
            with self._renderer.likelihood_score(drawn, volume) as score:
                poses, scores = particle_filter(
                    where(self._feasible, score, 0.0), self._region, self._settings, rng,
                    progress or (lambda _: True), recorder(watch, 'filter'), self._orientation)
                estimate = self._estimator.from_particles(
                    volume, poses, Weights.from_values(scores), score)
                return replace(estimate, evaluations=score.evaluations)
        except moderngl.Error as error:
            raise RenderError(f'{self.renderer} refused its work: {error}') from error

    def _feasible(self, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        inside = self._region.contains(poses[:, :3, 3])
        if self._orientation is not None:
            inside &= self._orientation.allows(poses[:, :3, :3])
        return inside


def particle_filter(score: Score, region: Region, settings: PmclSettings,
                    rng: np.random.Generator, progress: Progress, record: Record | None = None,
                    orientation: Orientation | None = None
                    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses (n, 4, 4) and their scores (n,) when the mean weight passed the threshold.

    Or when the iterations ended. Paper, section V: uniform start in the region over SO(3); the
    weight of a particle is its mean likelihood; importance resampling; zero-mean Gaussian
    perturbation in six degrees of freedom; repeated until the mean weight is above a threshold.
    record: called with the particles of each iteration. orientation: in place of SO(3), if given.
    """
    poses = uniform_poses(region, settings.faithful_particles, rng, orientation)
    scores = score(poses)
    for iteration in range(settings.faithful_iterations):
        if record is not None:
            record(poses, scores)
        if scores.mean() > settings.faithful_threshold:
            break
        if not progress(iteration / settings.faithful_iterations):
            break
        poses = poses[Weights.from_values(scores).resample(len(poses), rng)]
        poses = perturb(poses, settings.faithful_sigma_translation,
                        settings.faithful_sigma_rotation, rng)
        scores = score(poses)
    return poses, scores
