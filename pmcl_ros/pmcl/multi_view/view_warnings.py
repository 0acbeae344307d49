"""What the log says of posed views that do not see the region of interest, or do not agree."""

import logging
from collections.abc import Sequence

import numpy as np

from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.pmcl.multi_view.camera_errors import CLEARLY_LARGER
from pmcl_ros.pmcl.multi_view.joint_contours import ViewFit
from pmcl_ros.pmcl.prior.odd_poses import likely_mistake, sees

_LOG = logging.getLogger(__name__)
_CLEARLY = 4.0  # standard deviations by which a view is off that does not agree


def warn_of_unused(evidence: ViewsEvidence, center: tuple[float, float, float], used: int,
                   is_lost: bool) -> None:
    """Warn where so few views see the region that it is a mistake; of a lost object, not all.

    center: (3,) of the region, in the reference frame [m]. used: number of views that see any of
    the region. Where the object is lost, its middle counts.
    """
    cameras = [(each.evidence.pinhole, each.camera_to_reference) for each in evidence.views]
    given, what = len(cameras), 'the region of interest'
    if is_lost and used == given:
        what = f'the middle of {what}'
        used = sum(sees(*each, center) for each in cameras)
    if used < (given if is_lost else given / 2):
        _LOG.warning('%d of %d views see %s: %s (pmcl --verbose tells why of each)', used, given,
                     what, likely_mistake(cameras, center))


def warn_of_disagreement(fits: Sequence[ViewFit], least: float) -> None:
    """Warn of the view that agrees least, if it is clearly off and most views show the object.

    least: mean evidence of a view that shows it [nat / px].
    """
    seen = [each for each in fits if each.allowed > 0]  # others show no contour
    if not seen:
        return
    worst = max(seen, key=lambda fit: fit.apart / fit.allowed)
    there = np.median([each.evidence for each in seen]) >= least
    if there and worst.apart > _CLEARLY * worst.allowed:
        _LOG.warning('views disagree: view %d by %.1f px, where %.1f is expected; check the '
                     'hand-eye transform, the clock, and whether the object moved', worst.number,
                     worst.apart, worst.allowed)


def warn_of_errors(understated: float) -> None:
    """Warn where stated errors of the cameras' poses are clearly too small, by a factor."""
    if understated > CLEARLY_LARGER:
        _LOG.warning('the views agree on a pose if the errors of the camera poses are %.1f times '
                     'those stated, and the covariance allows for that: check the hand-eye '
                     'transform and the size of the mesh, or state larger errors', understated)
