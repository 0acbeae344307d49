"""Compares decoded views with ideal ones: displacement and PSNR of each view."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.errors import FileError, LightFieldError
from pmcl_ros.runtime.npz_file import read_arrays

_MOST_BYTES = 2 ** 29  # of the arrays; a small file may claim any size
_GAMMA = 1 / 2.2  # of the ideal views, and of all that is compared
_SPACING = 3  # view steps between the ideal views of a row
_BLUR = 1.0  # px: the lenslets' sampling resolves little more
_WINDOW = 4.0  # px: the disparity is taken to be level in it
_BORDER = 8  # px left out


@dataclass(frozen=True)
class IdealViews:
    """Views as pinholes on the aperture would see them, lattice-aligned.

    views: (rows, columns, height, width, 3), gamma encoded (1 / 2.2), the centre view in the
        middle.
    steps: (rows, columns, 2) where each looks from, x and y in view steps from the centre view.
    """

    views: NDArray[np.float32]
    steps: NDArray[np.float64]

    @classmethod
    def load(cls, path: Path | str, spacing: float = _SPACING) -> 'IdealViews':
        """Read `views` (rows, columns, height, width, 3) uint16 of an NPZ, `spacing` steps apart.

        Raises LightFieldError when the file holds none.
        """
        try:
            views = read_arrays(path, _MOST_BYTES)['views'] / np.float32(65535)
        except (FileError, KeyError, TypeError) as error:  # TypeError: text
            raise LightFieldError(f'{path} holds no ideal views: {error}') from None
        if views.ndim != 5 or views.shape[4] != 3 or not all(n % 2 for n in views.shape[:2]):
            raise LightFieldError(
                f'{path}: views of shape {views.shape}, expected (rows, columns, height, width, '
                '3) with a centre view in the middle')
        rows, columns = views.shape[:2]
        b, a = np.mgrid[:rows, :columns].astype(float)
        return cls(views, spacing * np.stack([a - columns // 2, b - rows // 2], axis=-1))

    def disparity(self) -> NDArray[np.float64]:
        """(height, width) px that a point of the centre view moves for each view step.

        Least squares over all views in a window around each pixel, about the estimate before.
        """
        rows, columns = self.views.shape[:2]
        clean = gaussian_filter(self.views.mean(axis=-1), (0, 0, _BLUR, _BLUR))
        centre = clean[rows // 2, columns // 2]
        down, across = np.gradient(centre)
        y, x = np.indices(centre.shape).astype(float)
        found = np.zeros(centre.shape)
        for _ in range(4):
            top = bottom = np.full(centre.shape, 1e-9)
            for row, column in np.ndindex(rows, columns):
                a, b = self.steps[row, column]
                slope = a * across + b * down
                moved = _read(clean[row, column], x + a * found, y + b * found)
                top = top + slope * (centre - moved)
                bottom = bottom + slope ** 2
            found = found + (gaussian_filter(top, _WINDOW) / gaussian_filter(bottom, _WINDOW))
        return np.asarray(found)


@dataclass(frozen=True)
class ViewError:
    """A decoded view against the ideal one at its nominal place.

    place: row and column in the light field. position: (2,) its centre of light [view steps].
    shift: (2,) px that it is displaced, x and y, by least squares.
    expected: (2,) px that it should be, as it looks from `position`.
    psnr: dB after a blur and a gain for each colour, where it is. psnr_there: against the ideal
        view moved to where `position` says.
    """

    place: tuple[int, int]
    position: NDArray[np.float64]
    shift: NDArray[np.float64]
    expected: NDArray[np.float64]
    psnr: float
    psnr_there: float

    @property
    def residual(self) -> float:
        """Length of the displacement that the position does not explain [px]."""
        return float(np.linalg.norm(self.shift - self.expected))


def compare_views(light_field: LightField, ideal: IdealViews) -> list[ViewError]:
    """The errors of the views that `ideal` has; a lattice-aligned light field.

    Both are gamma encoded and blurred by 1 px. A point moves by its disparity for each view step:
    the ideal view of another position is that of the nominal one, moved by the difference.
    Raises LightFieldError when the light field has no such views.
    """
    rows, columns = light_field.grid.shape
    row0, column0 = light_field.grid.centre
    found = []
    disparity = ideal.disparity()
    for at in np.ndindex(*ideal.views.shape[:2]):
        a, b = ideal.steps[at]
        row, column = round(row0 + b), round(column0 + a)
        if not (0 <= row < rows and 0 <= column < columns
                and light_field.grid.weights[row, column] > 0):
            raise LightFieldError(f'the light field has no view ({row}, {column}) to compare')
        view = light_field.views[row, column]
        if view.shape != ideal.views[at].shape:
            raise LightFieldError(f'views of {view.shape} cannot be compared with ideal ones of '
                                  f'{ideal.views[at].shape}')
        position = light_field.grid.positions[row, column]
        clean = _blurred(ideal.views[at])
        # In a view at (a, b) the disparity of the centre view's pixel is found displaced by it.
        y, x = np.indices(disparity.shape).astype(float)
        there = _read(disparity, x - a * disparity, y - b * disparity)
        down, across = np.gradient(clean, axis=(0, 1))
        da, db = position - (a, b)
        moved = clean - there[..., None] * (da * across + db * down)
        seen = _blurred(np.clip(view, 0, None) ** np.float32(_GAMMA))
        found.append(ViewError(
            (row, column), position, _displacement(clean, seen), _displacement(clean, moved),
            _psnr(clean, seen), _psnr(moved, seen)))
    return found


def table(errors: Sequence[ViewError]) -> str:
    """A row for each view."""
    lines = ['view   looks from      shift x      y   expected x      y   residual   PSNR    '
             'PSNR there',
             '      [view steps]        [px]                [px]              [px]    [dB]       '
             ' [dB]']
    for each in errors:
        (x, y), (u, v), (s, t) = each.position, each.shift, each.expected
        lines.append(f'{each.place[0]} {each.place[1]}  {x:+6.2f} {y:+6.2f}   {u:+8.3f} {v:+6.3f}'
                     f'   {s:+9.3f} {t:+6.3f} {each.residual:10.3f} {each.psnr:6.1f} '
                     f'{each.psnr_there:11.1f}')
    return '\n'.join(lines)


def _blurred(view: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.asarray(gaussian_filter(np.asarray(view, float), (_BLUR, _BLUR, 0)))


def _read(image: NDArray[np.floating], x: NDArray[np.floating],
          y: NDArray[np.floating]) -> NDArray[np.float64]:
    """An image at points (pixels), linear between them, constant beyond the border."""
    return np.asarray(map_coordinates(np.asarray(image, float), [y, x], order=1, mode='nearest'))


def _displacement(clean: NDArray[np.floating],
                  seen: NDArray[np.floating]) -> NDArray[np.float64]:
    """(2,) px x and y by which `seen`, brought to the brightness of `clean`, is displaced."""
    down, across = np.gradient(clean, axis=(0, 1))
    slopes = np.stack([_inner(across).ravel(), _inner(down).ravel()], axis=1)
    error = _inner(clean - seen * _gain(clean, seen))
    return np.asarray(np.linalg.lstsq(slopes, error.ravel(), rcond=None)[0])


def _psnr(clean: NDArray[np.floating], seen: NDArray[np.floating]) -> float:
    error = _inner(clean - seen * _gain(clean, seen))
    return float(-10 * np.log10(max(np.mean(error ** 2), 1e-20)))


def _gain(clean: NDArray[np.floating], seen: NDArray[np.floating]) -> NDArray[np.float64]:
    """(3,) that brings the colours of `seen` closest to `clean`."""
    clean, seen = _inner(clean), _inner(seen)
    return np.asarray((clean * seen).sum(axis=(0, 1)) / (seen ** 2).sum(axis=(0, 1)))


def _inner(image: NDArray[np.floating]) -> NDArray[np.floating]:
    return image[_BORDER:-_BORDER, _BORDER:-_BORDER]
