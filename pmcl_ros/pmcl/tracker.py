"""DepthLikelihoodVolume after DepthLikelihoodVolume -> PoseEstimate after PoseEstimate."""

import logging
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.errors import LocalizationError
from pmcl_ros.pmcl.action import ActionModel, State
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.localizer import FOLLOWED, Localizer, Progress
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.sampler import Gaussian
from pmcl_ros.pmcl.summary import covariance, credible_level, mean_pose, same_mode
from pmcl_ros.pmcl.tracking_settings import TrackingSettings
from pmcl_ros.pmcl.usual_look import UsualLook
from pmcl_ros.pmcl.weights import Weights

_LOG = logging.getLogger(__name__)
PREDICTED = 'predicted'  # an estimate's mode, beside those of `Localizer`
_MODE_DISTANCE, _MODE_ANGLE = 0.02, 0.25  # m, rad: particles farther away are of another mode
# nat: so much less likely beforehand is any one pose in a region than one where the object is
# expected (20 cm and all orientations against a step of 1 cm and 0.06 rad).
_BEFOREHAND = 15.0
# nat / px: standard deviations at least of how well the object is usually seen, to believe that it
# is hidden, and merely to doubt that it is what was followed.
_HIDDEN, _DOUBTED = 0.5, 0.2
_PAUSE = 3  # captures between two searches of the whole region for mere doubt
_LICENCE = 30  # captures after such a search in which an incomplete contour is believed
_FORESEEN = 0.99  # of the prediction: what is outside is somewhere else


