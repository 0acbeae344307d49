"""EdgeVolume after EdgeVolume -> PoseEstimate after PoseEstimate."""

import logging
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.localizer import FOLLOWED, Localizer, Progress
from pmcl_ros.pmcl.modes import MODE_EXTENT
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.sampler import Gaussian
from pmcl_ros.pmcl.tracking.action import ActionModel, State
from pmcl_ros.pmcl.tracking.settings import TrackingSettings
from pmcl_ros.pmcl.tracking.track_statistics import TrackStatistics
from pmcl_ros.pmcl.weights import Weights
from pmcl_ros.runtime.errors import LocalizationError

_LOG = logging.getLogger(__name__)
PREDICTED = 'predicted'  # an estimate's mode, beside those of `Localizer`
# nat: so much less likely beforehand is any one pose in a region than one where the object is
# expected (20 cm and all orientations against a step of 1 cm and 0.06 rad).
_BEFOREHAND = 15.0
# nat / px: standard deviations at least of how well the object is usually seen, to doubt that what
# looks like any object is this one, and that it has no less evidence than usual.
_HIDDEN, _DOUBTED = 0.5, 0.2
_PAUSE = 3  # captures between two searches of the whole region for mere doubt
_LICENCE = 30  # captures after such a search in which an incomplete contour is believed
_FORESEEN = 0.99  # of the prediction: what is outside is somewhere else
_IN_VIEW = 0.5  # of the object: with less it is known by single shots alone


