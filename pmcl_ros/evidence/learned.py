"""config/learned/*.yaml -> the learned numbers of the evidence, checked; each is read once.

`contour.yaml`, `creases.yaml`, `contour_map.yaml` and others lie in `config/learned`, in the
package's share folder or source tree; or in the folder that the environment variable PMCL_LEARNED
names.
The package can be imported, and a node started, where one of them is missing or wrong: what needs
the numbers raises SettingsError.
"""

import math
import os
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar

import numpy as np
from pydantic import Field, model_validator

from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.resources import candidates
from pmcl_ros.runtime.settings import Settings

_FOLDER = 'package://pmcl_ros/config/learned'
_Error = Annotated[float, Field(gt=0, le=100)]
_Degrees = Annotated[float, Field(
    ge=1, description="degrees of freedom of the Student's t of the errors of poses [1]")]
# Sizes that the renderers' scores are made for (`check_profile` of pmcl/render/contour.py).
MOST_OFFSETS, MOST_KNOTS = 8, 9
_ALIKE = 0.05  # independent views beyond one: two cameras 2 degrees apart

T = TypeVar('T', bound=Settings)


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


class Calibration(Settings):
    """From a logit x of the network to a log odds ratio: scale x + bias - log odds of the rate."""

    scale: float = Field(gt=0, description='of the logit [1]')
    bias: float = Field(description='added to the scaled logit [nat]')
    rate: float = Field(gt=0, lt=1, description='base rate of the pixels for which it is true [1]')

    @property
    def offset(self) -> float:
        """What is added to the scaled logit in all [nat]."""
        return self.bias - float(np.log(self.rate / (1 - self.rate)))


class LearnedMap(Settings):
    """What belongs to the network of the contour map, `contour_map.onnx`."""

    version: str = Field(min_length=1, description='of the network, as logs give it')
    sha256: str = Field(pattern='^[0-9a-f]{64}$', description='of the ONNX file')
    positive_weight: float = Field(
        gt=0, description="of contour pixels in the training's loss; the calibration has it [1]")
    contour: Calibration = Field(
        description='of a contour whose outward normal is within 22.5 degrees of a direction')
    inside: Calibration = Field(description='of the inside of solids')
    training: dict[str, Any] = Field(description='record: command, seeds, losses, versions')


class SupportSlopes(NamedTuple):
    """By how much the support that a pose needs changes with other numbers of it (`Thresholds`).

    evidence: less, for each nat / px of mean evidence [1]. odds: less, for each nat of the log
    odds of the mode's weight [1 / px]. inside: more, for each nat / px of the mean log odds of
    solids that the object covers [1].
    """

    evidence: float = 0.0
    odds: float = 0.0
    inside: float = 0.0

    def instead(self, evidence: float, odds: float, inside: float) -> float:
        """What these numbers of a pose are worth in support [nat / px].

        inside: NaN where the evidence does not tell of solids.
        """
        return (self.evidence * evidence + self.odds * odds
                - (self.inside * inside if math.isfinite(inside) else 0.0))


NO_SLOPES = SupportSlopes()  # nothing takes the place of support


class LearnedMapEvidence(Settings):
    """How the log odds of a contour map become the evidence of a pose."""

    contour_weight: float = Field(
        gt=0, le=1, description="of the contour's log odds: neighbouring pixels share noise [1]")
    inside_weight: float = Field(
        ge=0, le=1, description="of the covered pixels' log odds, for the same reason [1]")
    contour_offset: float = Field(
        0.0, ge=-3, le=3, description='where contours are found in pictures, from where they are: '
        'outwards [px]')
    least_evidence: float = Field(
        description='mean evidence of a contour below which the object is lost [nat / px]')
    least_support: float = Field(
        description='support below which it is, where the numbers of the slopes are 0 [nat / px]')
    evidence_slope: float = Field(
        0.0, ge=0, description='by how much less support is enough for each nat / px of mean '
        'evidence [1]')
    odds_slope: float = Field(
        0.0, ge=0, description="by how much less for each nat of the log odds of the mode's "
        'weight [1 / px]')
    inside_slope: float = Field(
        0.0, ge=0, description='by how much more is needed for each nat / px of the mean log odds '
        'of solids that the object covers [1]')
    least_weight: float = Field(
        ge=0, le=1, description="posterior weight of the pose's mode below which it is [1]")
    common_error: _Error = Field(
        description='standard deviation of the displacement of a whole contour [px]')
    local_error: _Error = Field(
        description='standard deviation of the displacement of stretches of a contour [px]')
    error_length: _Error = Field(description='correlation length along these stretches [px]')
    degrees_of_freedom: _Degrees = math.inf

    @property
    def slopes(self) -> SupportSlopes:
        """How the support that is needed depends on other numbers of a pose."""
        return SupportSlopes(self.evidence_slope, self.odds_slope, self.inside_slope)


