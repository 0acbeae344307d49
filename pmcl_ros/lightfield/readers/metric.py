"""What makes the camera poses of a reconstruction from pictures alone metric."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import LightFieldError

_MOST_NAMES = 8  # in an error


@dataclass(frozen=True)
class Metric:
    """Metres a unit, or the distance between two of the cameras.

    between: names of two pictures and the distance of their cameras [m].
    """

    scale: float | None = None
    between: tuple[str, str, float] | None = None

    @property
    def is_given(self) -> bool:
        """Whether it says anything."""
        return self.scale is not None or self.between is not None

    def metres_per_unit(self, places: Mapping[str, NDArray[np.float64]], source: str) -> float:
        """The scale of cameras at places (3,), by the names of their pictures.

        Raises LightFieldError, which begins with `source`, where nothing is given, or pictures
        that do not tell it.
        """
        if self.scale is not None:
            return self.scale
        if self.between is None:
            raise LightFieldError(f'{source} has no metric scale; give it, or the distance '
                                  'between two cameras (--scale, --distance)')
        first, second, metres = self.between
        missing = [each for each in (first, second) if each not in places]
        if missing:
            raise LightFieldError(f'{source} has no image {" and no ".join(missing)}; it has '
                                  f'{", ".join(sorted(places)[:_MOST_NAMES])}')
        units = float(np.linalg.norm(places[first] - places[second]))
        if not units > 0:
            raise LightFieldError(f'{source}: {first} and {second} were taken at one place; give '
                                  'two others')
        return metres / units