class Tracker:
    """Follows one object from capture to capture.

    Each capture is searched around where the last posterior, moved by the action model, expects
    it; the new posterior is that prior times the evidence. Where what that finds is not believed
    by itself the whole region is searched, as a capture by itself is, and the likelier of both is
    believed if it is where it was foreseen and has its usual evidence. So a capture takes no
    longer than both. Else the object is lost: then the prediction goes on, ever wider, until it
    says less than the region does, and the whole region is searched first. So it is now and then
    while the object is followed, too: ever more rarely, as something that looks like it may have
    been taken for it when it was found, and when it has less evidence than it usually has.

    localizer: of the same model and settings; whoever made it closes it.
    """

    def __init__(self, localizer: Localizer, model: ObjectModel, settings: TrackingSettings
                 ) -> None:
        self._localizer, self._settings = localizer, settings
        self._symmetry = model.symmetry
        self._action = None if settings.tracking == 'none' else ActionModel(
            settings.tracking, settings.track_sigma_translation, settings.track_sigma_rotation,
            settings.track_period)
        self._region = Region(settings.roi_center, settings.roi_size)
        self._state: State | None = None  # after the last capture
        self._seen = False  # in the last capture
        self._followed = 0  # captures since the whole region was last searched
        self._confirmed = 0  # how often that was in vain since the object was found
        self._usual = TrackStatistics()

    def reset(self) -> None:
        """Forget the track: the next capture is searched as the first."""
        self._state, self._seen, self._confirmed = None, False, 0
        self._usual.forget()

    def track(self, edges: EdgeVolume, rng: np.random.Generator,
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
            return self._localizer.localize(edges, rng, progress)
        expected = self._expected(edges.header.stamp_ns, camera, rng)
        if expected is None:  # what is found begins a track, but how it looks is known
            self._confirmed = 0
        estimate, there = self._looked(edges, expected, rng, progress)
        was_seen, self._seen = self._seen, there
        if there:
            again = not was_seen or estimate.mode != FOLLOWED
            if again and not (self._as_usual(estimate) and self._foreseen(estimate, expected)):
                self._confirmed = 0
            self._usual.remember(estimate)
            if not was_seen:
                _LOG.info('found in capture %d', edges.header.stamp_ns)
            self._state = self._updated(estimate, expected if was_seen else None, camera, rng)
            return replace(estimate, lost=False)
        if was_seen:
            _LOG.info('lost in capture %d: the whole region is searched until it is found',
                      edges.header.stamp_ns)
        self._usual.fade()
        self._state = expected
        lost = replace(estimate, lost=True)
        return lost if expected is None else self._predicted(lost, expected)

    def _looked(self, edges: EdgeVolume, expected: State | None,
                rng: np.random.Generator, progress: Progress | None
                ) -> tuple[PoseEstimate, bool]:
        """What the likelier way finds, or else the other; whether it is the object."""
        def search() -> PoseEstimate:
            self._followed = 0
            return self._localizer.localize(edges, rng, progress)

        if expected is None:
            return (found := search()), self._believed(found, None)
        settings, prior = self._settings, Gaussian.of(*self._about(expected), self._symmetry)

        def follow() -> PoseEstimate:
            self._followed += 1
            return self._localizer.follow(
                edges, prior, rng, settings.track_particles, settings.track_candidates)

        # A prediction of long ago is wide: it holds other things that look like the object.
        if not self._seen:
            if self._believed(found := search(), expected):
                return found, True
            return self._weighed(edges, follow(), found, expected)
        if self._believed(followed := follow(), expected) and not self._due(followed):
            return followed, True
        return self._weighed(edges, followed, search(), expected)

    def _due(self, followed: PoseEstimate) -> bool:
        """Whether the whole region is to be searched although the object is followed."""
        return bool(self._settings.track_check) and (
            self._followed >= self._settings.track_check * 2 ** min(self._confirmed, 20)
            or (self._followed >= _PAUSE and not self._usual.held(followed, _DOUBTED)[1]))

    def _weighed(self, edges: EdgeVolume, followed: PoseEstimate,
                 found: PoseEstimate, expected: State) -> tuple[PoseEstimate, bool]:
        """The likelier of what was followed and what the region holds; whether it is the object.

        The other one is, too, where it passes as any object does and the likelier one as nothing.
        """
        here, there = self._localizer.log_likelihoods(
            edges, np.stack([followed.pose, found.pose]))
        same = self._same(followed, found)
        # What is lost is foreseen no better by what is followed than by what is found.
        stays = same or there - here < (_BEFOREHAND if self._seen else 0)
        likelier, other = (followed, found) if stays else (found, followed)
        tracked = self._believed(followed, expected)
        accepted = (self._believed(likelier, expected)
                    or self._recognised(likelier, expected, same))
        self._followed = 0  # the region was searched just now
        if accepted:
            if stays:
                self._confirmed += 1
            elif self._seen and tracked:
                _LOG.warning('capture %d: something else was followed: the object is elsewhere, '
                             'likelier by %.0f nat', edges.header.stamp_ns, there - here)
                self._state, self._seen, self._confirmed = None, False, 0
            return likelier, True
        if not other.incomplete and self._believed(other, expected):
            return other, True
        return likelier, False

    def _recognised(self, estimate: PoseEstimate, expected: State, same: bool) -> bool:
        """Whether it is the object, if nothing in the region is likelier.

        It is enough that its contour is rather there than not, with no less evidence than usual:
        what hides an object does not look like it just where that was foreseen.
        same: the search of the region came there, too; asked for while nothing is usual.
        """
        looks_right = self._as_usual(estimate) if self._usual.known else (
            estimate.incomplete and self._seen and same)
        return (looks_right and estimate.in_view >= _IN_VIEW
                and self._foreseen(estimate, expected))

    def _foreseen(self, estimate: PoseEstimate, expected: State | None) -> bool:
        """Whether it is where it was expected."""
        if expected is None:
            return False
        mean, spread = self._about(expected)
        return self._symmetry.credible_level(estimate.pose, mean, spread) <= _FORESEEN

    def _same(self, followed: PoseEstimate, found: PoseEstimate) -> bool:
        """Whether two estimates are of one mode."""
        return bool(self._symmetry.same_mode(found.pose[None], followed.pose, *MODE_EXTENT).all())

    def _believed(self, estimate: PoseEstimate, expected: State | None) -> bool:
        """Whether it is the object, by itself and as it has been seen.

        `least_support` is for any object. One that was seen well, and now hardly is, may be hidden
        by something like it. One whose contour often shows only in part is believed by its own
        past: while it is followed, if the region was searched for anything likelier not long ago,
        in vain; and found anew, if it looks quite as it did.
        """
        followed = self._seen and estimate.mode == FOLLOWED
        if estimate.incomplete:
            if estimate.in_view < _IN_VIEW:
                return False
            if estimate.mode != FOLLOWED:
                return (not self._seen or expected is None) and self._usual.typical(estimate)
            return (followed and self._confirmed > 0 and self._followed <= _LICENCE
                    and self._as_usual(estimate) and self._foreseen(estimate, expected))
        near = followed or (self._seen and self._foreseen(estimate, expected))
        return not estimate.lost and (bool(self._usual.held(estimate, _HIDDEN).all()) if near
                                      else self._usual.half_there(estimate))

    def _as_usual(self, estimate: PoseEstimate) -> bool:
        """Whether it is known how much evidence the object usually has, and this is no less."""
        return (estimate.evidence > 0 and self._usual.known
                and bool(self._usual.held(estimate, _DOUBTED)[1]))

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
        near = self._symmetry.same_mode(estimate.particles, estimate.pose, *MODE_EXTENT)
        weights = Weights(np.where(near, estimate.log_weights, -np.inf))
        poses = estimate.particles[weights.resample(self._settings.track_particles, rng)]
        stamp_ns = estimate.header.stamp_ns
        if expected is None or self._state is None or self._action is None:
            return State.at_rest(stamp_ns, poses, camera)
        poses = self._symmetry.nearest_equivalents(poses, self._about(expected)[0])
        return self._action.updated(self._state, stamp_ns, poses, camera, self._symmetry, rng)

    def _predicted(self, estimate: PoseEstimate, expected: State) -> PoseEstimate:
        """That the object is lost, and where it should be."""
        pose, spread = self._about(expected)
        count = len(expected.poses)
        return replace(estimate, pose=pose, covariance=spread, particles=expected.poses,
                       log_weights=np.full(count, -np.log(count)), mode=PREDICTED,
                       incomplete=False)

    def _about(self, state: State) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean pose (4, 4) and covariance (6, 6) of a state."""
        mean = self._symmetry.mean_pose(state.poses)
        return mean, self._symmetry.covariance(state.poses, mean)