class Tracker:
    """Follows one object from capture to capture.

    Each capture is searched around where the last posterior, moved by the action model, expects
    it; the new posterior is that prior times the evidence. Where that finds nothing the whole
    region is searched, as a capture by itself is. So a capture takes no longer than both. Where
    that finds nothing either the object is lost: then the prediction goes on, ever wider, until it
    says less than the region does, and the whole region is searched first. So it is now and then
    while the object is followed, too: ever more rarely, as something that looks like it may have
    been taken for it when it was found, and when it has less evidence than it usually has.

    localizer: of the same model and settings; whoever made it closes it.
    """

    def __init__(self, localizer: Localizer, model: ObjectModel, settings: TrackingSettings
                 ) -> None:
        self._localizer, self._axis, self._settings = localizer, model.axis, settings
        self._symmetry = model.symmetry
        self._action = None if settings.tracking == 'none' else ActionModel(
            settings.tracking, settings.track_sigma_translation, settings.track_sigma_rotation,
            settings.track_period)
        self._region = Region(settings.roi_center, settings.roi_size)
        self._state: State | None = None  # after the last capture
        self._seen = False  # in the last capture
        self._followed = 0  # captures since the whole region was last searched
        self._confirmed = 0  # how often that was in vain since the object was found
        self._usual = UsualLook()

    def reset(self) -> None:
        """Forget the track: the next capture is searched as the first."""
        self._state, self._seen, self._confirmed = None, False, 0
        self._usual.forget()

    def track(self, volume: DepthLikelihoodVolume, rng: np.random.Generator,
              progress: Progress | None = None, camera: NDArray[np.float64] | None = None
              ) -> PoseEstimate:
        """The object's pose in the next capture.

        camera: (4, 4), camera to the fixed frame, for the action model 'camera'; without it, or
            with a capture no newer than the last, the track ends, and the region is searched.
        The estimate's mode tells what was done: that of `Localizer.localize`, 'followed', or
        'predicted', where the object is lost and the pose is only where it should be by now.
        Raises what `Localizer.localize` raises; the track goes on with the next capture then.
        """
        if self._action is None:
            return self._localizer.localize(volume, rng, progress)
        expected = self._expected(volume.header.stamp_ns, camera, rng)
        if expected is None:  # what is found begins a track
            self._confirmed = 0
            self._usual.forget()
        estimate = self._looked(volume, expected, rng, progress)
        was_seen, self._seen = self._seen, not estimate.lost
        if not estimate.lost:
            again = not was_seen or estimate.mode != FOLLOWED
            if again and not (self._as_usual(estimate) and self._foreseen(estimate, expected)):
                self._confirmed = 0
            if not estimate.incomplete:  # else less and less would be usual
                self._usual.remember(estimate)
            if not was_seen:
                _LOG.info('found in capture %d', volume.header.stamp_ns)
            self._state = self._updated(estimate, expected if was_seen else None, camera, rng)
            return estimate
        if was_seen:
            _LOG.info('lost in capture %d: the whole region is searched until it is found',
                      volume.header.stamp_ns)
        self._state = expected
        return estimate if expected is None else self._predicted(estimate, expected)

    def _looked(self, volume: DepthLikelihoodVolume, expected: State | None,
                rng: np.random.Generator, progress: Progress | None) -> PoseEstimate:
        """What the likelier way finds, or else the other, if there is one."""
        def search() -> PoseEstimate:
            self._followed = 0
            return self._judged(self._localizer.localize(volume, rng, progress))

        if expected is None:
            return search()
        settings, prior = self._settings, Gaussian.of(*self._about(expected), self._axis)

        def follow() -> PoseEstimate:
            self._followed += 1
            return self._judged(self._localizer.follow(
                volume, prior, rng, settings.track_particles, settings.track_candidates))

        # A prediction of long ago is wide: it holds other things that look like the object.
        first, second = (follow, search) if self._seen else (search, follow)
        estimate = first()
        if estimate.lost:
            return self._confirmed_by(estimate, second(), expected)
        if settings.track_check and (
                self._followed >= settings.track_check * 2 ** min(self._confirmed, 20)
                or (self._followed >= _PAUSE and not self._usual.held(estimate, _DOUBTED)[1])):
            return self._likelier(volume, estimate, search())
        return estimate

    def _likelier(self, volume: DepthLikelihoodVolume, followed: PoseEstimate,
                  found: PoseEstimate) -> PoseEstimate:
        """What was followed, unless the region holds what there is far more evidence of."""
        here, there = self._localizer.evidence(volume, np.stack([followed.pose, found.pose]))
        # Of what is incomplete itself no more is asked.
        good = not found.lost or (followed.incomplete and found.incomplete
                                  and self._as_usual(found))
        if not good or self._same(followed, found) or there < here + _BEFOREHAND:
            self._confirmed += 1
            return followed
        _LOG.warning('capture %d: something else was followed: there is %.0f nat of evidence '
                     'where it is, %.0f where the object is', volume.header.stamp_ns, here, there)
        # How well it is seen is still known.
        self._state, self._seen, self._confirmed = None, False, 0
        return replace(found, lost=False)

    def _confirmed_by(self, one: PoseEstimate, other: PoseEstimate, expected: State
                      ) -> PoseEstimate:
        """The other of what was followed and found in the whole region, or what both agree on.

        Of what is rather there, but less of its contour than of any object, the region is asked:
        if nothing in it is more like the object than what is where it was foreseen, it is that.
        """
        if (one.incomplete and other.incomplete and other.lost and self._as_usual(one)
                and self._same(one, other) and self._foreseen(other, expected)):
            self._confirmed += 1
            return replace(one if one.mode == FOLLOWED else other, lost=False)
        return other

    def _foreseen(self, estimate: PoseEstimate, expected: State | None) -> bool:
        """Whether it is where it was expected."""
        if expected is None:
            return False
        mean, spread = self._about(expected)
        pose = self._symmetry.folded(estimate.pose[None], mean)[0]
        return credible_level(pose, mean, spread, self._axis) <= _FORESEEN

    def _same(self, followed: PoseEstimate, found: PoseEstimate) -> bool:
        """Whether two estimates are of one mode."""
        folded = self._symmetry.folded(found.pose[None], followed.pose)
        return bool(same_mode(folded, followed.pose, self._axis, _MODE_DISTANCE,
                              _MODE_ANGLE).all())

    def _judged(self, estimate: PoseEstimate) -> PoseEstimate:
        return replace(estimate, lost=not self._believed(estimate))

    def _believed(self, estimate: PoseEstimate) -> bool:
        """Whether the object is there, as well supported as it has been.

        `least_support` is for any object. One that was seen well many times, and now hardly is, is
        hidden, and what is found is something else. One whose contour often shows only in part is
        believed by its own past while it is followed, if the region was searched for anything
        likelier not long ago, in vain.
        """
        if estimate.incomplete:
            return (self._seen and estimate.mode == FOLLOWED and self._confirmed > 0
                    and self._followed <= _LICENCE and self._as_usual(estimate))
        return not estimate.lost and bool(self._usual.held(estimate, _HIDDEN).all())

    def _as_usual(self, estimate: PoseEstimate) -> bool:
        """Whether it is known how well the object is seen, and this is no worse."""
        return self._usual.known and bool(self._usual.held(estimate, _DOUBTED).all())

    def _expected(self, stamp_ns: int, camera: NDArray[np.float64] | None,
                  rng: np.random.Generator) -> State | None:
        """What is believed before a capture is looked at; None: no more than the region says."""
        if self._action is None or self._state is None:
            return None
        try:
            expected = self._action.predicted(self._state, stamp_ns, camera, rng)
        except LocalizationError as error:
            _LOG.warning('the track ends: %s', error)
            return None
        mean = expected.poses[:, :3, 3].mean(axis=0)
        spread = expected.poses[:, :3, 3].std(axis=0)
        region, half = self._region, np.array(self._region.size) / 2
        if (spread > half).any() or (np.abs(mean - region.center) > half + 3 * spread).any():
            _LOG.warning('the track ends: by capture %d the object may be anywhere in the region '
                         'of interest, or have left it', stamp_ns)
            return None
        return expected

    def _updated(self, estimate: PoseEstimate, expected: State | None,
                 camera: NDArray[np.float64] | None, rng: np.random.Generator) -> State:
        """The state after a capture in which the object was seen."""
        near = same_mode(estimate.particles, estimate.pose, self._axis, _MODE_DISTANCE,
                         _MODE_ANGLE)
        weights = Weights(np.where(near, estimate.log_weights, -np.inf))
        poses = estimate.particles[weights.resample(self._settings.track_particles, rng)]
        stamp_ns = estimate.header.stamp_ns
        if expected is None or self._state is None:
            return State.at_rest(stamp_ns, poses, camera)
        return replace(expected, camera=camera).seen(poses, self._axis, self._state, rng)

    def _predicted(self, estimate: PoseEstimate, expected: State) -> PoseEstimate:
        """That the object is lost, and where it should be."""
        pose, spread = self._about(expected)
        count = len(expected.poses)
        return replace(estimate, pose=pose, covariance=spread, particles=expected.poses,
                       log_weights=np.full(count, -np.log(count)), mode=PREDICTED,
                       incomplete=False)

    def _about(self, state: State) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean pose (4, 4) and covariance (6, 6) of a state."""
        alike = Weights(np.zeros(len(state.poses)))
        mean = mean_pose(state.poses, alike, self._axis)
        return mean, covariance(state.poses, alike, mean, self._axis)
