"""JointEvidence -> poses where a search in several views begins: proposals of some of them."""

import logging

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.proposals.template_matching import Proposals
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.sunken import with_sunken
from pmcl_ros.runtime.errors import LocalizationError

_LOG = logging.getLogger(__name__)
_PROPOSING = 2  # views whose proposals are refined: as far apart as possible


class JointProposals:
    """Proposes poses of an object in views. It keeps its templates."""

    def __init__(self, model: ObjectModel, renderer: NumbaRenderer, count: int) -> None:
        self._model, self._renderer, self._count = model, renderer, count
        self._proposals: Proposals | None = None

    def propose(self, joint: JointEvidence) -> NDArray[np.float64]:
        """(k, 4, 4) proposals of some views, in the frame of the first.

        Raises LocalizationError where the object is out of view in all.
        """
        found: list[NDArray[np.float64]] = []
        first = joint.spread(_PROPOSING)
        for number in first + [each for each in range(len(joint.views)) if each not in first]:
            view = joint.views[number]
            if self._proposals is None:
                self._proposals = Proposals(self._renderer, self._model, view.region)
            try:
                poses, _ = self._proposals.within(view.region).propose(
                    view.volume, self._count, view.orientation)
            except LocalizationError as error:
                _LOG.info('view %d proposes nothing: %s', joint.numbers[number], error)
                continue
            found.append(joint.cameras[number] @ with_sunken(poses, self._model, view.interface))
            if len(found) == _PROPOSING:
                break
        if not found:
            raise LocalizationError('the object is out of view in all views, wherever in the '
                                    'region of interest it is; are poses and region right?')
        poses = np.concatenate(found)
        inside = poses[joint.feasible(poses)]
        return inside if len(inside) else poses
