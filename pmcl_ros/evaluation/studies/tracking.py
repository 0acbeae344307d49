"""A sequence through the tracker, and some of its frames through single shots as well."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.errors import is_right, pose_error
from pmcl_ros.evidence.edges import EdgeVolume, edge_volume
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.tracking.settings import Tracking, TrackingSettings
from pmcl_ros.pmcl.tracking.tracker import Tracker
from pmcl_ros.simulation.sequence import Frame, Sequence

T = TypeVar('T')


@dataclass(frozen=True)
class Outcome:
    """What one way of looking said of one frame.

    translation, rotation: errors [m, rad]. level: of the smallest credible region that holds the
    truth. sigma: the position's standard deviation [m]. seconds: of the wall clock, cpu: of all
    cores' time, from the volume to the pose. way: the estimate's mode.
    """

    way: str
    translation: float
    rotation: float
    level: float
    sigma: float
    lost: bool
    seconds: float
    cpu: float

    @property
    def right(self) -> bool:
        """Found, and within 2 cm and 10 degrees of the truth."""
        return not self.lost and is_right(self.translation, self.rotation)


@dataclass(frozen=True)
class Played:
    """One frame. single: by itself, where that was asked for. volume_seconds: of its edges."""

    number: int
    occluded: bool
    tracked: Outcome
    single: Outcome | None
    volume_seconds: float


def play(sequence: Sequence, tracking: Tracking, every: int, seed: int = 0,
         told: Callable[[Played], None] = lambda _: None) -> list[Played]:
    """Track an object through a sequence.

    every: each so-manyth frame is also localised by itself; 0: none. told: each frame as it is
    done. The same seed gives the same track.
    """
    settings = TrackingSettings(roi_center=sequence.roi_center, roi_size=sequence.roi_size,
                                tracking=tracking,
                                track_period=1 / sequence.settings.rate)
    rng = np.random.default_rng(seed)
    done: list[Played] = []
    with Localizer(sequence.model, settings) as localizer:
        tracker = Tracker(localizer, sequence.model, settings)
        for number, frame in enumerate(sequence):
            edges, seconds, _ = _timed(partial(edges_of, sequence, frame))
            tracked = _judged(partial(tracker.track, edges, rng, camera=frame.camera), frame,
                              sequence)
            single = None
            if every and number % every == 0:
                own = np.random.default_rng([seed, number])
                single = _judged(partial(localizer.localize, edges, own), frame, sequence)
            done.append(Played(number, frame.occluded, tracked, single, seconds))
            told(done[-1])
    return done


def _judged(look: Callable[[], PoseEstimate], frame: Frame, sequence: Sequence) -> Outcome:
    estimate, seconds, cpu = _timed(look)
    symmetry = sequence.model.symmetry
    error = pose_error(estimate.pose, frame.pose, symmetry)
    level = symmetry.credible_level(frame.pose, estimate.pose, estimate.covariance)
    sigma = float(np.sqrt(np.trace(estimate.covariance[:3, :3])))
    return Outcome(estimate.mode, error.translation, error.rotation, level, sigma, estimate.lost,
                   seconds, cpu)


def edges_of(sequence: Sequence, frame: Frame) -> EdgeVolume:
    """The evidence of a frame."""
    near, far = Region(sequence.roi_center, sequence.roi_size).grown(sequence.model.radius)
    labels = depth_labels(near, far, DlvSettings().edge_labels)
    return edge_volume(frame.light_field, labels, max(frame.light_field.grid.shape))


def _timed(work: Callable[[], T]) -> tuple[T, float, float]:
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return result, time.perf_counter() - wall, time.process_time() - cpu
