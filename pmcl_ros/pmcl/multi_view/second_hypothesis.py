"""What the views may be otherwise, where an object is lost in them.

Something hides it in some of them, or the cameras' poses are not what was reported.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pmcl_ros.evidence.posed_evidence import AssumedCameras, ViewsEvidence
from pmcl_ros.lightfield.camera_adjustment import PairFit, adjust_cameras, pair_fits
from pmcl_ros.lightfield.features import MATCHED, Features, features_of
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_view.camera_errors import CLEARLY_LARGER, CameraErrors, CameraScale
from pmcl_ros.pmcl.multi_view.found import Found
from pmcl_ros.pmcl.multi_view.joint_contours import ViewFit
from pmcl_ros.pmcl.multi_view.view_warnings import SCALE_ADVICE
from pmcl_ros.pmcl.prior.odd_poses import without_mistakes

_LOG = logging.getLogger(__name__)
_ADVICE = ('check the hand-eye transform (of a board: that its sheet keeps its shape) '
           'and the calibration of the camera, or state the errors of the poses: sigma_mm and '
           'sigma_deg of views.yaml, or --sigma-mm and --sigma-deg')
_OF_OBJECT = 'check the size of the mesh, whether it has holes, and whether the object moved'
_OFF = 0.001, 0.0035  # m, rad: of cameras that are taken to be off, those of a good arm
_SCALE = 0.01  # share by which their distances, or the mesh, are then taken to be off
_MOST_OFF = 3.0  # times as much: of an arm that is not good; by more, something else is wrong
_DOUBTFUL = 0.5  # share of what is possible of bad arms, by which a lost object's are in doubt
_FOCAL = 600.0  # px: of pictures of 640x480, in which a good arm's errors are about a pixel
_EXCHANGED = 'are cx and cy of the camera exchanged? The other way round'
_SAME = 1e-9  # m: poses that are equal
_Search = Callable[[ViewsEvidence], Found]


def second_hypothesis(evidence: ViewsEvidence, lost: Found, search: _Search
                      ) -> tuple[Found, ViewsEvidence]:
    """What a search finds in place of a lost object, and in which views.

    Of one that stays lost the log tells why, of another one `Found.how`. The cameras of views that
    show the object, where others do not, are checked too.
    """
    found, rest = _hidden_in_some(evidence, lost, search) or (lost, evidence)
    hidden = found.estimate.hidden
    if (by_others := _cameras_off(rest, found, search)) is not None:
        how = found.how
        found, rest = by_others
        found = replace(found, how=how + found.how)
    scale = found.estimate.camera_scale
    if found.estimate.lost and scale is not None and scale.is_clear:
        _ask_scale(rest, found.estimate, scale, search)
    if found.estimate.lost and _is_one_camera(evidence):
        _LOG.warning('lost, and all %d views have the same camera pose: give each picture its own',
                     len(evidence.views))
    kept = _kept(evidence, hidden)
    return replace(found, estimate=replace(found.estimate, hidden=hidden), fits=[
        replace(each, number=kept[each.number]) for each in found.fits]), rest


def _is_one_camera(evidence: ViewsEvidence) -> bool:
    """Whether several views have one and the same camera pose."""
    return len(evidence.views) > 1 and float(np.ptp(evidence.poses, axis=0).max()) < _SAME


def _kept(evidence: ViewsEvidence, hidden: Sequence[int]) -> list[int]:
    """The numbers of views that `without` keeps."""
    return [number for number in range(len(evidence.views)) if number not in hidden]


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

    Half of them suffice where the others show it nowhere. So do fewer that show it clearly.
    """
    if not lost.shown:
        return None
    hidden = tuple(sorted({each.number for each in lost.fits} - set(lost.shown)))
    rest = evidence.without(hidden)
    found = search(rest)
    if found.estimate.lost:
        return None
    kept = _kept(evidence, hidden)
    clear = [kept[each.number] for each in found.fits
             if each.evidence >= found.estimate.least_evidence]
    if 2 * len(clear) <= len(lost.fits) and not search(evidence.without(clear)).estimate.lost:
        _LOG.warning('the object is at one place in views %s, at another in the rest: is each '
                     'picture with its own camera pose, or has the object moved?',
                     ', '.join(map(str, clear)))
        return None
    line = (f'found without views {", ".join(map(str, hidden))}, which do not show it there: is '
            'something before the object, has it moved, is the picture blurred or dark, or is the '
            "camera's pose wrong, or of another time?")
    return replace(found, estimate=replace(found.estimate, hidden=hidden), how=(line,)), rest


