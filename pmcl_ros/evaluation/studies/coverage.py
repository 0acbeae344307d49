"""Measures how often credible regions hold the truth, on random evidence."""

from collections.abc import Iterator

import numpy as np

from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.particles import perturb
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.simulation.edge_scenes import random_edge_scene

_NEAR = np.array([0.001, 0.001, 0.005]), 0.04  # m, rad: of starts beside the truth
_STARTS = 6  # of the search, in each scene


def run_coverage(count: int, seed: int = 0, whole: bool = True) -> Iterator[Trial]:
    """Localise in `count` random edge volumes; each is made from its own seed.

    whole: search the whole region. Otherwise start beside the truth, which is faster and measures
    the posterior alone.
    """
    for number in range(seed, seed + count):
        rng = np.random.default_rng([11, number])
        scene = random_edge_scene(rng, ModelError.learned())
        settings = PmclSettings(roi_center=scene.roi_center, roi_size=scene.roi_size,
                                renderer='numba', particles=192 if whole else 96)
        start = perturb(np.tile(scene.pose, (_STARTS, 1, 1)), *_NEAR, rng)
        with Localizer(scene.model, settings) as localizer:
            estimate = localizer.localize(scene.edges, rng, start=None if whole else start)
        yield Trial.judge(estimate, scene.pose, scene.model, capture=f'random edges {number}',
                          mode='whole region' if whole else 'near start', seed=number)
