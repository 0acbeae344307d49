"""NPZ files as `pmcl decode` writes them."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.colour import Colour
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.lightfield.readers.pictures import MOST_BYTES, Reduction
from pmcl_ros.runtime.errors import FileError, LightFieldError, told_as
from pmcl_ros.runtime.npz_file import read_arrays
from pmcl_ros.runtime.outputs import replacing

_MOST_BYTES = MOST_BYTES + 2 ** 20  # of all arrays: views, and few numbers
_REAL = 'fiu'  # kinds of numbers
_NEEDED = ('views', 'fx', 'fy', 'cx', 'cy', 'baseline')
_LEVEL = 1  # of zlib: numpy's 6 takes seven times as long on views and saves 5 % of the file


def write_npz(path: Path | str, light_field: LightField) -> None:
    """Write `views`, `fx`, `fy`, `cx`, `cy`, `baseline`, `weights`, `positions`, compressed.

    For display it adds `gamma`, and `gains` and `matrix` of `Colour`.
    """
    grid, colour = light_field.grid, light_field.colour
    pinhole = grid.pinhole
    save_npz(path, views=light_field.views, fx=pinhole.fx, fy=pinhole.fy, cx=pinhole.cx,
             cy=pinhole.cy, baseline=grid.baseline, weights=grid.weights,
             positions=grid.positions, gamma=light_field.gamma, gains=colour.gains,
             matrix=colour.matrix)


def save_npz(path: Path | str, **arrays: ArrayLike) -> None:
    """Like `numpy.savez_compressed`, for large arrays of measured light: quick to write.

    Raises OutputError when that is impossible.
    """
    with (replacing(path) as part,
          zipfile.ZipFile(part, 'w', zipfile.ZIP_DEFLATED, compresslevel=_LEVEL) as file):
        for name, values in arrays.items():
            with file.open(f'{name}.npy', 'w', force_zip64=True) as stream:
                np.lib.format.write_array(stream, np.asarray(values), allow_pickle=False)


def read_npz(path: Path, header: Header, reduction: Reduction) -> LightField:
    """The inverse of `write_npz`.

    Optional: weights (default: 1), positions (default: one step apart), gamma, gains and matrix.
    Raises LightFieldError when a value is missing or of another shape or type.
    """
    with told_as(LightFieldError, FileError):
        arrays = read_arrays(path, _MOST_BYTES)
    with told_as(LightFieldError, name=path):
        missing = [name for name in _NEEDED if name not in arrays]
        if missing:
            raise LightFieldError(f'it has no {", ".join(missing)}; expected views, fx, fy, cx, '
                                  'cy, baseline (as `pmcl decode` writes where it is given a '
                                  '--calibration)')
        return _light_field(arrays, header, reduction)


def _light_field(file: dict[str, NDArray[Any]], header: Header, reduction: Reduction
                 ) -> LightField:
    views = file['views']
    if views.ndim != 5 or views.shape[-1] != 3 or views.dtype.kind != 'f':
        raise LightFieldError(
            f'views are {views.dtype} of shape {views.shape}; expected floating point, linear '
            'light, of shape (rows, columns, height, width, 3)')
    rows, columns, height, width = views.shape[:4]
    weights = file['weights'] if 'weights' in file else np.ones((rows, columns))
    positions = file['positions'] if 'positions' in file else nominal_positions(rows, columns)
    if weights.shape != (rows, columns) or positions.shape != (rows, columns, 2) or (
            weights.dtype.kind + positions.dtype.kind).strip(_REAL):
        raise LightFieldError(f'weights {weights.dtype} {weights.shape} and positions '
                              f'{positions.dtype} {positions.shape} do not match {rows}x{columns} '
                              'views')
    numbers = [_number(file, name) for name in _NEEDED[1:]]
    pinhole = reduction.pinhole(Pinhole(width, height, *numbers[:4]))
    kept = tuple(slice(side[0], None, reduction.every)  # no copies: views may be large
                 for side in (reduction.kept(rows), reduction.kept(columns)))
    views = views[kept]
    reduction.check_memory(*views.shape[:4])
    if reduction.shrink > 1:
        views = np.stack([[reduction.shrunk(np.asarray(view, np.float32)) for view in row]
                          for row in views])
    views = np.ascontiguousarray(views, np.float32)
    grid = ViewGrid(pinhole, numbers[4] * reduction.every,
                    positions[kept].astype(float) / reduction.every,
                    weights[kept].astype(np.float32))
    shown = {'gamma': _number(file, 'gamma')} if 'gamma' in file else {}
    return LightField(header, views, grid, **shown, colour=_colour(file))


def _colour(file: dict[str, NDArray[Any]]) -> Colour:
    if 'gains' not in file or 'matrix' not in file:
        return Colour()
    gains, matrix = file['gains'], file['matrix']
    if (gains.shape, matrix.shape) != ((3,), (3, 3)) or (
            gains.dtype.kind + matrix.dtype.kind).strip(_REAL) or not (
            np.isfinite(gains).all() and np.isfinite(matrix).all()):
        raise LightFieldError(f'gains {gains.tolist()} and matrix {matrix.tolist()} must be 3 and '
                              '3x3 numbers')
    red, green, blue = gains.tolist()
    return Colour((red, green, blue), tuple((a, b, c) for a, b, c in matrix.tolist()))


def _number(file: dict[str, NDArray[Any]], name: str) -> float:
    value = file[name]
    if value.size != 1 or value.dtype.kind not in _REAL:
        raise LightFieldError(f'{name} is {value.dtype} of shape {value.shape}; expected a number')
    return float(value.reshape(()))
