"""Compares tracking with single captures, on generated sequences: trials, a table, a chart."""

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.drawing.charts import Chart, Line, draw
from pmcl_ros.evaluation.recall import median, share, values
from pmcl_ros.evaluation.results import percent
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.evidence.edges import EdgeVolume, build_edges
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.tracking.settings import Tracking, TrackingSettings
from pmcl_ros.pmcl.tracking.tracker import Tracker
from pmcl_ros.simulation.sequence import Frame, Sequence

TRACKED, SINGLE = 'tracked', 'single'  # modes of trials
_MOST = 30.0  # mm: upper end of the chart


def play(sequence: Sequence, tracking: Tracking, every: int, seed: int = 0) -> Iterator[Trial]:
    """Track an object through a sequence; yields a trial of mode TRACKED for each frame.

    every: each `every`-th frame is also localised by itself, a trial of mode SINGLE after that of
    its frame; 0: none. The same seed gives the same track.
    Trials: `capture` is the number of the frame, `empty` where a card hides everything,
    `dlv_seconds` are for the evidence; extra: `way` (`PoseEstimate.mode`), `sigma_mm` (standard
    deviation of the position), `cpu_seconds` (of all cores).
    """
    settings = TrackingSettings(roi_center=sequence.roi_center, roi_size=sequence.roi_size,
                                tracking=tracking, track_period=1 / sequence.settings.rate)
    rng = np.random.default_rng(seed)
    with Localizer(sequence.model, settings) as localizer:
        tracker = Tracker(localizer, sequence.model, settings)
        for number, frame in enumerate(sequence):
            started = time.perf_counter()
            edges = edges_of(sequence, frame)
            of_frame = {'capture': str(number), 'seed': seed, 'empty': frame.occluded,
                        'dlv_seconds': time.perf_counter() - started}
            yield _trial(partial(tracker.track, edges, rng, camera=frame.camera), frame,
                         sequence.model, mode=TRACKED, **of_frame)
            if every and number % every == 0:
                own = np.random.default_rng([seed, number])
                yield _trial(partial(localizer.localize, edges, own), frame, sequence.model,
                             mode=SINGLE, **of_frame)


def _trial(localize: Callable[[], PoseEstimate], frame: Frame, model: ObjectModel, **fields: Any
           ) -> Trial:
    wall, cpu = time.perf_counter(), time.process_time()
    estimate = localize()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    sigma = float(np.sqrt(np.trace(estimate.covariance[:3, :3])))
    extra = {'way': estimate.mode, 'sigma_mm': 1e3 * sigma, 'cpu_seconds': cpu}
    return Trial.judge(estimate, frame.pose, model, seconds=wall, extra=extra, **fields)


def edges_of(sequence: Sequence, frame: Frame) -> EdgeVolume:
    """The evidence of a frame."""
    near, far = Region(sequence.roi_center, sequence.roi_size).grown(sequence.model.radius)
    views = max(frame.light_field.grid.shape)
    return build_edges(frame.light_field, DlvSettings(near=near, far=far, views=views))


def recovery(trials: list[Trial]) -> int | None:
    """The frame after an occlusion, counted from 1, in which the object is found; None: in none.

    -1 where nothing is occluded, or the sequence ends with the occlusion.
    """
    tracked = [each for each in trials if each.mode == TRACKED]
    last = max((k for k, each in enumerate(tracked) if each.empty), default=None)
    if last is None or last + 1 == len(tracked):
        return -1
    return next((k for k, each in enumerate(tracked[last + 1:], 1) if each.found), None)


def recoveries(numbers: list[int | None]) -> str:
    """One sentence about `recovery` of several sequences."""
    numbers = [each for each in numbers if each != -1]
    if not numbers:
        return 'nothing was occluded'
    soon = sum(each is not None and each <= 3 for each in numbers)
    frames = ', '.join('never' if each is None else str(each) for each in numbers)
    return (f'found within three frames after the occlusion: {soon} of {len(numbers)} '
            f'(in frame {frames})')


