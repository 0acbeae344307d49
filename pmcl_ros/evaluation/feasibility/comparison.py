"""Compares two studies of feasibility cell by cell: two renderers, two cameras, two films."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import binom

from pmcl_ros.evaluation.feasibility import findings
from pmcl_ros.evaluation.feasibility.findings import Aim, good_enough, share_text
from pmcl_ros.evaluation.feasibility.scene_trials import kept_trials
from pmcl_ros.evaluation.recall import share
from pmcl_ros.evaluation.results import by_row
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.runtime.errors import FileError

LEAST, POINTS = 20, 10.0  # scenes of a cell that is compared, percent points that are alike
_ROUNDING = 1e-9  # percent points: 80 less 70 % is ten
HEAD = ('views', 'scenes', 'first', 'second', 'difference [points]')

Trials = Mapping[str, Sequence[Trial]]  # of each set of views, by its name


def studied(folder: Path) -> dict[str, list[Trial]]:
    """The trials of all scenes of `pmcl feasibility -o folder`, by the name of their views.

    Raises FileError where there are none.
    """
    trials = [each for scene in sorted((folder / 'scenes').glob('[0-9]*'))
              for each in kept_trials(scene)]
    if not trials:
        raise FileError(f'{folder} has no trials of scenes; name the --out of pmcl feasibility')
    return by_row(trials)


@dataclass(frozen=True)
class Pair:
    """A share in both studies: whether each scene is good. scenes: which, in words."""

    views: str
    scenes: str
    first: Sequence[bool]
    second: Sequence[bool]

    @property
    def counts(self) -> bool:
        """Whether both have scenes enough to be compared."""
        return min(len(self.first), len(self.second)) >= LEAST

    @property
    def difference(self) -> float:
        """Second less first, in percent points."""
        return 100 * (share(self.second) - share(self.first))

    @property
    def alike(self) -> bool:
        """Whether they differ by at most `POINTS`."""
        return abs(self.difference) <= POINTS + _ROUNDING

    @property
    def chance(self) -> float:
        """Probability that they are alike, if all scenes have the share of both together."""
        counts = [len(self.first), len(self.second)]
        pooled = share([*self.first, *self.second])
        first, second = (binom.pmf(np.arange(count + 1), count, pooled) for count in counts)
        apart = np.abs(np.subtract.outer(*(np.linspace(0, 100, count + 1) for count in counts)))
        return float((np.outer(first, second) * (apart <= POINTS + _ROUNDING)).sum())

    def row(self) -> list[str]:
        """Cells of `HEAD`."""
        return [self.views, self.scenes, share_text(self.first), share_text(self.second),
                f'{round(self.difference):+d}']


def pairs(first: Trials, second: Trials, aim: Aim) -> list[Pair]:
    """The cells of both that have `LEAST` scenes: of all, by distance and by surroundings.

    Ranges of distances are those of the first study. Sets of views are those of both. A group
    with the same scenes as one before it, as where all stand on a table, is no cell of its own.
    """
    every = [each for trials in first.values() for each in trials]
    groups = [('all', lambda _: True), *findings.distances(every), *findings.surroundings(every)]
    cells: dict[tuple[object, ...], Pair] = {}
    for views in (each for each in first if each in second):
        for scenes, belongs in groups:
            chosen = [list(filter(belongs, study[views])) for study in (first, second)]
            which = tuple(tuple(each.seed for each in trials) for trials in chosen)
            cells.setdefault((views, which), Pair(
                views, scenes, *(good_enough(trials, aim) for trials in chosen)))
    return [each for each in cells.values() if each.counts]


def verdict(compared: Sequence[Pair]) -> str:
    """How many cells are alike, and how many chance alone would let be."""
    if not compared:
        return (f'Nothing to compare: no cell has {LEAST} scenes in both studies; make more '
                '--scenes, with the same --cameras in both.')
    alike = [each.alike for each in compared]
    expected = float(np.mean([each.chance for each in compared]))
    return (f'{sum(alike)} of {len(alike)} cells with {LEAST} scenes or more '
            f'({100 * share(alike):.0f} %) differ by at most {POINTS:g} points. Were all rates '
            f'equal, scenes drawn apart would let {100 * expected:.0f} % of them.')
