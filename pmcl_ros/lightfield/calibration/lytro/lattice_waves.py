"""The lattice of lenslets as three waves in a raw frame: find them, measure them tile by tile.

A hexagonal lattice of discs is, to lowest order, a sum of three plane waves, whose frequencies
b0, b0 + b1, b1 (b0, b1: the reciprocal lattice) give pitch, row step and rotation, and whose
phases give the places of the discs. The phases of a window are exact where the scene is smooth,
degrade gradually elsewhere, and need no detection of single discs.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from pmcl_ros.runtime.errors import LightFieldError

_HEXAGON = np.sqrt(3) / 2  # row step of a regular lattice, in pitches
_BLUR = 12.0  # raw px: sigma of the local mean while the pitch is not known yet
_FAINT = 0.005  # of the sensor's range: light below it is noise
_BLOCK = 256  # raw px: side of the blocks whose spectra are averaged
_PITCHES = np.geomspace(5.5, 22, 350)  # raw px, searched
_ROTATIONS = np.linspace(-0.15, 0.15, 76)  # rad, searched
# Power of the three waves relative to the spectrum between them: about 1 without lenslets.
_LEAST_POWER = 10.0


@dataclass(frozen=True)
class Tiles:
    """Phasors of the three waves in each of n square tiles of the frame.

    centres: (n, 2) raw px (column, row).
    phasors: (3, n) complex: amplitude, and phase as if the origin were raw pixel (0, 0).
    side: raw px.
    """

    centres: NDArray[np.float64]
    phasors: NDArray[np.complex128]
    side: int
    rows: int
    columns: int


def local_contrast(light: NDArray[np.float32], blur: float = _BLUR) -> NDArray[np.float32]:
    """(height, width) in [-1, 1]: how much brighter than around it each pixel is.

    light: (height, width) mosaic, 0 at black, 1 at white. blur: raw px, sigma of the local mean.
    Relative to the local mean of its own phase of the mosaic: colours, illumination and vignetting
    cancel.
    """
    relative = np.zeros_like(light)
    for row, column in np.ndindex(2, 2):
        phase = np.ascontiguousarray(light[row::2, column::2])
        mean = cv2.GaussianBlur(phase, (0, 0), blur / 2, borderType=cv2.BORDER_REFLECT)
        relative[row::2, column::2] = (phase - mean) / (np.maximum(mean, 0) + np.float32(_FAINT))
    return np.clip(relative, -1, 1)


def find_lattice(contrast: NDArray[np.float32]) -> tuple[float, float]:
    """Pitch [raw px] and rotation [rad] of the lattice, to about 1 % of a pitch each.

    contrast: of `local_contrast`. The place in the mean power spectrum of blocks where all three
    waves are strongest (by their geometric mean) is sought among pitches of 5.5 to 22 px and
    rotations up to 0.15 rad. Raises LightFieldError when they stand out nowhere.
    """
    block = min(_BLOCK, *contrast.shape)
    rows, columns = contrast.shape[0] // block, contrast.shape[1] // block
    blocks = contrast[:rows * block, :columns * block].reshape(rows, block, columns, block)
    window = np.hanning(block + 1)[:block].astype(np.float32)
    blocks = (blocks - contrast.mean()) * (window[:, None, None] * window)
    spectrum = scipy.fft.rfft2(blocks, axes=(1, 3), workers=2)
    power = np.log((np.abs(spectrum) ** 2).mean(axis=(0, 2)) + np.finfo(np.float32).tiny)
    power = scipy.fft.fftshift(power, axes=0)  # row block // 2: no waves along y
    pitch, rotation = np.meshgrid(_PITCHES, _ROTATIONS, indexing='ij')
    frequencies = wave_frequencies(pitch, pitch * _HEXAGON, rotation)
    # A real signal has each wave at f and at -f; the half spectrum holds the one of x >= 0.
    x, y = np.moveaxis(frequencies * np.where(frequencies[..., :1] < 0, -1, 1), -1, 0) * block
    strength = map_coordinates(power, [y + block // 2, x], order=1, mode='nearest').mean(axis=-1)
    best = np.unravel_index(strength.argmax(), strength.shape)
    found = np.hypot(x, y)[best].mean()
    radius = np.hypot(np.arange(block)[:, None] - block // 2, np.arange(power.shape[1]))
    between = np.median(power[(radius > 0.75 * found) & (radius < 1.3 * found)])
    excess = float(np.exp(min(strength[best] - between, 50)))
    if excess < _LEAST_POWER:
        raise LightFieldError(
            f'no lattice of lenslets: the strongest hexagonal pattern of 5.5 to 22 px has '
            f'{excess:.1f} times the power of its surroundings, expected more than '
            f'{_LEAST_POWER:g}; is this a raw picture of a light-field camera, neither dark nor '
            'saturated?')
    return float(pitch[best]), float(rotation[best])


def wave_frequencies(pitch: NDArray[np.floating] | float, row_step: NDArray[np.floating] | float,
                     rotation: NDArray[np.floating] | float) -> NDArray[np.float64]:
    """(..., 3, 2) cycles per raw px (x, y) of the three waves of a lattice: b0, b0 + b1, b1."""
    pitch, row_step, rotation = np.broadcast_arrays(pitch, row_step, rotation)
    along = np.stack([1 / pitch, 1 / pitch, 0 / pitch], axis=-1)
    across = np.stack([-0.5 / row_step, 0.5 / row_step, 1 / row_step], axis=-1)
    cos, sin = np.cos(rotation)[..., None], np.sin(rotation)[..., None]
    return np.stack([cos * along - sin * across, sin * along + cos * across], axis=-1)


def measure_tiles(contrast: NDArray[np.float32], frequencies: NDArray[np.float64],
                  side: int) -> Tiles:
    """The three waves in each tile of `side` px, seen through a Hann window.

    frequencies: (3, 2) of `wave_frequencies`.
    """
    height, width = contrast.shape
    rows, columns = height // side, width // side
    top, left = (height - rows * side) // 2, (width - columns * side) // 2
    inner = contrast[top:top + rows * side, left:left + columns * side]
    window = np.hanning(side + 2)[1:-1]
    steps = np.arange(side) - (side - 1) / 2
    x, y = np.meshgrid(left + (side - 1) / 2 + side * np.arange(columns),
                       top + (side - 1) / 2 + side * np.arange(rows))
    centres = np.stack([x, y], axis=-1).reshape(-1, 2)
    waves = window[:, None, None] * np.exp(-2j * np.pi * steps[:, None, None] * frequencies)
    ex = np.moveaxis(waves[..., 0], 0, -1)  # (3, side)
    ey = np.moveaxis(waves[..., 1], 0, -1)
    parts = np.concatenate([ex.real, ex.imag]).astype(np.float32)
    lines = (inner.reshape(-1, side) @ parts.T).reshape(rows, side, columns, 2, 3)
    sums = lines[..., 0, :] + 1j * lines[..., 1, :]
    phasors = np.einsum('rscw,ws->wrc', sums, ey).reshape(3, -1) / window.sum() ** 2
    return Tiles(centres, phasors * np.exp(-2j * np.pi * frequencies @ centres.T), side, rows,
                 columns)


def beat(tiles: Tiles, wave: int) -> NDArray[np.float64]:
    """(2,) cycles per px by which a wave's true frequency differs from the one it was measured at.

    From the turn of its phase from tile to tile: the peak of the spectrum of the tiles' phasors,
    which tiles of random phase do not move. Unambiguous up to half a cycle per tile.
    """
    phasors = tiles.phasors[wave].reshape(tiles.rows, tiles.columns)
    size = np.abs(phasors)
    phasors = phasors / (size + np.median(size) + np.finfo(np.float32).tiny)
    padded = 16 * max(phasors.shape)
    spectrum = np.abs(scipy.fft.fft2(phasors, (padded, padded)))
    peak = np.unravel_index(spectrum.argmax(), spectrum.shape)
    cycles = [_vertex(np.take(spectrum, peak[axis] + np.arange(-1, 2), axis, mode='wrap')
                      [(slice(None), peak[1]) if axis == 0 else (peak[0], slice(None))],
                      int(peak[axis])) / padded for axis in (1, 0)]
    return (np.mod(np.array(cycles) + 0.5, 1) - 0.5) / tiles.side


def _vertex(values: NDArray[np.floating], middle: int) -> float:
    """Where the parabola through three values about `middle` is highest."""
    bend = values[0] - 2 * values[1] + values[2]
    return middle + float((values[0] - values[2]) / (2 * bend)) if bend < 0 else float(middle)
