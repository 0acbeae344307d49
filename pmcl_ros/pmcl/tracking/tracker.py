"""Tracking of one object: predict its pose, observe the next capture, update the belief."""

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.pmcl.estimate import FOLLOWED, PoseEstimate
from pmcl_ros.pmcl.modes import MODE_EXTENT
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.particles import Weights
from pmcl_ros.pmcl.prior.region import Box
from pmcl_ros.pmcl.sampler import Gaussian
from pmcl_ros.pmcl.tracking.action import ActionModel, State
from pmcl_ros.pmcl.tracking.settings import TrackingSettings
from pmcl_ros.pmcl.tracking.track import DOUBT_SIGMA, Prediction, Track
from pmcl_ros.runtime.errors import LocalizationError
from pmcl_ros.runtime.progress import Progress

_LOG = logging.getLogger(__name__)
PREDICTED = 'predicted'  # mode of an estimate, beside those of `Localizer`
_DOUBT_INTERVAL = 3  # captures between two searches of the region that only doubt asks for


class Evidence(Protocol):
    """Of one capture: by one view or by several."""

    @property
    def header(self) -> Header:
        """Which capture."""
        ...


class Follower(Protocol):
    """What a tracker searches with: `Localizer`, or `MultiViewLocalizer`."""

    @property
    def localize(self) -> Callable[..., PoseEstimate]:
        """Evidence, random numbers, progress -> estimate, in the whole region."""
        ...

    @property
    def follow(self) -> Callable[..., PoseEstimate]:
        """Evidence, prior, random numbers, particles, candidates -> estimate near the prior."""
        ...

    @property
    def log_likelihoods(self) -> Callable[..., NDArray[np.float64]]:
        """Evidence, poses (n, 4, 4) -> (n,) [nat]."""
        ...


