"""What the views may be otherwise, where an object is lost in them.

Something hides it in some of them, or the cameras' poses are not what they were told to be.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.lightfield.camera_adjustment import adjust_cameras
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_view.joint_contours import ViewFit

_LOG = logging.getLogger(__name__)
_ADVICE = ('check the hand-eye transform, or state the errors of the poses: sigma_mm and '
           'sigma_deg of views.yaml, or --sigma-mm and --sigma-deg')
_OFF = 0.001, 0.0035  # m, rad: of cameras that are taken to be off, those of a good arm


@dataclass(frozen=True)
class Found:
    """What a search found.

    estimate: in the reference frame. fits: of the views, to its pose. modes: (n, 4, 4) in the
    reference frame. shown: views that show a lost object (`shown_in`).
    """

    estimate: PoseEstimate
    fits: Sequence[ViewFit]
    modes: NDArray[np.float64]
    shown: tuple[int, ...]


_Search = Callable[[ViewsEvidence], Found]


def second_hypothesis(evidence: ViewsEvidence, lost: Found, search: _Search
                      ) -> tuple[Found, ViewsEvidence]:
    """What a search finds in place of a lost object, and in which views. The log tells why."""
    for hypothesis in (_hidden_in_some, _cameras_off):
        second = hypothesis(evidence, lost, search)
        if second is not None:
            return second
    return lost, evidence


def shown_in(fits: Sequence[Sequence[ViewFit]]) -> tuple[int, ...]:
    """Numbers of the views that show an object, where half or more do but not all; else none.

    fits: of all views, to each mode. A view whose contour is more likely absent than present does
    not show it: something is before it, or it is elsewhere. The mode is the one with the most
    evidence in views that do.
    """
    best = max(fits, key=lambda views: sum(max(each.total, 0) for each in views))
    shown = tuple(each.number for each in best if each.total > 0)
    return shown if len(best) > len(shown) >= len(best) / 2 else ()


def _hidden_in_some(evidence: ViewsEvidence, lost: Found, search: _Search
                    ) -> tuple[Found, ViewsEvidence] | None:
    """Found without the views that do not show it, if most do.

    Half of them suffice where the others show it nowhere.
    """
    if not lost.shown:
        return None
    hidden = tuple(sorted({each.number for each in lost.fits} - set(lost.shown)))
    rest = evidence.without(hidden)
    found = search(rest)
    if found.estimate.lost:
        return None
    half = len(lost.shown) == len(hidden)
    if half and not search(evidence.without(lost.shown)).estimate.lost:
        return None
    _LOG.warning('found without views %s, which do not show it there: is something before the '
                 "object, has it moved, or is the camera's pose wrong?",
                 ', '.join(map(str, hidden)))
    return replace(found, estimate=replace(found.estimate, hidden=hidden)), rest


def _cameras_off(evidence: ViewsEvidence, lost: Found, search: _Search
                 ) -> tuple[Found, ViewsEvidence] | None:
    """Found with camera poses that fit the surroundings, if those told do not."""
    if not evidence.are_exact or len(evidence.views) < 2:
        return None
    pictures = evidence.pictures
    adjusted = None if pictures is None else adjust_cameras(pictures.views)
    if adjusted is None:
        _tell_if_off(evidence, lost, search)
        return None
    if not adjusted.is_needed:
        return None
    fitting = replace(evidence, errors=adjusted.root, views=tuple(
        replace(each, camera_to_reference=camera)
        for each, camera in zip(evidence.views, adjusted.cameras, strict=True)))
    found = search(fitting)
    if found.estimate.lost:  # nothing says that these poses are better: patterns can repeat
        return None
    position, rotation = adjusted.off
    _LOG.warning(
        'found with camera poses that fit the surroundings, up to %.1f mm and %.1f degrees off '
        'those told: matches in the pictures are %.1f px apart with the told ones, %.1f px with '
        f'these; {_ADVICE}', 1e3 * position, np.rad2deg(rotation), adjusted.before,
        adjusted.after)
    return found, fitting


def _tell_if_off(evidence: ViewsEvidence, lost: Found, search: _Search) -> None:
    """Say whether cameras that are a little off would find a contour of which parts are missing.

    The object stays lost: such cameras fit what is not the object more easily, too.
    """
    if not lost.estimate.incomplete:
        return
    loose = replace(evidence, views=tuple(
        replace(each, sigma=_OFF, group='all', common=0.5) for each in evidence.views))
    if not search(loose).estimate.lost:
        _LOG.warning('lost with camera poses that are exact, found if they are off by %.1f mm and '
                     f'%.1f degrees: {_ADVICE}', 1e3 * _OFF[0], np.rad2deg(_OFF[1]))