def _cameras_off(evidence: ViewsEvidence, lost: Found, search: _Search
                 ) -> tuple[Found, ViewsEvidence] | None:
    """Found with other camera poses, if those reported count as exact: seldom are they.

    The log tells of an object that stays lost where the surroundings disprove its camera poses.
    """
    exact, pictures = evidence.are_exact and len(evidence.views) > 1, evidence.pictures
    misfit = None
    if pictures is not None and (exact or lost.estimate.lost):
        features = [features_of(each) for each in pictures.views]
        found = _adjusted(evidence, pictures, features, search) if exact else None
        if found is not None:
            return found
        if lost.estimate.lost:
            misfit = _misfit(evidence, pictures, features)
        if misfit and misfit.disproves:
            _LOG.warning(misfit.line)
            return None
    found = _uncertain(evidence, lost, search) if exact else None
    if found is None and misfit and misfit.pair.excess > _DOUBTFUL:
        _LOG.warning(misfit.line)
    return found


def _adjusted(evidence: ViewsEvidence, pictures: PosedViews, features: Sequence[Features],
              search: _Search) -> tuple[Found, ViewsEvidence] | None:
    """Found with camera poses that fit the surroundings, if those reported do not."""
    adjusted = adjust_cameras(pictures.views, features)
    if adjusted is None or not adjusted.is_needed:
        return None
    cameras = AssumedCameras(adjusted.cameras, adjusted.root)
    fitting = evidence.with_cameras(cameras)
    found = search(fitting)
    if found.estimate.lost:  # nothing says that these poses are better: patterns can repeat
        return None
    position, rotation = adjusted.off
    return _with_cameras(
        found, cameras, f'found with camera poses that fit the surroundings, up to '
        f'{1e3 * position:.1f} mm and {np.rad2deg(rotation):.1f} degrees off those reported: '
        f'matches in the pictures are {adjusted.before:.1f} px apart with these, '
        f'{adjusted.after:.1f} px with the others; {_ADVICE}'), fitting


class _Misfit(NamedTuple):
    """How far the surroundings do not fit the camera poses of a lost object.

    pair: the worst of pictures. question: of a mistake that explains it; '' for none.
    """

    pair: PairFit
    question: str

    @property
    def disproves(self) -> bool:
        """Whether no arm and no calibration are so bad."""
        return bool(self.question) or self.pair.excess > 1

    @property
    def line(self) -> str:
        """For the log."""
        question = self.question or (
            'is each picture with its own pose, are these of the optical frame (hand-eye '
            'transform), and is the camera matrix right?')
        return ('lost, and what is around the object does not fit the camera poses: matches of '
                f'pictures {self.pair.views[0]} and {self.pair.views[1]} are '
                f'{self.pair.distances[0]:.1f} px off their epipolar lines; {question}')


def _misfit(evidence: ViewsEvidence, pictures: PosedViews, features: Sequence[Features]
            ) -> _Misfit | None:
    """Of a lost object; None where too few features match, which the log tells."""
    mended = list(without_mistakes(evidence.cameras))
    pairs = pair_fits(pictures.views, features, [
        evidence.poses,
        *(np.array([pose for _, pose in each]) for _, each in mended)])
    if not pairs:
        _LOG.info('lost, and too few features match between pictures to check the camera poses')
        return None
    exchanged = pair_fits(pictures.views, [
        _exchanged(*each) for each in zip(pictures.views, features, strict=True)],
        [evidence.poses])
    given, *others = _medians(pairs)
    tried = [*zip(others, (question for question, _ in mended), strict=True),
             *((each, _EXCHANGED) for each in _medians(exchanged))]
    least, question = min(tried)
    explains = least <= min(MATCHED, given / 2)
    return _Misfit(max(pairs, key=lambda pair: pair.excess),
                   f'{question} {least:.1f} px' if explains and given > MATCHED else '')


