"""Where edges lie at each depth: the structure tensor of the views refocused at every label.

A second layer behind glass pulls the likelihood of a contour's rays towards itself; the energy of
an edge that is sharp when refocused at its own depth stays where the edge is (docs/method.md).
"""

import cv2
import numpy as np
import scipy.fft
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume, EdgeVolume
from pmcl_ros.errors import VolumeError
from pmcl_ros.kernels import LOCK, compiled
from pmcl_ros.lightfield.geometry import ViewGrid
from pmcl_ros.lightfield.light_field import LightField

_SIGMA = 0.8  # px: the smoothing before the derivative, about what the lenslets' sampling left
_NEIGHBOURHOOD = 12.0  # px: contrast is measured against that of this neighbourhood
_PAD = 16  # px: mirrored border: the transform's period puts one border's content at the other
_CHANNELS = 64  # labels that are blurred at once: OpenCV 5 takes no more than 128


def edge_volume(light_field: LightField, depths: NDArray[np.floating],
                views: int = 7) -> EdgeVolume:
    """The edge volume of the inner `views` x `views` views.

    depths: (labels,) [m], far to near, uniform in inverse depth.

    The views (gamma encoded, brought to the centre view's mean) are summed at each label in the
    Fourier domain, where a sub-pixel shift is a phase and treats noise alike at every label (Jeon
    et al. 2015); smoothing and derivatives are factors there too. The tensor is divided by its own
    mean over a neighbourhood plus its median over the image and the labels.
    Raises VolumeError when no view has light.
    """
    grid = light_field.grid
    chosen = _inner(grid, views)
    pinhole = grid.pinhole
    spectra, frequency_y, frequency_x = _spectra(light_field, chosen)
    # A point at depth z is seen displaced by -f B a / z: view a is sampled so far away.
    steps = grid.positions[chosen] * [-pinhole.fx * grid.baseline, -pinhole.fy * grid.baseline]
    across = _phases(steps[:, 0], depths, frequency_x)
    down = _phases(steps[:, 1], depths, frequency_y)
    with LOCK:
        refocused = _refocus(spectra.real.copy(), spectra.imag.copy(), down, across)
    tensor = np.empty((pinhole.height, pinhole.width, len(depths), 3), np.float32)
    for label, spectrum in enumerate(refocused):
        gx = _derivative(spectrum, frequency_x, pinhole.width + 2 * _PAD)
        gy = _derivative(spectrum, frequency_y[:, None], pinhole.width + 2 * _PAD)
        with LOCK:
            _outer(gx, gy, _PAD, label, tensor)
    return EdgeVolume(light_field.header, _normalise(tensor), np.asarray(depths, float), pinhole)


def _inner(grid: ViewGrid, views: int) -> NDArray[np.bool_]:
    """(rows, columns) mask of the inner views that have light."""
    row, column = grid.centre
    rows, columns = np.ogrid[:grid.shape[0], :grid.shape[1]]
    half = views // 2
    chosen = (abs(rows - row) <= half) & (abs(columns - column) <= half) & (grid.weights > 0)
    if not chosen.any():
        raise VolumeError(f'none of the inner {views}x{views} views has light: the pupil weights '
                          f'are {grid.weights.tolist()}')
    return chosen


def _spectra(light_field: LightField, chosen: NDArray[np.bool_]) -> tuple[
        NDArray[np.complex64], NDArray[np.float32], NDArray[np.float32]]:
    """(views, 3, ky, kx) spectra of the chosen views, smoothed, and their frequencies [rad/px]."""
    gamma = np.float32(light_field.gamma)
    views = np.clip(light_field.views[chosen], 0, 1) ** gamma
    brightness = views.mean(axis=(1, 2, 3), keepdims=True)
    centre = np.clip(light_field.centre_view, 0, 1) ** gamma
    views = views * centre.mean() / np.maximum(brightness, 1e-6)
    border = (_PAD, _PAD)
    padded = np.pad(views, ((0, 0), border, border, (0, 0)), mode='reflect').astype(np.float32)
    spectra = scipy.fft.rfft2(np.moveaxis(padded, -1, 1), axes=(-2, -1), workers=2)
    frequency_y = (2 * np.pi * scipy.fft.fftfreq(padded.shape[1])).astype(np.float32)
    frequency_x = (2 * np.pi * scipy.fft.rfftfreq(padded.shape[2])).astype(np.float32)
    square = frequency_y[:, None] ** 2 + frequency_x ** 2
    smooth = np.exp(-0.5 * _SIGMA ** 2 * square) / len(views)
    return spectra * smooth.astype(np.float32), frequency_y, frequency_x


