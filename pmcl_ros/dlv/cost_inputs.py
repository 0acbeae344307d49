"""What is to be matched: all that a back end needs to make a cost volume."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.label_segments import LabelSegments
from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.planes import HALO, matching_planes
from pmcl_ros.dlv.sampling import TAPS
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.lightfield.light_field import LightField


@dataclass(frozen=True)
class CostInputs:
    """The pictures, the pixels, and how each pair of views is sampled and counts.

    planes: of `matching_planes`, of the part of the views that is needed; the centre's, then those
        of each pair.
    corner: x and y of the lattice's first pixel in the planes [px].
    weights: (pairs, 3) float32, of colour, x and y gradient. They are folded into the coefficients
        and the truncations, `limits` (pairs, 3) float32.
    inside: (pairs, 4) int64, first column, one past the last, first row, one past the last of the
        pixels of `lattice` for which a pair counts.
    wanted: the pixels that get a volume. lattice: these and `half` a window, in its steps, around.
    """

    planes: NDArray[np.float32]
    corner: tuple[int, int]
    runs: LabelSegments
    weights: NDArray[np.float32]
    limits: NDArray[np.float32]
    inside: NDArray[np.int64]
    wanted: PixelGrid
    lattice: PixelGrid
    half: int

    @classmethod
    def of(cls, light_field: LightField, depths: NDArray[np.float64], settings: DlvSettings
           ) -> 'CostInputs':
        """depths: (labels,) [m], monotone.

        Raises VolumeError when no two views have light, the depths shift views out of the image,
        or the crop is not in it.
        """
        pairs = StereoPairs.of(light_field.grid, settings.views)
        shifts = pairs.shifts(depths)
        neutral = settings.interpolation == 'neutral'
        gradient = 1 - settings.beta
        weights = np.stack([np.full_like(pairs.gamma, settings.beta), gradient * pairs.gamma,
                            gradient * (1 - pairs.gamma)], axis=1)
        if settings.view_weights == 'light':
            weights *= pairs.light[:, None]
        limits = weights * [settings.tau_color, settings.tau_gradient, settings.tau_gradient]
        wanted = PixelGrid.of(light_field.grid.pinhole, settings.crop, settings.stride)
        half = settings.window // 2 // settings.stride
        lattice = wanted.grown(half)
        left, top, width, height = _reached(lattice, int(np.ceil(np.abs(shifts).max())))
        # A pair counts where its samples lie inside the image: only their taps reach out of it.
        planes = matching_planes(light_field, pairs.indices, (left, top, width, height), TAPS,
                                 neutral)
        return cls(planes, (lattice.left - left + TAPS, lattice.top - top + TAPS),
                   LabelSegments.neutral(shifts) if neutral else LabelSegments.bilinear(shifts),
                   weights.astype(np.float32), limits.astype(np.float32),
                   _within(pairs.inside(depths), lattice), wanted, lattice, half)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Labels, rows and columns of the costs of `lattice`."""
        return self.runs.time.shape[1], len(self.lattice.rows), len(self.lattice.columns)


def _reached(lattice: PixelGrid, shift: int) -> tuple[int, int, int, int]:
    """Left, top, width, height [px] of the part of a view that the lattice's pixels, displaced by
    up to `shift` px, are made from."""
    reach = shift + TAPS + HALO
    left, top = max(lattice.left - reach, 0), max(lattice.top - reach, 0)
    right = min(lattice.left + lattice.width + reach, lattice.whole.width)
    bottom = min(lattice.top + lattice.height + reach, lattice.whole.height)
    return left, top, right - left, bottom - top


def _within(inside: NDArray[np.int64], lattice: PixelGrid) -> NDArray[np.int64]:
    """Ranges of x and y [px] as ranges of columns and rows of the lattice."""
    corner = np.repeat([lattice.left, lattice.top], 2)
    ends = np.repeat([len(lattice.columns), len(lattice.rows)], 2)
    return np.clip(-(-(inside - corner) // lattice.stride), 0, ends)
