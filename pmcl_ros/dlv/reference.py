"""The cost volume as the paper writes it (section V.A), plainly: what the fast form must equal.

It is also the only form with the paper's phase shift, for the faithful mode: a transform for each
view and label. How it samples does not depend on how the fast form does.
"""

from collections.abc import Callable, Iterator

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from pmcl_ros.dlv.label_segments import LabelSegments
from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.planes import ENCODING, LUMINANCE
from pmcl_ros.dlv.sampling import neutral_taps, smoothed
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.lightfield.light_field import LightField

Sampler = Callable[[NDArray[np.float64]], NDArray[np.floating]]

_BLEND = 32  # px added at least, to lead one border into the opposite: a transform is periodic


def cost_volume(light_field: LightField, depths: NDArray[np.float64],
                settings: DlvSettings) -> NDArray[np.float64]:
    """C(x, l) = beta C_c + (1 - beta) C_g, (labels, height, width) float64.

    depths: (labels,) [m]. height and width are those of the settings' `PixelGrid`. The sums run
    over the views and the window R_x, cut off at the image's border; at a pixel a view counts if
    its samples at all labels lie inside it. Intensities are linear light, clipped to [0, 1] and
    gamma encoded as in a displayed picture, so that the noise of dark and of bright pixels counts
    about alike. Raises VolumeError when no two views have light, the depths shift views out of the
    image, or the crop is not in it.
    """
    wanted = PixelGrid.from_crop(light_field.grid.pinhole, settings.crop, settings.stride)
    half = settings.window // 2 // settings.stride
    lattice = wanted.grown(half)
    total = np.zeros((len(depths), len(lattice.rows), len(lattice.columns)))
    for label, cost in pixel_costs(light_field, depths, settings):
        total[label] += cost[np.ix_(lattice.rows, lattice.columns)]
    rows, columns = wanted.within(lattice)
    return window_sum(total, 2 * half + 1)[:, rows, columns]


def pixel_costs(light_field: LightField, depths: NDArray[np.float64],
                settings: DlvSettings) -> Iterator[tuple[int, NDArray[np.floating]]]:
    """Each view's part of each label's cost, as (label, (height, width)), no window summed.

    It is 0 where a sample of the view lies outside it at any label.
    """
    pairs = StereoPairs.from_grid(light_field.grid, settings.views)
    shifts = pairs.shifts(depths)
    neutral = settings.interpolation == 'neutral'
    runs = LabelSegments.neutral(shifts) if neutral else None
    light = pairs.light if settings.view_weights == 'light' else np.ones(len(pairs.indices))
    centre = _channels_of(light_field, light_field.grid.centre, neutral)
    for pair, (left, right, top, bottom) in enumerate(pairs.inside(depths)):
        view = _channels_of(light_field, pairs.indices[pair], neutral)
        sample = {'bilinear': bilinear, 'phase': phase_shift, 'neutral': tapped}[
            settings.interpolation](view)
        samples = map(sample, shifts[pair]) if runs is None else on_runs(sample, runs, pair)
        inside = np.zeros(view.shape[1:])
        inside[top:bottom, left:right] = light[pair]
        for label, seen in enumerate(samples):
            yield label, inside * _pixel_cost(centre, seen, float(pairs.gamma[pair]), settings)


def _channels_of(light_field: LightField, place: NDArray[np.int64] | tuple[int, int],
                 smooth: bool) -> NDArray[np.float64]:
    row, column = place
    return channels(light_field.views[row, column], smooth)


def _pixel_cost(centre: NDArray[np.floating], view: NDArray[np.floating], gamma: float,
                settings: DlvSettings) -> NDArray[np.floating]:
    difference = np.abs(centre - view)
    order = 2 if settings.color_cost == 'l2' else 1
    colour = np.minimum(np.linalg.norm(difference[:3], order, axis=0), settings.tau_color)
    across, along = np.minimum(difference[3:], settings.tau_gradient)
    gradient = gamma * across + (1 - gamma) * along
    return np.asarray(settings.beta * colour + (1 - settings.beta) * gradient)


