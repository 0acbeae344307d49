"""Two layers along a ray, one seen through the other, fitted to all views together.

Two superimposed pictures that move by s + h and s - h px per view step obey one differential
equation of second order: refocused at s, the second-degree part of the views, as functions of
their place, is h^2 times the second derivatives of their mean (Shizawa and Mase 1990; Aach, Mota,
Stuke et al. 2006; on epipolar slices Wanner and Goldluecke 2013). The pictures need not be known.
Least squares over the window, the colours and all views finds s and h far below the separation at
which a cost has two minima (docs/concepts/volume.md).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.layer_fit import LL, NN, OO, REACH, SUMS, fit_rays, window_sums
from pmcl_ros.dlv.layers import Layers
from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.planes import colour_planes
from pmcl_ros.dlv.sampling import SMOOTHER
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.view_moments import TAPS, ViewMoments, refocused_moments
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.errors import VolumeError

_SPACING = 0.2  # px by which the outermost view moves from one refocused depth to the next
_WIDEST = 0.9  # px by which it may move off the middle: there the series has lost a few per cent
_SEPARATIONS = 24  # tried up to that
_MOST_BYTES = 2 ** 30  # of the sums at all depths, which are in memory at once

# Part of the window's pixels whose noise is independent, after the views were smoothed.
_COVARIANCE = np.correlate(SMOOTHER, SMOOTHER, 'full')
_INDEPENDENT = float((_COVARIANCE.max() ** 2 / (_COVARIANCE ** 2).sum()) ** 2)


@dataclass(frozen=True)
class Superposition:
    """The likeliest two layers of each ray; all (height, width) float32.

    near, far: their inverse depths [1/m].
    share: of the contrast (squared) that the nearer one gives; 0.5 where both give the same.
    evidence: log likelihood ratio of two layers to one [nat], minus the penalty of two more
        parameters (Schwarz' criterion); NaN where views miss the ray.
    """

    near: NDArray[np.float32]
    far: NDArray[np.float32]
    share: NDArray[np.float32]
    evidence: NDArray[np.float32]

    def split(self, layers: Layers) -> Layers:
        """`layers` with a single surface split in two where the evidence is positive.

        layers: of two surfaces or more a ray. Likelihood and sharpness are divided by the shares;
        the larger share is the first.
        """
        single = np.isfinite(layers.depths).sum(axis=2) == 1
        chosen = single & (self.evidence > 0)
        depths, likelihood, sharpness = (each.copy() for each in (
            layers.depths, layers.likelihood, layers.sharpness))
        first = np.where(self.share >= 0.5, self.near, self.far)
        second = np.where(self.share >= 0.5, self.far, self.near)
        larger = np.maximum(self.share, 1 - self.share)
        depths[chosen, :2] = 1 / np.stack([first, second], axis=-1)[chosen]
        parts = np.stack([larger, 1 - larger], axis=-1)[chosen]
        for each in (likelihood, sharpness):
            each[chosen, :2] = each[chosen, :1] * parts
        return Layers(depths, likelihood, sharpness)


def fit_superposition(light_field: LightField, settings: DlvSettings) -> Superposition:
    """Fit two layers between the settings' `near` and `far`, for the pixels of their lattice.

    Views, window, crop and stride are the settings'. Raises VolumeError when the views are too few
    or on a line, or the depths shift them out of the image.
    """
    grid = light_field.grid
    lattice = PixelGrid.from_crop(grid.pinhole, settings.crop, settings.stride)
    others = StereoPairs.from_grid(grid, settings.views).indices
    views = StereoPairs(grid, np.vstack([others, [grid.centre]]))
    places = views.positions * [1, grid.pinhole.fy / grid.pinhole.fx]
    light = grid.weights[tuple(views.indices.T)].astype(float)
    moments = ViewMoments.from_places(places, light)
    scale = grid.baseline * grid.pinhole.fx  # px per view step, times m
    reach = np.abs(places).max()
    count = int(np.ceil(scale * (1 / settings.near - 1 / settings.far) * reach / _SPACING)) + 1
    nodes = np.linspace(scale / settings.far, scale / settings.near, max(count, 3))
    shifts = views.shifts(scale / nodes)
    _check_memory(lattice, len(nodes))
    half = settings.window // 2
    sums = _sums(light_field, views, moments, shifts, lattice, half)
    best = (sums[:, OO] + sums[:, LL]).argmin(axis=0)
    rest = np.take_along_axis(sums[:, NN], best[None], axis=0)[0]
    seen = _seen(lattice, shifts, half + REACH + TAPS // 2)
    known = rest[seen] if seen.any() else rest
    independent = _independent(known, 3 * settings.window ** 2)
    # Of the frame, or of the ray where that has more: brighter, or not what its views agree on.
    noise = np.maximum(rest, max(float(np.median(known)), 1e-12)) / (2 * independent)
    separations = np.linspace(0, 2 * _WIDEST / reach, _SEPARATIONS + 1)[1:]
    found = np.empty((4, *best.shape), np.float32)
    fit_rays((sums / noise).astype(np.float32, copy=False), nodes, separations, independent,
             found)
    found[3][~seen] = np.nan
    middle, apart = found[0] / scale, found[1] / scale
    # A fit between two nodes, or two layers about the last one, may lie beyond them.
    near, far = (np.clip(each, 1 / settings.far, 1 / settings.near).astype(np.float32)
                 for each in (middle + apart / 2, middle - apart / 2))
    return Superposition(near, far, found[2], found[3])


def _check_memory(lattice: PixelGrid, depths: int) -> None:
    """Raise VolumeError where the sums at all depths take too much."""
    size = 4 * SUMS * depths * lattice.height * lattice.width // lattice.stride ** 2
    if size > _MOST_BYTES:
        raise VolumeError(f'two layers along {lattice.width}x{lattice.height} px at {depths} '
                          f'depths take {size / 2 ** 30:.1f} GiB, more than '
                          f'{_MOST_BYTES / 2 ** 30:.0f}: choose a larger stride, a smaller crop, '
                          'or layers volume')


def _sums(light_field: LightField, views: StereoPairs, moments: ViewMoments,
          shifts: NDArray[np.float64], lattice: PixelGrid, half: int) -> NDArray[np.float32]:
    """(nodes, SUMS, height, width) of views that are refocused by shifts (views, nodes, 2)."""
    margin = half + REACH
    pad = int(np.ceil(np.abs(shifts).max())) + TAPS + margin
    planes, brightness = colour_planes(light_field, views.indices, pad)
    gain = brightness[-1] / np.maximum(brightness, 1e-6)  # of the centre view, the last
    rows = range(lattice.top - margin, lattice.top + lattice.height + margin)
    columns = range(lattice.left - margin, lattice.left + lattice.width + margin)
    return np.stack([
        window_sums(refocused_moments(planes, pad, each, moments.weights * gain, rows, columns),
                    moments, half, lattice.stride)
        for each in np.moveaxis(shifts, 1, 0)])


def _independent(rest: NDArray[np.float32], values: int) -> float:
    """How many of a window's `values` have noise of their own.

    rest: (rays) sums of twice as many squares, of noise alone. Smoothed and resampled
    noise is correlated: its sums spread like those of fewer (Wilson and Hilferty 1931: cube roots
    of chi-square are normal, of variance 2 / (9 n) for a mean of 1).
    """
    low, middle, high = np.percentile(np.cbrt(rest), [25, 50, 75])
    spread = (high - low) / (1.349 * max(middle, 1e-12))
    return float(np.clip(1 / (9 * max(spread, 1e-3) ** 2), 3, values * _INDEPENDENT))


def _seen(lattice: PixelGrid, shifts: NDArray[np.float64], margin: int) -> NDArray[np.bool_]:
    """(rows, columns) the pixels that, with `margin` px around, no view loses at any depth."""
    x, y = (np.add.outer(each, shifts[..., k].ravel()) for k, each in enumerate(
        (lattice.columns, lattice.rows)))
    whole = lattice.whole
    inside = [(each.min(axis=1) >= margin) & (each.max(axis=1) <= size - 1 - margin)
              for each, size in ((y, whole.height), (x, whole.width))]
    return np.asarray(inside[0][:, None] & inside[1])
