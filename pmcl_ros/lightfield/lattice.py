"""The hexagonal lattice of the lenslets' centres on the sensor."""

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmcl_ros.settings import Settings


class Lattice(Settings):
    """centre(i, j) = centre_px + R(rotation) [(i + (j mod 2) / 2) pitch_px, j row_step_px].

    Raw pixels as (column, row), 0-based, pixel centres at integers; i and j may be negative.
    """

    pitch_px: float = Field(gt=2, lt=100, description='distance of two lenslets of a row [raw px]')
    row_step_px: float = Field(gt=2, lt=100,
                               description='distance of two rows of lenslets [raw px]')
    rotation: float = Field(
        gt=-0.5, lt=0.5,
        description='from the +x axis of the sensor to the rows, towards +y [rad]')
    centre_px: tuple[float, float] = Field(description='centre of lenslet (0, 0) [raw px]')

    def centres(self, i: NDArray[np.integer], j: NDArray[np.integer]) -> NDArray[np.float64]:
        """(..., 2) raw pixels (column, row) of the centres of lenslets (i, j)."""
        along = (i + np.mod(j, 2) / 2) * self.pitch_px
        across = j * self.row_step_px
        cos, sin = np.cos(self.rotation), np.sin(self.rotation)
        return np.stack([self.centre_px[0] + cos * along - sin * across,
                         self.centre_px[1] + sin * along + cos * across], axis=-1)

    def index_range(self, width: int, height: int) -> tuple[int, int, int, int]:
        """i0, i1, j0, j1, ends excluded: all lenslets that reach onto a sensor of this size."""
        corners = np.array([[x, y] for x in (0, width) for y in (0, height)])
        cos, sin = np.cos(self.rotation), np.sin(self.rotation)
        along, across = np.array([[cos, sin], [-sin, cos]]) @ (corners - self.centre_px).T
        i, j = along / self.pitch_px, across / self.row_step_px
        return (int(np.floor(i.min())) - 2, int(np.ceil(i.max())) + 2,
                int(np.floor(j.min())) - 2, int(np.ceil(j.max())) + 2)
