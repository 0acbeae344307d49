"""Whether a posterior is as sure as it should be: how often the truth is in its regions."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evaluation.errors import pose_error
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.motion import perturb
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.simulation.edge_scenes import random_edge_scene

_NEAR = np.array([0.001, 0.001, 0.005]), 0.04  # m, rad: of starts beside the truth
_STARTS = 6


@dataclass(frozen=True)
class CoverageTrial:
    """One random volume. level: of the smallest credible region that holds the truth, 0 to 1.

    translation: error [m]. rotation: of the axis [rad].
    """

    seed: int
    level: float
    translation: float
    rotation: float
    lost: bool


def run_coverage(count: int, seed: int = 0, whole: bool = True) -> Iterator[CoverageTrial]:
    """Localise in `count` random edge volumes; each is made from its own seed.

    whole: look in the whole region. Else start beside the truth: quicker, and of the posterior
    alone.
    """
    for number in range(seed, seed + count):
        rng = np.random.default_rng([11, number])
        scene = random_edge_scene(rng, _drawn, ModelError.learned())
        settings = PmclSettings(roi_center=scene.roi_center, roi_size=scene.roi_size,
                                renderer='numba', particles=192 if whole else 96)
        start = perturb(np.tile(scene.pose, (_STARTS, 1, 1)), *_NEAR, rng)
        with Localizer(scene.model, settings) as localizer:
            estimate = localizer.localize(scene.edges, rng, start=None if whole else start)
        symmetry = scene.model.symmetry
        error = pose_error(estimate.pose, scene.pose, symmetry)
        level = symmetry.credible_level(scene.pose, estimate.pose, estimate.covariance)
        yield CoverageTrial(number, level, error.translation, error.rotation, estimate.lost)


def _drawn(model: ObjectModel, pose: NDArray[np.float64], camera: Pinhole
           ) -> NDArray[np.float32]:
    window = Window(0, 0, (camera.width, camera.height))
    near, far = pose[2, 3] - 1.1 * model.radius, pose[2, 3] + 1.1 * model.radius
    return NumbaRenderer().depths(Scene(model, camera, window, near, far), pose[None])[0]
