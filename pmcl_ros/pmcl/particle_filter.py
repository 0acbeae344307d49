"""The paper's filter, literally: the baseline that every improvement is measured against."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.history import Record
from pmcl_ros.pmcl.motion import perturb, uniform_poses
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.weights import Weights

Score = Callable[[NDArray[np.float64]], NDArray[np.float64]]
Progress = Callable[[float], bool]


def particle_filter(score: Score, region: Region, settings: PmclSettings,
                    rng: np.random.Generator, progress: Progress, record: Record | None = None
                    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses (n, 4, 4) and their scores (n,) when the mean weight passed the threshold.

    Or when the iterations ended. Paper, section V: uniform start in the region over SO(3); the
    weight of a particle is its mean likelihood; importance resampling; zero-mean Gaussian
    perturbation in six degrees of freedom; repeated until the mean weight is above a threshold.
    record: told the particles of each iteration.
    """
    poses = uniform_poses(region, settings.faithful_particles, rng)
    scores = score(poses)
    for iteration in range(settings.faithful_iterations):
        if record is not None:
            record(poses, scores)
        if scores.mean() > settings.faithful_threshold:
            break
        if not progress(iteration / settings.faithful_iterations):
            break
        poses = poses[Weights.of(scores).resample(len(poses), rng)]
        poses = perturb(poses, settings.faithful_sigma_translation,
                        settings.faithful_sigma_rotation, rng)
        scores = score(poses)
    return poses, scores
