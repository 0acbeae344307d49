"""Numbers of the evidence that were learned from generated scenes: read once from data files.

`config/learned/contour.yaml` and `creases.yaml` lie in the package's share folder or source tree.
The package can be imported, and a node started, where one of them is missing or wrong: what needs
the numbers raises SettingsError.
"""

from functools import cache
from typing import Annotated, TypeVar

import numpy as np
from pydantic import Field, model_validator

from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.resources import candidates
from pmcl_ros.runtime.settings import Settings

_FOLDER = 'package://pmcl_ros/config/learned'
_Error = Annotated[float, Field(gt=0, le=100)]
# Sizes that the renderers' scores are made for (`check_profile` of pmcl/render/contour.py).
MOST_OFFSETS, MOST_KNOTS = 8, 9

T = TypeVar('T', bound='LearnedProfile')


class LearnedProfile(Settings):
    """The fields of a `ContourProfile` that are learned."""

    offsets: tuple[float, ...] = Field(
        min_length=1, max_length=MOST_OFFSETS,
        description='from the contour, ascending, outside positive [px]')
    knots: tuple[float, ...] = Field(
        min_length=2, max_length=MOST_KNOTS, description='edge energies, ascending from 0 [1]')
    tables: tuple[tuple[float, ...], ...] = Field(
        description='evidence at each offset (rows) and knot (columns) [nat / px]')
    bias: float = Field(description='evidence beside that of the tables [nat / px]')

    @model_validator(mode='after')
    def _shapes(self) -> 'LearnedProfile':
        for name in ('offsets', 'knots'):
            if np.any(np.diff(getattr(self, name)) <= 0):
                raise ValueError(f'{name} must ascend, they are {list(getattr(self, name))}')
        if self.knots[0] != 0:
            raise ValueError(f'knots must begin at 0, they begin at {self.knots[0]}')
        widths = {len(row) for row in self.tables}
        if len(self.tables) != len(self.offsets) or widths != {len(self.knots)}:
            raise ValueError(f'tables must have {len(self.offsets)} rows (offsets) of '
                             f'{len(self.knots)} numbers (knots), they have {len(self.tables)} '
                             f'rows of {sorted(widths)}')
        return self


class LearnedContour(LearnedProfile):
    """What is learned of occluding contours: profile, thresholds, error of the model."""

    least_evidence: float = Field(
        description='mean evidence of a contour below which the object is lost [nat / px]')
    least_support: float = Field(
        ge=-5, le=5, description='default of the parameter least_support [nat / px]')
    common_error: _Error = Field(
        description='standard deviation of the displacement of a whole contour [px]')
    local_error: _Error = Field(
        description='standard deviation of the displacement of stretches of a contour [px]')
    error_length: _Error = Field(description='correlation length along these stretches [px]')


@cache
def learned_contour() -> LearnedContour:
    """The numbers of `contour.yaml`; SettingsError names the file, and the field that is wrong."""
    return _load(LearnedContour, 'contour.yaml')


@cache
def learned_creases() -> LearnedProfile:
    """The numbers of `creases.yaml`; SettingsError names the file, and the field that is wrong."""
    return _load(LearnedProfile, 'creases.yaml')


def _load(kind: type[T], name: str) -> T:
    tried = candidates(f'{_FOLDER}/{name}')
    for each in tried:
        if each.exists():
            return kind.load(each)
    raise SettingsError(f'learned numbers: there is no {tried[0]}; reinstall the package, or '
                        'learn them again with pmcl learn --out (docs/concepts/evidence.md)')