def edges_from_likelihood(volume: DepthLikelihoodVolume, labels: int = 25) -> EdgeVolume:
    """An edge volume from a likelihood alone, for readers that were given nothing else.

    A pixel's likelihood stands out from its mean over the labels where there is something to
    match, that is at edges, and most at their depth: the square of that, measured against the
    neighbourhood, takes the energy's place. It knows no directions and is as coarse as the window
    R_x, so its contour evidence is about half of the refocused energy's.
    labels: about so many at most, evenly chosen.
    """
    step = max(1, round(len(volume.depths) / labels))
    likelihood = volume.likelihood[:, :, ::step]
    likelihood = np.maximum(likelihood - likelihood.mean(axis=2, keepdims=True), 0)
    mean = likelihood.mean(axis=2)
    around = cv2.GaussianBlur(mean, (0, 0), _NEIGHBOURHOOD) + np.median(mean)
    energy = (likelihood / np.maximum(around, 1e-12)[..., None]) ** 2
    tensor = np.zeros((*energy.shape, 3), np.float32)
    tensor[..., 0] = tensor[..., 1] = energy
    return EdgeVolume(volume.header, tensor, volume.depths[::step], volume.pinhole)


def _phases(steps: NDArray[np.float64], depths: NDArray[np.floating],
            frequency: NDArray[np.float32]) -> NDArray[np.float32]:
    """(labels, views, frequencies, 2) real and imaginary part of a shift by steps / depth."""
    angle = (steps / depths[:, None])[..., None] * frequency
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1).astype(np.float32)


def _derivative(spectrum: NDArray[np.complex64], frequency: NDArray[np.float32],
                width: int) -> NDArray[np.float32]:
    """(3, y, x) the derivative of a picture along the axis of `frequency`, from its spectrum."""
    size = spectrum.shape[1], width
    return scipy.fft.irfft2(spectrum * (1j * frequency), size, axes=(-2, -1), workers=2)


@compiled(parallel=True)
def _refocus(real, imaginary, down, across):  # type: ignore[no-untyped-def]
    """(labels, 3, ky, kx) complex64: the sum of the shifted views, at every label.

    Row by row, so that a row of all the views' spectra stays near the core for all labels.
    """
    views, channels, height, width = real.shape
    labels = down.shape[0]
    out = np.empty((labels, channels, height, width), np.complex64)
    for y in prange(height):
        sum_real = np.empty((channels, width), np.float32)
        sum_imaginary = np.empty((channels, width), np.float32)
        for label in range(labels):
            sum_real[:] = 0
            sum_imaginary[:] = 0
            for v in range(views):
                c, s = down[label, v, y, 0], down[label, v, y, 1]
                for x in range(width):
                    p = c * across[label, v, x, 0] - s * across[label, v, x, 1]
                    q = c * across[label, v, x, 1] + s * across[label, v, x, 0]
                    for k in range(3):
                        a, b = real[v, k, y, x], imaginary[v, k, y, x]
                        sum_real[k, x] += a * p - b * q
                        sum_imaginary[k, x] += a * q + b * p
            for k in range(channels):
                for x in range(width):
                    out[label, k, y, x] = complex(sum_real[k, x], sum_imaginary[k, x])
    return out


@compiled(parallel=True)
def _outer(gx, gy, pad, label, tensor):  # type: ignore[no-untyped-def]
    """Sum of the channels' gradient products, the padding cut off, into tensor[:, :, label]."""
    height, width = tensor.shape[:2]
    for y in prange(height):
        for x in range(width):
            xx = yy = xy = np.float32(0)
            for k in range(gx.shape[0]):
                a, b = gx[k, y + pad, x + pad], gy[k, y + pad, x + pad]
                xx += a * a
                yy += b * b
                xy += a * b
            tensor[y, x, label, 0] = xx
            tensor[y, x, label, 1] = yy
            tensor[y, x, label, 2] = xy


def _normalise(tensor: NDArray[np.float32]) -> NDArray[np.float32]:
    energy = tensor[..., 0] + tensor[..., 1]
    around = np.empty_like(energy)
    for first in range(0, energy.shape[2], _CHANNELS):
        some = np.s_[:, :, first:first + _CHANNELS]
        around[some] = cv2.GaussianBlur(energy[some], (0, 0), _NEIGHBOURHOOD).reshape(
            energy[some].shape)
    return tensor / np.maximum(around + np.median(energy), 1e-12)[..., None]
