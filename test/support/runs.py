"""A localisation small enough to be made for a test: of `tiny_capture`."""

import tiny_capture
from pmcl_scenes import cup, model_of

from pmcl_ros.evaluation.report.localization import localize
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.pmcl.settings import PmclSettings

CENTER, SIZE = (0.005, -0.005, 0.4), (0.05, 0.05, 0.06)
QUICK = {'proposals': 12, 'particles': 48, 'moves': 3, 'renderer': 'numba'}
MODEL = model_of(cup(), (0, 0, 1))


def settings(**changes):
    return PmclSettings.make({'roi_center': CENTER, 'roi_size': SIZE, **QUICK, **changes})


def truth_of(seed=0, empty=False):
    return Truth(tiny_capture.pose(seed), CENTER, SIZE, empty)


def field(seed=0, empty=False):
    return tiny_capture.light_field(tiny_capture.pose(seed), cup(), empty)


def run(seed=0, empty=False, source='tiny', truth=True, model=MODEL, **changes):
    return localize(lambda: field(seed, empty), model, settings(**changes), lambda *_: None,
                    source, 'A1', truth_of(seed, empty) if truth else None)