class Tracker:
    """Follows one object from capture to capture.

    predict: particles of the last posterior are moved by the action model.
    observe: the capture is searched near the prediction. Where that estimate does not pass the
        gate (`Track`), the whole region is searched too, and the likelier of both poses is
        accepted if it is predicted and has its usual evidence. A capture takes no longer than
        both searches. While the object is followed the region is also searched from time to
        time, ever more rarely, and when the evidence is unusually weak: something similar may
        have been taken for the object.
    update: the accepted posterior becomes the belief. Without one the object is lost: the
        prediction goes on and widens, and the region is searched first. The track ends when the
        prediction is as wide as the region.

    localizer: of the same model and settings; the caller closes it. status: of the track, for
    reading.
    """

    def __init__(self, localizer: Follower, model: ObjectModel, settings: TrackingSettings
                 ) -> None:
        self._localizer, self._settings = localizer, settings
        self._symmetry = model.symmetry
        self._action = None if settings.tracking == 'none' else ActionModel(
            settings.tracking, settings.track_sigma_translation, settings.track_sigma_rotation,
            settings.track_period)
        self._region = Box(settings.roi_center, settings.roi_size)
        self.status = Track(self._symmetry)

    def reset(self) -> None:
        """Forget the track and its statistics: the next capture is searched as the first."""
        self.status.drop()
        self.status.statistics.clear()

    def track(self, evidence: Evidence, rng: np.random.Generator,
              progress: Progress | None = None, camera: NDArray[np.float64] | None = None
              ) -> PoseEstimate:
        """The object's pose in the next capture.

        camera: (4, 4), camera to the fixed frame, for the action model 'camera'; without it, or
            with a capture no newer than the last, the track ends, and the region is searched.
        The estimate's mode is that of `Localizer.localize`, 'followed', or 'predicted' where the
        object is lost and the pose is the prediction.
        Raises what `Localizer.localize` raises; the track goes on with the next capture then.
        """
        if self._action is None:
            return self._localizer.localize(evidence, rng, progress)
        prediction = self._predict(evidence.header.stamp_ns, camera, rng)
        estimate, accepted = self._observe(evidence, prediction, rng, progress)
        return self._update(estimate, accepted, prediction, camera, rng)

    def _predict(self, stamp_ns: int, camera: NDArray[np.float64] | None,
                 rng: np.random.Generator) -> Prediction | None:
        """The belief before a capture; None where it says no more than the region does."""
        if self._action is None or self.status.state is None:
            return None
        try:
            state = self._action.predict(self.status.state, stamp_ns, camera, rng)
        except LocalizationError as error:
            _LOG.warning('the track ends: %s', error)
            return None
        mean = state.poses[:, :3, 3].mean(axis=0)
        spread = state.poses[:, :3, 3].std(axis=0)
        region, half = self._region, np.array(self._region.size) / 2
        if (spread > half).any() or (np.abs(mean - region.center) > half + 3 * spread).any():
            _LOG.warning('the track ends: by capture %d the object may be anywhere in the region '
                         'of interest, or have left it', stamp_ns)
            return None
        return Prediction.from_state(state, self._symmetry)

    def _observe(self, evidence: Evidence, prediction: Prediction | None,
                 rng: np.random.Generator, progress: Progress | None
                 ) -> tuple[PoseEstimate, bool]:
        """The estimate of a capture, and whether it is accepted."""
        track, settings = self.status, self._settings

        def detect() -> PoseEstimate:
            track.since_search = 0
            return self._localizer.localize(evidence, rng, progress)

        if prediction is None:  # the track is new, but the statistics hold
            track.confirmations = 0
            return (detected := detect()), track.passes_gate(detected, None)
        prior = Gaussian.from_covariance(prediction.mean, prediction.covariance, self._symmetry)

        def follow() -> PoseEstimate:
            track.since_search += 1
            return self._localizer.follow(
                evidence, prior, rng, settings.track_particles, settings.track_candidates)

        # An old prediction is wide: it holds other things that look like the object.
        if not track.observed:
            if track.passes_gate(detected := detect(), prediction):
                return detected, True
            followed = follow()
        else:
            followed = follow()
            if track.passes_gate(followed, prediction) and not self._search_due(followed):
                return followed, True
            detected = detect()
        here, there = self._localizer.log_likelihoods(
            evidence, np.stack([followed.pose, detected.pose]))
        was_observed = track.observed
        estimate, accepted = track.select(followed, detected, there - here, prediction)
        if was_observed and not track.observed:
            _LOG.warning('capture %d: something else was followed; the object is elsewhere, '
                         'likelier by %.0f nat', evidence.header.stamp_ns, there - here)
        return estimate, accepted

    def _search_due(self, followed: PoseEstimate) -> bool:
        """Whether to search the whole region although the followed estimate passes the gate."""
        track, interval = self.status, self._settings.track_check
        doubted = not track.statistics.within_three_sigma(followed, DOUBT_SIGMA)[1]
        return bool(interval) and (
            track.since_search >= interval * 2 ** min(track.confirmations, 20)
            or (track.since_search >= _DOUBT_INTERVAL and bool(doubted)))

    def _update(self, estimate: PoseEstimate, accepted: bool, prediction: Prediction | None,
                camera: NDArray[np.float64] | None, rng: np.random.Generator) -> PoseEstimate:
        """The belief after a capture; what `track` returns."""
        track, stamp_ns = self.status, estimate.header.stamp_ns
        was_observed, track.observed = track.observed, accepted
        if not accepted:
            if was_observed:
                _LOG.info('lost in capture %d: the whole region is searched until it is found',
                          stamp_ns)
            track.statistics.forget_oldest()
            track.state = None if prediction is None else prediction.state
            lost = replace(estimate, lost=True)
            return lost if prediction is None else _predicted(lost, prediction)
        redetected = not was_observed or estimate.mode != FOLLOWED
        if redetected and not (track.has_usual_evidence(estimate)
                               and track.in_validation_gate(estimate, prediction)):
            track.confirmations = 0
        track.statistics.add(estimate)
        if not was_observed:
            _LOG.info('found in capture %d', stamp_ns)
        track.state = self._posterior(estimate, prediction if was_observed else None, camera, rng)
        return replace(estimate, lost=False)

    def _posterior(self, estimate: PoseEstimate, prediction: Prediction | None,
                   camera: NDArray[np.float64] | None, rng: np.random.Generator) -> State:
        """Equally weighted particles of the estimate's mode, with velocities."""
        near = self._symmetry.same_mode(estimate.particles, estimate.pose, *MODE_EXTENT)
        weights = Weights(np.where(near, estimate.log_weights, -np.inf))
        poses = estimate.particles[weights.resample(self._settings.track_particles, rng)]
        stamp_ns = estimate.header.stamp_ns
        if prediction is not None and estimate.mode != FOLLOWED:
            turned = self._symmetry.rotation_distance(estimate.pose[None], prediction.mean)[0]
            if turned > MODE_EXTENT[1]:
                prediction = None  # followed upside down until now, say: it has not turned
        if prediction is None or self.status.state is None or self._action is None:
            return State.at_rest(stamp_ns, poses, camera)
        poses = self._symmetry.nearest_equivalents(poses, prediction.mean)
        return self._action.update(self.status.state, stamp_ns, poses, camera, self._symmetry, rng)


def _predicted(estimate: PoseEstimate, prediction: Prediction) -> PoseEstimate:
    """The estimate of a lost object: the prediction."""
    poses = prediction.state.poses
    return replace(estimate, pose=prediction.mean, covariance=prediction.covariance,
                   particles=poses, log_weights=np.full(len(poses), -np.log(len(poses))),
                   mode=PREDICTED, incomplete=False)
