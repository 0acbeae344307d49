"""What creases add to the occluding contour: objects searched for with them and without."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pmcl_ros.evaluation.errors import pose_error
from pmcl_ros.evaluation.studies.searches import found
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.learning.contour_tables import Example, Samples, fitted
from pmcl_ros.pmcl.creases import Creases

# Of these the largest likelihood on scenes left out, of 0.003 to 1 by factors of three.
_RIDGE = 0.01
_RIGHT = 0.02, np.deg2rad(10)  # m, rad


def crease_profile(given: Sequence[Samples]) -> ContourProfile:
    """The creases' profile, from mirrored samples: alike on both sides."""
    return fitted(Samples.joined(given), _RIDGE)


@dataclass(frozen=True)
class Result:
    """Of one search. translation [m], rotation [rad]: of the pose found from the true one.

    lost: as the search says.
    """

    translation: float
    rotation: float
    lost: bool

    @property
    def right(self) -> bool:
        """Whether it is the object's pose."""
        return self.translation < _RIGHT[0] and self.rotation < _RIGHT[1]


def with_and_without(example: Example, profile: ContourProfile, seed: int
                     ) -> tuple[Result, Result]:
    """By the contour alone, and by creases of this profile too."""
    without, both = (_result(example, each, seed)
                     for each in (None, Creases.of(example.model, profile)))
    return without, both


def table(results: Sequence[tuple[Result, Result]]) -> Iterator[str]:
    """How often each way is right, how often it is sure and wrong, how far off where both are
    right.
    """
    both = [pair for pair in results if all(each.right for each in pair)]
    for name, number in (('contour', 0), ('and creases', 1)):
        each = [pair[number] for pair in results]
        off = [pair[number] for pair in both]
        wrong = sum(not one.right and not one.lost for one in each)
        yield (f'{name}: right {sum(one.right for one in each)} of {len(each)}, wrong and not '
               f'lost {wrong}; of {len(off)} that both find: '
               + (f'median {1e3 * np.median([one.translation for one in off]):.2f} mm, '
                  f'{np.rad2deg(np.median([one.rotation for one in off])):.2f} deg'
                  if off else 'none'))


def _result(example: Example, creases: Creases | None, seed: int) -> Result:
    estimate = found(example, example.model, ContourProfile.learned(), seed, creases)
    error = pose_error(estimate.pose, example.pose, example.model.axis, example.model.discrete)
    return Result(error.translation, error.rotation, estimate.lost)
