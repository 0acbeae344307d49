"""What the log says of posed views that do not see the region of interest, or do not agree."""

import logging
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.lightfield.unusable_pictures import unusable_pictures
from pmcl_ros.pmcl.multi_view.camera_errors import CLEARLY_LARGER, CameraScale
from pmcl_ros.pmcl.multi_view.found import Found
from pmcl_ros.pmcl.multi_view.joint_contours import ViewFit
from pmcl_ros.pmcl.multi_view.joint_evidence import silent_views
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.odd_poses import likely_mistake, sees
from pmcl_ros.pmcl.prior.region import windows_before
from pmcl_ros.pmcl.render.scene import Window
from pmcl_ros.pmcl.settings import PmclSettings

_LOG = logging.getLogger(__name__)
_PARALLEL = 0.005  # least mean square sine between axes that meet somewhere: two 8 degrees apart
SCALE_ADVICE = ('check the scale of their poses, the size of the mesh, the focal length, and '
                'whether the object moved')
_CLEARLY = 4.0  # standard deviations by which a view is off that does not agree


def warn_of_views(evidence: ViewsEvidence, seen: int, found: Found, model: ObjectModel,
                  settings: PmclSettings) -> None:
    """Warn of all that looks wrong with the views in which something was found, or is lost.

    seen: number of views of the evidence that see the region of interest.
    """
    for line in found.how:
        _LOG.warning('%s', line)
    lost, pictures = found.estimate.lost, evidence.pictures
    windows: Mapping[int, Window] = {}
    if lost and pictures is not None:
        windows = windows_before(pictures.cameras, settings, model.radius,
                                 pictures.header.frame_id)
    seen = max(seen, len(windows))  # a picture of one colour sees it too
    told = warn_of_unused(evidence, model, settings, seen, lost)
    if lost and not told:
        warn_of_region(evidence, settings.roi_center, settings.roi_size, model.radius)
    if windows and pictures is not None:
        warn_of_pictures(pictures.views, windows, settings.roi_center)
    warn_of_disagreement(found.fits, found.estimate.least_evidence)
    if not lost:
        warn_of_errors(found.understated)
        if found.estimate.camera_scale is not None:
            warn_of_scale(found.estimate.camera_scale)


def warn_of_unused(evidence: ViewsEvidence, model: ObjectModel, settings: PmclSettings, used: int,
                   is_lost: bool) -> bool:
    """Warn where so few views see the region that it is a mistake; of a lost object, not all.

    Returns whether it did; at level info the log tells why of each view that says nothing. used:
    number of views that see any of the region. Where the object is lost, its middle counts.
    """
    for number, reason in silent_views(evidence, model, settings).items():
        _LOG.info('view %d says nothing: %s', number, reason)
    center, cameras = settings.roi_center, evidence.cameras
    given, what = len(cameras), 'the region of interest'
    if is_lost and used == given:
        what = f'the middle of {what}'
        used = sum(sees(*each, center) for each in cameras)
    if used >= (given if is_lost else given / 2):
        return False
    _LOG.warning('%d of %d views see %s: %s (lines of level info tell why of each; of a command: '
                 'pmcl --verbose)', used, given, what, likely_mistake(cameras, center))
    return True


def warn_of_region(evidence: ViewsEvidence, center: tuple[float, float, float],
                   size: tuple[float, float, float], radius: float) -> None:
    """Warn where the cameras of a lost object look at one place outside of the region.

    center, size: of the region [m]. radius: of the object about its origin [m], whose middle is
    about half of that away from it.
    """
    target = _looked_at(evidence.poses)
    if target is None:
        return
    place, apart = target
    outside = np.linalg.norm(np.maximum(np.abs(place - center) - np.array(size) / 2, 0))
    if outside > max(apart, radius / 2):
        _LOG.warning('lost, and the cameras look at (%.3g, %.3g, %.3g) m, which is %.0f mm '
                     'outside of the region of interest: is its centre right?', *place,
                     1e3 * outside)


def _looked_at(cameras: NDArray[np.float64]) -> tuple[NDArray[np.float64], float] | None:
    """The place (3,) nearest to the optical axes of cameras (n, 4, 4), and its distance from them.

    The distance is the rms [m]. None where axes are almost parallel, or meet behind a camera.
    """
    axes, places = cameras[:, :3, 2], cameras[:, :3, 3]
    across = np.eye(3) - axes[:, :, None] * axes[:, None]
    if np.linalg.eigvalsh(across.mean(axis=0))[0] < _PARALLEL:
        return None
    meet = np.linalg.solve(across.sum(axis=0), np.einsum('nij,nj->i', across, places))
    if (((meet - places) * axes).sum(axis=1) <= 0).any():
        return None
    off = np.einsum('nij,nj->ni', across, meet - places)
    return meet, float(np.sqrt(np.square(off).sum(axis=1).mean()))


def warn_of_pictures(views: Sequence[PosedView], windows: Mapping[int, Window],
                     center: tuple[float, float, float]) -> None:
    """Warn of the pictures of a lost object that are clearly unusable.

    windows: that can show it, by the numbers of the views. center: of the region of interest, in
    the reference frame [m].
    """
    parts = {number: (each.left, each.top, *each.size) for number, each in windows.items()}
    for each in unusable_pictures(views, parts, np.array(center)):
        _LOG.warning('lost, and %s', each)


def warn_of_order(order: Sequence[int]) -> None:
    """Warn of a lost object whose views have each other's poses, as of `right_order`."""
    moved = [number for number, other in enumerate(order) if other != number]
    if len(moved) == 2:
        change = f'those of views {moved[0]} and {moved[1]} are exchanged'
    else:
        change = (f'they are shifted by one: view 0 has that of view {order[0]}, view 1 that of '
                  f'view {order[1]}, and so on')
    _LOG.warning('lost: what is around the object fits the camera poses only if %s; is each '
                 'picture with its own pose?', change)


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


def warn_of_scale(scale: CameraScale) -> None:
    """Warn where the cameras fit an object of its size clearly better at other distances."""
    if scale.is_clear:
        _LOG.warning('the views fit best with %s: %s', scale.describe(), SCALE_ADVICE)
    else:
        _LOG.info('the views fit best with %s', scale.describe())


def warn_of_errors(understated: float) -> None:
    """Warn where stated errors of the cameras' poses are clearly too small, by a factor."""
    if understated > CLEARLY_LARGER:
        _LOG.warning('the views agree on a pose if the errors of the camera poses are %.1f times '
                     'those stated, and the covariance allows for that: check the hand-eye '
                     'transform (of a board: that its sheet keeps its shape), the calibration '
                     'of the camera (focal length, distortion) and the size of the mesh, or state '
                     'larger errors',
                     understated)