def channels(view: NDArray[np.float32], smooth: bool = False) -> NDArray[np.float64]:
    """(5, height, width): red, green, blue in [0, 1], gamma encoded; d/dx, d/dy of luma [1/px].

    view: (height, width, 3), linear. smooth: the colours go through `sampling.SMOOTHER`. The
    luminance is that of the encoded colours; its derivatives are central differences, the border's
    values going on outwards.
    """
    colour = np.clip(view.astype(float), 0, 1) ** ENCODING
    if smooth:
        colour = np.moveaxis(smoothed(np.moveaxis(colour, -1, 0)), 0, -1)
    padded = np.pad(colour @ LUMINANCE.astype(float), 1, mode='edge')
    across = (padded[1:-1, 2:] - padded[1:-1, :-2]) / 2
    along = (padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2
    return np.stack([*np.moveaxis(colour, -1, 0), across, along])


def bilinear(image: NDArray[np.float64]) -> Sampler:
    """Sampler of `image` (channels, height, width) at each pixel plus a displacement (x, y) [px].

    Places outside the image take the value of its nearest edge.
    """
    def sample(shift: NDArray[np.float64]) -> NDArray[np.float64]:
        x = np.clip(np.arange(image.shape[2]) + shift[0], 0, image.shape[2] - 1)
        y = np.clip(np.arange(image.shape[1]) + shift[1], 0, image.shape[1] - 1)[:, None]
        left, top = np.floor(x).astype(int), np.floor(y).astype(int)
        right = np.minimum(left + 1, image.shape[2] - 1)
        bottom = np.minimum(top + 1, image.shape[1] - 1)
        u, v = x - left, y - top
        upper = image[:, top, left] * (1 - u) + image[:, top, right] * u
        lower = image[:, bottom, left] * (1 - u) + image[:, bottom, right] * u
        return np.asarray(upper * (1 - v) + lower * v)
    return sample


def tapped(image: NDArray[np.float64]) -> Sampler:
    """Sampler like `bilinear`, by noise-neutral taps; the image is a smoothed one."""
    height, width = image.shape[1:]

    def sample(shift: NDArray[np.float64]) -> NDArray[np.float64]:
        cell = np.floor(shift).astype(int)
        across, down = neutral_taps(shift - cell)
        rows = [np.clip(np.arange(height) + cell[1] + k, 0, height - 1) for k in range(-1, 3)]
        columns = [np.clip(np.arange(width) + cell[0] + k, 0, width - 1) for k in range(-1, 3)]
        part = np.einsum('k,ckyx->cyx', down, np.stack([image[:, each] for each in rows], axis=1))
        part = np.stack([part[:, :, each] for each in columns], axis=-1)
        return np.asarray(part @ across)
    return sample


def on_runs(sample: Sampler, runs: LabelSegments, pair: int) -> Iterator[NDArray[np.floating]]:
    """Samples of a pair's view at each label, between the three exact ones of the label's run."""
    where = runs.where[runs.where[:, 0] == pair]
    for _, first, end, node in where:
        places = runs.places[node:node + 3]
        begin, middle, last = (sample(place) for place in places)
        for t in runs.time[pair, first:end].astype(float):
            yield ((2 * t - 1) * (t - 1) * begin + 4 * t * (1 - t) * middle
                   + t * (2 * t - 1) * last)


def phase_shift(image: NDArray[np.float64]) -> Sampler:
    """Sampler like `bilinear`, by the shift theorem (Jeon et al. 2015).

    It is exact below the Nyquist frequency, and leaves noise as strong as it is at every
    displacement. Outside the image are its mirrored borders.
    """
    height, width = image.shape[1:]
    periodic = _periodic(_periodic(image).swapaxes(1, 2)).swapaxes(1, 2).astype(np.float32)
    spectrum = scipy.fft.rfft2(periodic)  # single precision is ample and takes half the time
    along = 2j * np.pi * scipy.fft.fftfreq(periodic.shape[1])[:, None]
    across = 2j * np.pi * scipy.fft.rfftfreq(periodic.shape[2])

    def sample(shift: NDArray[np.float64]) -> NDArray[np.float32]:
        phase = (np.exp(shift[1] * along) * np.exp(shift[0] * across)).astype(np.complex64)
        shifted = scipy.fft.irfft2(spectrum * phase, periodic.shape[1:], workers=-1)
        return np.asarray(shifted[:, :height, :width])
    return sample


def _periodic(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Add columns that blend one mirrored border into the other, up to a good transform length."""
    width = image.shape[2]
    added = scipy.fft.next_fast_len(width + _BLEND, real=True) - width
    right = np.pad(image, ((0, 0), (0, 0), (0, added)), mode='symmetric')[:, :, width:]
    left = np.pad(image, ((0, 0), (0, 0), (added, 0)), mode='symmetric')[:, :, :added]
    weight = (1 - np.cos(np.pi * (np.arange(added) + 0.5) / added)) / 2
    return np.concatenate([image, (1 - weight) * right + weight * left], axis=2)


def window_sum(cost: NDArray[np.float64], window: int) -> NDArray[np.float64]:
    """Sum over `window` x `window` pixels around each, cut off at the border; y, x come last."""
    half = window // 2
    height, width = cost.shape[-2:]
    padded = np.pad(cost, [(0, 0)] * (cost.ndim - 2) + [(half, half), (half, half)])
    rows, total = np.zeros_like(padded[..., :height, :]), np.zeros_like(cost)
    for k in range(window):
        rows += padded[..., k:k + height, :]
    for k in range(window):
        total += rows[..., k:k + width]
    return total
