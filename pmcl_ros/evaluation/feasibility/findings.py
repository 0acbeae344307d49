"""What the trials of simulated scenes say: shares with intervals, causes, a recommendation."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evaluation.feasibility.view_sets import ViewSet
from pmcl_ros.evaluation.recall import (
    cumulative,
    interval,
    present,
    share,
    share_with_interval,
    values,
)
from pmcl_ros.evaluation.trials import Trial

LEAST = 10  # trials of a cell; fewer say nothing
_DISTANCES = 3  # ranges of the distance at most, with as many scenes each
_UPSIDE_DOWN, _BESIDE = 150.0, 40.0  # degrees and mm off: the object stands on its head there
_CLOSE_CALL = 5.0  # nat: poses whose evidence differs by less look alike
_ALIKE = 'upright and upside down look alike'


@dataclass(frozen=True)
class Aim:
    """What is good enough: errors [mm], [degrees], and the share of scenes that must reach it."""

    mm: float = 3.0
    degrees: float = 5.0
    share: float = 0.9

    def reached(self, trial: Trial) -> bool:
        """Whether a pose is claimed, and right within both bounds."""
        return (not trial.lost and trial.translation_mm <= self.mm
                and trial.axis_deg <= self.degrees)

    def __str__(self) -> str:
        return f'{self.mm:g} mm and {self.degrees:g} degrees'


def good_enough(trials: Sequence[Trial], aim: Aim) -> list[bool]:
    """Whether each trial with something to find reaches the aim."""
    return [aim.reached(each) for each in present(trials)]


def share_text(flags: Sequence[bool]) -> str:
    """The share of true flags with count and interval; nothing of fewer than `LEAST`."""
    return share_with_interval(flags) if len(flags) >= LEAST else ''


def _medians(trials: Sequence[Trial], *names: str) -> str:
    """Of sizes of numbers (`values`) over the trials; nothing of fewer than `LEAST`."""
    return ', '.join(f'{np.median(abs(values(trials, name))):.1f}' for name in names
                     ) if len(trials) >= LEAST else ''


HEAD = ('good enough', 'claimed, right within 2 cm, 10°', 'lost', 'wrong', 'error [mm]',
        'across, along the ray [mm]', 'angle [°]', 'expected [mm]', '90 % regions hold')


def row(trials: Sequence[Trial], aim: Aim) -> list[str]:
    """Cells of `HEAD`: medians are of the poses that are claimed and right."""
    there = present(trials)
    found = [each for each in there if each.found]
    return [share_text(good_enough(trials, aim)), share_text([each.found for each in there]),
            share_text([each.lost for each in there]),
            share_text([not each.near and not each.lost for each in there]),
            _medians(found, 'translation_mm'), _medians(found, 'across_mm', 'ray_mm'),
            _medians(found, 'axis_deg'), _medians(found, 'told_mm'),
            share_text([each.inside_90 for each in found])]


Group = tuple[str, Callable[[Trial], bool]]


def distances(trials: Sequence[Trial]) -> list[Group]:
    """Ranges of the distance of the object, with as many trials each."""
    ranges = int(np.clip(len({each.seed for each in trials}) // LEAST, 1, _DISTANCES))
    edges = np.unique(np.quantile(values(trials, 'distance'), np.linspace(0, 1, ranges + 1)))
    if len(edges) < 2:
        return [(f'{edges[0]:.2f} m', lambda _: True)]
    return [(f'{low:.2f} to {high:.2f} m', _between(low, high, high == edges[-1]))
            for low, high in pairwise(edges)]


def _between(low: float, high: float, last: bool) -> Callable[[Trial], bool]:
    return lambda each: (low <= each.extra['distance'] < high
                         or (last and each.extra['distance'] == high))


def surroundings(trials: Sequence[Trial]) -> list[Group]:
    """What the object stands in or before: what scenes' names say before the colon.

    Those with fewer than `LEAST` scenes are one group.
    """
    scenes = {(each.seed, _where(each)) for each in trials}
    counts = Counter(where for _, where in scenes)
    enough = sorted(where for where, count in counts.items() if count >= LEAST)
    groups: list[Group] = [(where, lambda each, where=where: _where(each) == where)  # type: ignore[misc]
                           for where in enough]
    if len(enough) < len(counts):
        groups.append(('others' if enough else 'all',
                       lambda each: _where(each) not in enough))
    return groups


def _where(trial: Trial) -> str:
    return trial.capture.partition(':')[0]


def worst(trials: Sequence[Trial], count: int) -> list[Trial]:
    """Wrong poses first, then lost ones, then the largest errors."""
    def badness(each: Trial) -> tuple[int, float]:
        wrong = not each.near and not each.lost
        return (2 if wrong else 1 if each.lost else 0), each.translation_mm
    return sorted(present(trials), key=badness, reverse=True)[:count]


def causes(trials: Sequence[Trial], aim: Aim) -> list[str]:
    """Why poses are not good enough, with how many scenes; most frequent first.

    Of poses that look alike, the largest difference of their evidence is told [nat].
    """
    missed = [(_cause(each), abs(each.extra['gap'])) for each in present(trials)
              if not aim.reached(each)]
    counts = Counter(cause for cause, _ in missed)
    apart = max((gap for cause, gap in missed if cause == _ALIKE), default=0.0)
    words = {_ALIKE: f'{_ALIKE} within {math.ceil(apart)} nat'}
    return [f'{words.get(cause, cause)} ({count})' for cause, count in counts.most_common()]


def _cause(trial: Trial) -> str:
    if trial.found:
        return 'found, but not exactly enough'
    if trial.near:
        return 'the pose is right, but its contours are too faint to be sure'
    if (trial.symmetric and trial.axis_deg > _UPSIDE_DOWN and trial.translation_mm < _BESIDE
            and abs(trial.extra['gap']) <= _CLOSE_CALL):
        return _ALIKE
    if trial.extra['gap'] > _CLOSE_CALL:
        return 'something else looks more like the object'
    if trial.extra['gap'] < -_CLOSE_CALL:
        return 'the search missed the true pose'
    return 'another pose looks as likely'


def recommendation(sets: Sequence[ViewSet], trials: dict[str, list[Trial]], aim: Aim) -> str:
    """What to mount, in plain words.

    The fewest views whose share reaches the aim; said with its interval. What fewer views lack is
    said too.
    """
    flags = {each.name: good_enough(trials[each.name], aim) for each in sets}
    scenes = max(map(len, flags.values()))
    if scenes < LEAST:
        return f'Too few scenes to say anything: {scenes}, {LEAST} at least.'
    shares = {name: share(each) for name, each in flags.items()}
    good = [each for each in sets if shares[each.name] >= aim.share]
    chosen = min(good, key=lambda each: (
        len(each.pictures), -shares[each.name])) if good else max(
        sets, key=lambda each: shares[each.name])
    name = chosen.name
    text = f'{name[:1].upper()}{name[1:]}: {share_text(flags[name])} within {aim}.'
    if not good:
        text = (f'Not yet: the best is {name}, {share_text(flags[name])} within {aim}, where '
                f'{100 * aim.share:.0f} % are asked.')
    elif interval(flags[name])[0] < aim.share - 0.1:
        text += ' More scenes would make this surer.'
    why = causes(trials[name], aim)
    if why and not good:
        text += f' What fails: {"; ".join(why)}.'
    if not chosen.is_one and sets[0].is_one:
        one = sets[0].name
        text += (f' One view is not enough: {share_text(flags[one])}; '
                 f'{"; ".join(causes(trials[one], aim)[:2])}.')
    return text


def success(trials: Sequence[Trial], bounds: NDArray[np.float64], aim: Aim) -> NDArray[np.float64]:
    """(n,) share of the trials claimed within each bound [mm] and the aim's angle, in percent."""
    there = present(trials)
    errors = np.array([each.translation_mm if not each.lost and each.axis_deg <= aim.degrees
                       else np.inf for each in there])
    return 100 * cumulative(errors, bounds)