class LearnedViews(Settings):
    """What is learned of one object in several views, by their contour maps."""

    least_evidence: float = Field(
        description='mean evidence of all contours below which the object is lost [nat / px]')
    least_support: float = Field(
        description='support below which it is, where the numbers of the slopes are 0 [nat / px]')
    support_slope: float = Field(
        ge=0, description='by how much more support is needed for each unit of '
        'log(1 + disagreement) [nat / px]')
    beyond_slope: float = Field(
        ge=0, description='by how much more for each nat / px of evidence beyond the '
        'contours [1]')
    inside_slope: float = Field(
        0.0, ge=0, description='by how much more for each nat / px of the mean log odds of solids '
        'that the object covers [1]')
    error_share: float = Field(
        gt=0, le=100, description='variance of the model error, relative to that of one view, '
        'before views are compared [1]')
    error_views: float = Field(
        gt=0, le=1000, description='number of independent views that this is worth [1]')
    disagreement: float = Field(
        gt=0, le=100, description='median square by which views are off, relative to what the '
        'model error of one view lets expect, where that model error holds [1]')
    displacement: float = Field(
        0.0, ge=0, le=10, description='standard deviation of where contours are found in all '
        'views alike, outwards [px]')
    degrees_of_freedom: _Degrees = math.inf

    def displaced(self, views: float) -> float:
        """Standard deviation of the displacement that views share, beside the model error [px].

        views: independent ones; in those of about one place it is a part of that error.
        """
        return self.displacement * math.sqrt(1 - _alike(views))

    def share(self, views: float, disagreement: float) -> float:
        """Variance of the model error, relative to that of one view.

        views: independent ones. disagreement: of these. It would be the mean of a scaled inverse
        chi-squared distribution with that prior, but for a constant, if disagreement were a mean
        square; of views of about one place, which cannot disagree, it is 1.
        """
        alike = _alike(views)
        found = views * disagreement / self.disagreement
        return alike + (1 - alike) * (self.error_views * self.error_share + found) / (
            self.error_views + views - 1)

    def needed(self, views: float, disagreement: float, beyond: float, alone: float) -> float:
        """The support below which an object is lost, but for `slopes` [nat / px].

        views, disagreement: as of `share`. beyond: mean evidence beyond the contours [nat / px].
        alone: `least_support` of one view; views of about one place need it too.
        Views of a wrong pose disagree, as each sees something else there, and beyond its contours
        are those of what is there.
        """
        alike = _alike(views)
        together = (self.least_support + self.support_slope * math.log1p(disagreement)
                    + self.beyond_slope * beyond)
        return alike * alone + (1 - alike) * together

    def slopes(self, views: float, alone: SupportSlopes) -> SupportSlopes:
        """How the support that is needed depends on other numbers of a pose.

        views: as of `needed`. alone: of one view.
        """
        alike = _alike(views)
        together = SupportSlopes(inside=self.inside_slope)
        return SupportSlopes(*(alike * one + (1 - alike) * several
                               for one, several in zip(alone, together, strict=True)))


def _alike(views: float) -> float:
    """From 1 for independent views that are worth one view to 0 for more."""
    return math.exp(-(views - 1) / _ALIKE)


def learned_file(name: str) -> Path:
    """Where a file of `config/learned`, or of PMCL_LEARNED, is; SettingsError without it."""
    chosen = os.environ.get('PMCL_LEARNED')
    tried = [Path(chosen) / name] if chosen else candidates(f'{_FOLDER}/{name}')
    for each in tried:
        if each.exists():
            return each
    raise SettingsError(f'learned numbers: there is no {tried[0]}; reinstall the package, or '
                        'learn them again with pmcl learn --out (docs/concepts/evidence.md)')


def _load(kind: type[T], name: str) -> T:
    return kind.load(learned_file(name))


# Each reads its file once, at the first call; SettingsError names the file, and the field that is
# wrong.
learned_contour = cache(partial(_load, LearnedContour, 'contour.yaml'))
learned_creases = cache(partial(_load, LearnedProfile, 'creases.yaml'))
learned_map = cache(partial(_load, LearnedMap, 'contour_map.yaml'))
learned_map_evidence = cache(partial(_load, LearnedMapEvidence, 'contour_map_evidence.yaml'))
learned_views = cache(partial(_load, LearnedViews, 'views.yaml'))