def _medians(pairs: Sequence[PairFit]) -> list[float]:
    """The distance by each of the cameras [px]; none of no pairs."""
    return [float(np.median(each)) for each in zip(*(each.distances for each in pairs),
                                                   strict=True)]


def _exchanged(view: PosedView, features: Features) -> Features:
    """Features of a view as of a camera whose cx and cy are exchanged."""
    off = view.pinhole.cx - view.pinhole.cy
    shift = np.array([off / view.pinhole.fx, -off / view.pinhole.fy, 0])
    return features._replace(rays=features.rays + shift)


def _uncertain(evidence: ViewsEvidence, lost: Found, search: _Search
               ) -> tuple[Found, ViewsEvidence] | None:
    """Found with camera poses that are a little off, where parts of a contour are missing.

    A mesh that is off by as much looks the same.
    """
    if not lost.estimate.incomplete or _is_one_camera(evidence):
        return None
    poses = evidence.poses
    errors = CameraErrors.from_views([replace(each, sigma=_OFF, group='all', common=0.5)
                                      for each in evidence.views])
    # By this scale, about the object, rays alone place it, not its size in the pictures.
    errors = errors.with_scale(poses, lost.estimate.pose[:3, 3], _SCALE)
    cameras = AssumedCameras(poses, errors.root)
    loose = evidence.with_cameras(cameras)
    found = search(loose)
    if found.estimate.lost:
        return None
    larger = found.understated if found.understated > CLEARLY_LARGER else 1.0
    position, rotation, scale = min(larger, _MOST_OFF) * np.array([*_OFF, _SCALE])
    away = np.median([np.linalg.norm(each.camera_to_reference[:3, 3] - found.estimate.pose[:3, 3])
                      for each in evidence.views])
    off = (f'{1e3 * position:.1f} mm, {np.rad2deg(rotation):.1f} degrees and {100 * scale:.1f} % '
           f'of their distances, or the mesh by {1e3 * np.hypot(position, rotation * away):.1f} '
           f'mm and {100 * scale:.1f} %')
    if larger > _MOST_OFF:
        finer = round(max(each.evidence.pinhole.fx for each in evidence.views) / _FOCAL)
        smaller = (f'; or make pixels {finer} times as large (--shrink {finer})' if finer > 1
                   else '')
        _LOG.warning('lost with camera poses that are exact, found if they are off by more than '
                     '%s: %s; %s%s', off, _ADVICE, _OF_OBJECT, smaller)
        return None
    return _with_cameras(found, cameras, f'found with camera poses that may be off by {off}; lost '
                         f'with exact ones: {_ADVICE}; {_OF_OBJECT}'), loose


def _ask_scale(evidence: ViewsEvidence, lost: PoseEstimate, scale: CameraScale, search: _Search
               ) -> None:
    """Warn where it would be found with cameras at other distances from it, which stays lost."""
    place = lost.pose[:3, 3]
    moved = [each.camera_to_reference.copy() for each in evidence.views]
    for each in moved:
        each[:3, 3] += scale.error * (each[:3, 3] - place)
    if not search(evidence.with_cameras(AssumedCameras(np.array(moved)))).estimate.lost:
        _LOG.warning('lost, and found with %s: %s', scale.describe(), SCALE_ADVICE)


def _with_cameras(found: Found, cameras: AssumedCameras, how: str) -> Found:
    """Found with cameras of which `how` tells; no errors of theirs are stated."""
    return replace(found, estimate=replace(found.estimate, cameras=cameras), understated=1.0,
                   how=(how,))
