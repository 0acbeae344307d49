"""The posterior shrinking view by view: how sure a pose is by one view, by two, ..."""

import contextlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence
from pmcl_ros.pmcl.multi_view.joint_posterior import JointPosterior, numbers_of
from pmcl_ros.pmcl.multi_view.next_view import position_sigma
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError


def sigmas_by_views(evidence: ViewsEvidence, model: ObjectModel, settings: PmclSettings,
                    pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) largest standard deviation of the position by the first 1, 2, ..., n views [m].

    pose: (4, 4) found in all n. It is that of the mode near this pose, with the same views; other
    modes are not looked for. NaN where none of the first views sees the region of interest.
    """
    found = np.full(len(evidence.views), np.nan)
    for number in range(len(found)):
        first = replace(evidence, views=evidence.views[:number + 1])
        with contextlib.suppress(LocalizationError):
            found[number] = position_sigma(_mode(first, model, settings, pose).spread)
    return found


def _mode(evidence: ViewsEvidence, model: ObjectModel, settings: PmclSettings,
          pose: NDArray[np.float64]) -> LocalModel:
    joint = JointEvidence.from_views(evidence, NumbaRenderer(), model, settings)
    with contextlib.ExitStack() as stack:
        posterior = JointPosterior.opened(joint, settings, numbers_of(joint), stack)
        return posterior.refine(joint.seen(pose)).local
