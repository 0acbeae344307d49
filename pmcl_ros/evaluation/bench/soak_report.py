"""What a soak test found, what of it is not as it must be, and its table."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.stats import theilslopes

from pmcl_ros.evaluation.results import table

# On their way at once: one is searched, one is decoded or waits. A third could overtake.
UNDER_WAY = 2
# MB that a process may have grown: less than three raw pictures; one that was kept at each capture
# would be far more.
_FLAT = 60.0
_ENOUGH = 100  # captures: before, what is kept for the next time is still growing
# Memory of a process that has run for _MANY captures must be flatter in their later half: MB in
# 1,000 captures.
_MANY, _SLOPE = 1000, 1.0
_LINE = 3  # points: a line through fewer has no error
_SURE = 0.95  # of the interval of its slope
_SHOWN = 10  # measurements, in the table
_DESCRIPTORS, _THREADS = 4, 2  # which may come and go


@dataclass(frozen=True)
class Slope:
    """MB in 1,000 captures, and its 95 % interval."""

    slope: float
    low: float
    high: float

    @property
    def text(self) -> str:
        """In words."""
        return f'{self.slope:.1f} ({self.low:.1f} to {self.high:.1f}) MB in 1,000 captures'


@dataclass
class Soak:
    """The result of a soak test.

    captures: published, by their stamps. poses: that came. twice: stamps that came again. strange:
    of no capture. lost: captures in which the object was not found. dropped, errors: as the nodes
    report on /diagnostics, by node. unreported: captures without a pose and without a report.
    latency: from shutter to pose, seconds: percentiles. memory, descriptors, threads: by process,
    each time the graph had run empty. left: files in /dev/shm that outlived the graph.
    diagnostics: by node, the values of its last message on /diagnostics.
    disturbances: how often each happened. killed: processes of the graph, among them.
    unanswered: captures that a driver was asked for and did not answer, as it was killed.
    """

    captures: int = 0
    poses: int = 0
    twice: int = 0
    strange: int = 0
    lost: int = 0
    refused: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    errors: dict[str, int] = field(default_factory=dict)
    unreported: int = 0
    seconds: float = 0
    latency: dict[str, float] = field(default_factory=dict)
    after: list[int] = field(default_factory=list)
    memory: dict[str, list[float]] = field(default_factory=dict)
    descriptors: dict[str, list[int]] = field(default_factory=dict)
    threads: dict[str, list[int]] = field(default_factory=dict)
    left: list[str] = field(default_factory=list)
    diagnostics: dict[str, dict[str, str]] = field(default_factory=dict)
    status: int = 0
    tracebacks: int = 0
    disturbances: dict[str, int] = field(default_factory=dict)
    killed: int = 0
    unanswered: int = 0

    def violations(self, flood: bool) -> list[str]:
        """What is not as it must be, in words. flood: captures came faster than can be used."""
        # What a process held when it was killed is reported by the log of pmcl_bringup alone, and
        # Fast DDS leaves its files of shared memory.
        untold = (max(self.unreported - UNDER_WAY * self.killed, 0)
                  or min(self.unreported + self.unanswered, 0))
        found = [(self.twice, 'poses of a capture that had one already'),
                 (max(self.strange - self.unanswered, 0), 'poses of no capture'),
                 (abs(untold), 'captures too few, or too many, are reported as lost'),
                 (sum(self.errors.values()), 'errors'), (self.refused, 'captures refused'),
                 (0 if flood or self.killed else sum(self.dropped.values()), 'captures dropped'),
                 (0 if self.killed else len(self.left),
                  f'files left in /dev/shm: {", ".join(self.left)}'),
                 (self.tracebacks, 'tracebacks'),
                 (abs(self.status), 'is the exit status of the graph, not 0')]
        words = [f'{count} {what}' for count, what in found if count]
        for values, most, what in ((self.memory, _FLAT, 'MB'),
                                   (self.descriptors, _DESCRIPTORS, 'descriptors'),
                                   (self.threads, _THREADS, 'threads')):
            for name, each in values.items():
                least = _ENOUGH if values is self.memory else 0
                first = next((one for one, age in zip(each, self._ages(each), strict=True)
                              if age >= least), each[-1])
                if each[-1] - first > most:
                    words.append(f'{name} grew by {each[-1] - first:.0f} {what}')
        words += [f'{name} grows by {slope.text}' for name, slope in self.slopes.items()
                  if slope.slope > _SLOPE]
        return words

    def _ages(self, measured: Sequence[float]) -> NDArray[np.int64]:
        """(n,) captures that a process had run for at its n measurements, about.

        One that was killed counts anew, from the measurement before its first one.
        """
        started = 0 if len(measured) == len(self.after) else self.after[-len(measured) - 1]
        return np.array(self.after[-len(measured):], np.int64) - started

    @property
    def slopes(self) -> dict[str, Slope]:
        """How the memory of a process grows in the later half of a long run.

        In the first half what is kept for the next time still grows. The slope is the median of
        those of all pairs (Theil-Sen): a measurement that meets a passing peak does not count
        much. Of processes that were measured three times there.
        """
        found = {}
        for name, memory in self.memory.items():
            ages = self._ages(memory)
            later = ages >= ages[-1] / 2
            if ages[-1] >= _MANY and later.sum() >= _LINE:
                slope, _, low, high = theilslopes(np.array(memory)[later], ages[later] / 1000,
                                                  _SURE)
                found[name] = Slope(float(slope), float(low), float(high))
        return found

    def markdown(self) -> str:
        """A table."""
        missing = self.captures - self.poses
        rows = [('captures, poses, lost', f'{self.captures}, {self.poses}, {self.lost}'),
                ('without a pose, and reported as lost, dropped or failed',
                 f'{missing}, {missing - self.unreported}'),
                ('rate', f'{self.captures / self.seconds:.2f} captures/s'),
                ('shutter to pose', ', '.join(f'{name} {1e3 * each:.0f} ms'
                                              for name, each in self.latency.items()))]
        for values, unit in ((self.memory, 'MB'), (self.descriptors, 'descriptors'),
                             (self.threads, 'threads')):
            for name, each in values.items():
                shown = np.unique(np.linspace(0, len(each) - 1, _SHOWN).astype(int))
                after = ', '.join(str(self.after[-len(each):][one]) for one in shown)
                rows.append((f'{name}: {unit} after {after} captures',
                             ', '.join(f'{each[one]:.0f}' for one in shown)))
                rows.append((f'{name}: {unit}, least and most', f'{min(each):.0f}, '
                             f'{max(each):.0f}'))
        rows += [(f'{name}: growth of the later half', slope.text)
                 for name, slope in self.slopes.items()]
        rows += [(f'disturbance: {what}', f'{count} times')
                 for what, count in self.disturbances.items()]
        rows.append(('left in /dev/shm', str(len(self.left))))
        return table(['what', 'result'], rows)
