"""The cost volume and its likelihood, fast: views to likelihoods in one sweep.

While a view's displacement stays within about a pixel its samples are quadratics in the label's
disparity: exactly, if they are bilinear and stay in a cell of the pixel grid, and nearly so if
they are noise-neutral (`sampling`). The view is sampled at three nodes; the three coefficients
through them, for each pixel and channel, serve all the labels of the run: two multiplications each
instead of a sample (`row_costs`). Each thread goes down a band of rows and keeps those of one
window, so no costs but a caller's are ever in memory. `reference` is the plain form.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.label_segments import LabelSegments
from pmcl_ros.dlv.likelihood import row_likelihood
from pmcl_ros.dlv.pairs import StereoPairs, cost_weights
from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.planes import HALO, matching_planes
from pmcl_ros.dlv.row_costs import LANES, aligned_zeros, coefficient_count, row_costs
from pmcl_ros.dlv.sampling import TAPS
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.window_sums import sum_across, sum_down
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.kernel_threads import threads
from pmcl_ros.runtime.kernels import compiled, rounds

_NONE = np.empty((0, 0, 0), np.float32)


@dataclass(frozen=True)
class CostInputs:
    """Inputs of the costs: planes, pixels, samples and weights of each pair of views.

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
    def from_light_field(cls, light_field: LightField, depths: NDArray[np.float64],
                         settings: DlvSettings) -> 'CostInputs':
        """depths: (labels,) [m], monotone.

        Raises VolumeError when no two views have light, the depths shift views out of the image,
        or the crop is not in it.
        """
        pairs = StereoPairs.from_grid(light_field.grid, settings.views)
        shifts = pairs.shifts(depths)
        neutral = settings.interpolation == 'neutral'
        weights = cost_weights(pairs.gamma, settings.beta)
        if settings.view_weights == 'light':
            weights *= pairs.light[:, None]
        limits = weights * [settings.tau_color, settings.tau_gradient, settings.tau_gradient]
        wanted = PixelGrid.from_crop(light_field.grid.pinhole, settings.crop, settings.stride)
        half = settings.window // 2 // settings.stride
        lattice = wanted.grown(half)
        left, top, width, height = _reached(lattice, int(np.ceil(np.abs(shifts).max())))
        # A pair counts where its samples lie inside the image: only their taps reach out of it.
        planes = matching_planes(light_field, pairs.indices, (left, top, width, height), neutral)
        return cls(planes, (lattice.left - left + TAPS, lattice.top - top + TAPS),
                   LabelSegments.neutral(shifts) if neutral else LabelSegments.bilinear(shifts),
                   weights.astype(np.float32), limits.astype(np.float32),
                   _within(pairs.inside(depths), lattice), wanted, lattice, half)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Labels, rows and columns of the costs of `lattice`."""
        return self.runs.time.shape[1], len(self.lattice.rows), len(self.lattice.columns)


def cost_volume(light_field: LightField, depths: NDArray[np.float64],
                settings: DlvSettings) -> NDArray[np.float32]:
    """C(x, l) of the paper's section V.A, (labels, height, width) float32.

    depths: (labels,) [m], monotone. height and width are those of the settings' `PixelGrid`. The
    values are those of `reference.cost_volume`; interpolation 'phase' has no fast form. Needs time
    in proportion to views, labels and pixels. Raises VolumeError when no two views have light, the
    depths shift views out of the image, or the crop is not in it.
    """
    task = CostInputs.from_light_field(light_field, depths, settings)
    cost = np.empty((len(depths), *task.wanted.shape), np.float32)
    _run(task, settings, cost, _NONE)
    return cost


def likelihood_volume(light_field: LightField, depths: NDArray[np.float64],
                      settings: DlvSettings) -> NDArray[np.float32]:
    """L(x, l) = `log_likelihood` of the cost volume, (height, width, labels) float32.

    It is the more exact for not rounding the costs. Arguments and errors: as `cost_volume`.
    """
    return likelihood_of(CostInputs.from_light_field(light_field, depths, settings), settings)


def likelihood_of(task: CostInputs, settings: DlvSettings) -> NDArray[np.float32]:
    """The likelihood volume of a task made with the same settings."""
    likelihood = np.empty((*task.wanted.shape, task.shape[0]), np.float32)
    _run(task, settings, _NONE, likelihood)
    return likelihood


def _run(task: CostInputs, settings: DlvSettings, cost: NDArray[np.float32],
         likelihood: NDArray[np.float32]) -> None:
    lattice, runs = task.lattice, task.runs
    rows, columns = task.wanted.within(lattice)
    labels, _, width = task.shape
    bands, margin = threads(), -(-task.half // LANES) * LANES
    # A row's costs for each thread, with zeros around for the windows to reach into.
    single = aligned_zeros(bands, labels + 1, -(-width // LANES) * LANES + 2 * margin)
    quadratics = aligned_zeros(bands, coefficient_count(width))
    _sweep(task.planes, runs.where, runs.cells, runs.taps, runs.time, task.weights,
           task.limits, task.inside, *task.corner, lattice.stride,
           settings.color_cost == 'l2', task.half, task.shape[1:], (rows.start, rows.stop),
           (columns.start, columns.stop), quadratics, margin, single, cost, likelihood)


@compiled(parallel=True)
def _sweep(planes, where, cells, taps, time, weights,  # type: ignore[no-untyped-def]
           limits, inside, left, top, stride, l2, half, size, rows, columns, quadratics,
           margin, single, cost, likelihood, portion):
    """Fill `cost` or `likelihood`, of which the other is empty, a band of rows for each thread."""
    labels, (height, width) = time.shape[1], size
    reach = 2 * half + 1
    count, bands = rows[1] - rows[0], len(single)
    for band in rounds(bands, portion):
        first, end = rows[0] + count * band // bands, rows[0] + count * (band + 1) // bands
        across = np.zeros((reach, labels + 1, columns[1] - columns[0]), np.float32)
        summed = np.empty((labels + 1, columns[1] - columns[0]), np.float32)
        for row in range(first - half, end + half):
            sums = across[(row + reach) % reach]
            if 0 <= row < height:
                row_costs(planes, where, cells, taps, time, weights, limits, inside, left, top,
                          stride, l2, row, width, quadratics[band], margin, single[band])
                sum_across(single[band], margin - half + columns[0], reach, sums)
            else:
                sums[:] = 0
            done = row - half
            if done < first:
                continue
            sum_down(across, row + 1, summed)
            if len(likelihood):
                row_likelihood(summed[:labels], summed[labels], likelihood[done - rows[0]])
            else:
                for label in range(labels):
                    cost[label, done - rows[0]] = summed[labels] + summed[label]


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
