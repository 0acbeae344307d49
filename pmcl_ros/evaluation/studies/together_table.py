"""What is told of scenes of several objects: a Markdown table, and the shares below it."""

from collections.abc import Sequence

import numpy as np

from pmcl_ros.evaluation.studies.together import Found, Together
from pmcl_ros.pmcl.multi_object.penetration import MAX_PENETRATION

_HEAD = ('| seed | objects | overlap | alone | together | as well | deepest | missing one | time |'
         '\n|---|---|---|---|---|---|---|---|---|')


def table(trials: Sequence[Together]) -> str:
    """A row for each scene, then what they say together."""
    rows = [_row(each) for each in trials]
    pairs = [(one, other) for each in trials
             for one, other in zip(each.together, each.alone, strict=True)]
    singles = [(one, other) for each in trials if not each.copies
               for one, other in zip(each.together, each.alone, strict=True)]
    lines = [
        f'{len(trials)} scenes, {len(pairs)} objects; localised as well together as alone: '
        f'{_share([one.as_well_as(other) for one, other in pairs])}; where no two are alike: '
        f'{_share([one.as_well_as(other) for one, other in singles])}',
        'by the pose alone, lost or not: '
        f'{_share([one.placed_as_well_as(other) for one, other in pairs])}',
        _told('alone', [other for _, other in pairs]),
        _told('together', [one for one, _ in pairs]),
        f'pairs deeper in each other than {1e3 * MAX_PENETRATION:.0f} mm: '
        f'{_share([each.depth > MAX_PENETRATION for each in trials])} of scenes, the deepest '
        f'{1e3 * max(each.depth for each in trials):.1f} mm',
        'the missing one told lost: '
        f'{_share([each.absent for each in trials])}, alone '
        f'{_share([each.absent_alone for each in trials])}',
        f'median time {np.median([each.seconds for each in trials]):.1f} s']
    return '\n'.join([_HEAD, *rows, '', *(f'- {line}' for line in lines)])


def _told(name: str, found: Sequence[Found]) -> str:
    near = [each for each in found if each.near]
    median = 1e3 * float(np.median([each.translation for each in near])) if near else np.nan
    return (f'{name}: found {_share([each.rank == 2 for each in found])}, lost '
            f'{_share([each.rank == 1 for each in found])}, elsewhere '
            f'{_share([each.rank == 0 for each in found])}; within 2 cm and 10 degrees, lost or '
            f'not, {_share([each.near for each in found])}, their median error {median:.1f} mm')


def _row(trial: Together) -> str:
    as_well = [one.as_well_as(other)
               for one, other in zip(trial.together, trial.alone, strict=True)]
    cells = [str(trial.seed), trial.name + (', two alike' if trial.copies else ''),
             f'{100 * trial.overlap:.0f} %', _errors(trial.alone), _errors(trial.together),
             f'{sum(as_well)} of {len(as_well)}', f'{1e3 * trial.depth:.1f} mm',
             'lost' if trial.absent else 'found', f'{trial.seconds:.0f} s']
    return f'| {" | ".join(cells)} |'


def _errors(found: Sequence[Found]) -> str:
    """Errors [mm]; in brackets where it is lost; what is elsewhere is only said to be."""
    told = [f'{1e3 * each.translation:.1f}' if each.near else 'elsewhere' for each in found]
    return ', '.join(f'({word})' if each.lost else word
                     for word, each in zip(told, found, strict=True))


def _share(values: Sequence[bool]) -> str:
    if not values:
        return 'none'
    return f'{100 * float(np.mean(values)):.0f} % ({sum(values)} of {len(values)})'