def row(name: str, sequences: list[list[Trial]]) -> dict[str, str]:
    """A row of the table, over the trials of one sequence or of several."""
    both: list[tuple[Trial, Trial]] = []
    for trials in sequences:
        alone = {each.capture: each for each in trials if each.mode == SINGLE and each.present}
        both += [(each, alone[each.capture]) for each in trials
                 if each.mode == TRACKED and each.capture in alone]
    tracked, single = [each for each, _ in both], [each for _, each in both]
    frames = [each for trials in sequences for each in trials if each.mode == TRACKED]
    seen, hidden = ([each for each in frames if each.empty == empty] for empty in (False, True))
    followed = [each for each in seen if each.extra['way'] == 'followed']
    return {
        'sequence': name,
        'error tracked [mm]': _median(tracked, 'translation_mm'),
        'single [mm]': _median(single, 'translation_mm'),
        'more [mm]': _difference(both),
        'axis tracked [deg]': _median(tracked, 'axis_deg'),
        'single [deg]': _median(single, 'axis_deg'),
        'right tracked': percent(share([each.found for each in tracked])),
        'single': percent(share([each.found for each in single])),
        'followed': f'{len(followed)} of {len(seen)}',
        'lost': str(sum(each.lost for each in seen)),
        'wrong': str(sum(not each.lost and not each.found for each in seen)),
        'claimed while hidden': f'{sum(not each.lost for each in hidden)} of {len(hidden)}',
        'in the 90 % region': percent(share([each.inside_90 for each in followed])),
        'tracked [ms]': _median(seen, 'seconds', 1e3),
        'single [ms]': _median(single, 'seconds', 1e3),
        'times as fast': _ratio(single, seen, 'seconds'),
        'by CPU time': _ratio(single, seen, 'cpu_seconds'),
        'on average': _ratio(single, seen, 'seconds', np.mean),
        'slowest [ms]': f'{1e3 * values(frames, "seconds").max():.0f}',
        'edges [ms]': f'{1e3 * median(frames, "dlv_seconds"):.0f}'}


def picture(name: str, trials: list[Trial]) -> NDArray[np.uint8]:
    """Errors over frames; a line is broken where the object is lost or hidden."""
    def line(mode: str, colour: int) -> Line:
        of = [each for each in trials if each.mode == mode]
        errors = np.minimum(values(of, 'translation_mm'), _MOST)
        return Line({TRACKED: 'tracked', SINGLE: 'single shots'}[mode], values(of, 'capture'),
                    np.where(values(of, 'lost') > 0, np.nan, errors), colour)

    frames = [each for each in trials if each.mode == TRACKED]
    numbers = values(frames, 'capture')
    sigmas = np.minimum(values(frames, 'sigma_mm'), _MOST)
    lines = [line(TRACKED, 0), Line('standard deviation', numbers, sigmas, 4, True),
             Line('hidden', numbers, np.where(values(frames, 'empty') > 0, 0.0, np.nan), 3)]
    if len(frames) < len(trials):
        lines.append(line(SINGLE, 1))
    return draw([[Chart(name, 'frame', 'error [mm]', lines, (0, max(len(frames) - 1, 1)),
                        (0, _MOST))]], width=8)


def _median(trials: list[Trial], name: str, unit: float = 1.0) -> str:
    return f'{unit * median(trials, name):.1f}' if trials else ''


def _difference(both: list[tuple[Trial, Trial]]) -> str:
    """Median of the errors tracked less single, of frames that both find, and its standard error.

    The standard error is that of a median of so many independent differences.
    """
    found = np.array([tracked.translation_mm - single.translation_mm for tracked, single in both
                      if tracked.found and single.found])
    if not len(found):
        return ''
    quarter, middle, three = np.percentile(found, [25, 50, 75])
    # Of a Gaussian: quartiles are 1.349 sigma apart, a median scatters by 1.253 sigma / sqrt(n).
    return f'{middle:+.2f} ± {0.93 * (three - quarter) / np.sqrt(len(found)):.2f}'


def _ratio(slow: list[Trial], fast: list[Trial], name: str,
           typical: Callable[[NDArray[np.float64]], np.floating] = np.median) -> str:
    if not slow or not fast:
        return ''
    return f'{typical(values(slow, name)) / typical(values(fast, name)):.1f}'

