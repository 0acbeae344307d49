"""A folder of view pictures in a grid, with a YAML file that gives the geometry."""

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.light_field import LightField, nominal_positions
from pmcl_ros.lightfield.readers.pictures import Bits, Reduction
from pmcl_ros.lightfield.readers.view_files import ViewFiles
from pmcl_ros.runtime.errors import LightFieldError, told_as
from pmcl_ros.runtime.settings import Settings

# Of the Stanford Light Field Archive's rectified grids: out_RR_CC_Y_X.png, or with one more _
# before the dot: row, column and the camera's place in an unknown unit.
STANFORD_NAMES = re.compile(r'out_(?P<row>\d+)_(?P<column>\d+)_(?P<y>[-+]?\d+(?:\.\d+)?)'
                            r'_(?P<x>[-+]?\d+(?:\.\d+)?)_?\.(?:png|jpg)', re.IGNORECASE)
STANFORD_HINT = """its files are called as the Stanford archive's, but their names give positions
without a unit, and no focal length; write {name} there with `files: stanford`, `fx`,
`focus_distance` (the depth of the plane they were rectified to) and `unit` (metres of one
unit) or `baseline` (metres between neighbouring views)""".replace('\n', ' ')


NAME = 'light_field.yaml'
_PICTURES = ('.png', '.jpg', '.jpeg', '.tif', '.tiff', '.bmp', '.webp', '.ppm')
_MOST_VIEWS = 999  # of a row or a column
_MOST_DOUBTFUL = 4  # the time of matching a name may grow as its length to this power
_PARTS = {'row': r'\d+', 'column': r'\d+', 'x': r'[-+]?\d+(?:\.\d+)?', 'y': r'[-+]?\d+(?:\.\d+)?'}


class GridSettings(Settings):
    """light_field.yaml: which files are the views, and their geometry.

    Rows go down and columns to the right, as seen from behind the cameras.
    """

    files: str = Field('*', min_length=1, description='names of the pictures: a pattern such as '
                       'view*.png, sorted and row by row; or with {row} and {column} (and {x}, '
                       '{y}, where it was taken) in place of numbers; or stanford')
    rows: int | None = Field(None, ge=1, le=999, description='rows of views; needed where the '
                             'names have no {row}')
    columns: int | None = Field(None, ge=1, le=999, description='columns of views; needed where '
                                'the names have no {column}')
    fx: float = Field(gt=1, lt=1e6, description='focal length [px]')
    fy: float | None = Field(None, gt=1, lt=1e6, description='focal length [px]; default: fx')
    cx: float | None = Field(None, description='principal point of the centre view, column [px]; '
                             'default: the middle')
    cy: float | None = Field(None, description='principal point of the centre view, row [px]; '
                             'default: the middle')
    baseline: float | None = Field(None, gt=0, lt=1e3,
                                   description='between views of neighbouring columns [m]')
    baseline_y: float | None = Field(None, gt=0, lt=1e3, description='between views of '
                                     'neighbouring rows [m]; default: baseline')
    unit: float | None = Field(None, gt=0, lt=1e3, description='of {x} and {y} [m]')
    positions: list[tuple[float, float]] | None = Field(
        None, description='x and y of every view, row by row [m]')
    flip_x: bool = Field(False, description='columns, and x, go to the left')
    flip_y: bool = Field(False, description='rows, and y, go up')
    focus_distance: float = Field(math.inf, gt=0, allow_inf_nan=True, description='depth that '
                                  'has no disparity [m]; .inf: the views are rectified')
    gamma: float = Field(2.2, ge=0.1, le=10, description='exponent that makes the values of the '
                         'files linear; 1: they are')
    bits: Bits = 16

    @model_validator(mode='after')
    def _one_scale(self) -> 'GridSettings':
        given = [name for name in ('baseline', 'unit', 'positions')
                 if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError('give one of baseline, unit (of the x and y in the names) and '
                             f'positions, not {" and ".join(given) or "none"}')
        return self


def read_folder(yaml: Path, header: Header, reduction: Reduction) -> LightField:
    """The light field that a light_field.yaml describes; its pictures lie beside it.

    Raises SettingsError or LightFieldError saying which file or value is wrong.
    """
    of = GridSettings.load(yaml)
    names, found = _views(yaml, of)
    paths = [[yaml.parent / name for name in row] for row in names]
    files = ViewFiles(paths, _positions(of, found, yaml), of.fx, of.fy or of.fx, of.cx, of.cy,
                      of.focus_distance, of.gamma, of.bits)
    with told_as(LightFieldError, name=yaml):
        return files.read(header, reduction)


def _views(yaml: Path, of: GridSettings) -> tuple[list[list[str]], NDArray[np.float64]]:
    """The names [row][column] of the views, and (rows, columns, 2) the x, y in them, or NaN."""
    folder = yaml.parent
    present = [path.name for path in folder.iterdir()
               if path.suffix.lower() in _PICTURES and path.is_file()]
    pattern = STANFORD_NAMES if of.files == 'stanford' else _pattern(of.files, yaml)
    matches = [match for match in map(pattern.fullmatch, present) if match]
    if {'row', 'column'} <= pattern.groupindex.keys():
        return _numbered(folder, of, matches)
    if of.rows is None or of.columns is None:
        raise LightFieldError(f'{yaml}: rows and columns are needed, as the names '
                              f'{of.files!r} have no {{row}} and {{column}}')
    if len(matches) != of.rows * of.columns:
        raise LightFieldError(
            f'{folder} has {len(matches)} pictures called {of.files!r}, {of.rows} rows of '
            f'{of.columns} columns need {of.rows * of.columns}')
    names = sorted((match.string for match in matches), key=_natural)
    grid = [names[row * of.columns:(row + 1) * of.columns] for row in range(of.rows)]
    return grid, np.full((of.rows, of.columns, 2), np.nan)


def _numbered(folder: Path, of: GridSettings,
              matches: list[re.Match[str]]) -> tuple[list[list[str]], NDArray[np.float64]]:
    places: dict[tuple[int, int], re.Match[str]] = {}
    for match in matches:
        place = int(match['row']), int(match['column'])
        if place in places:
            raise LightFieldError(f'{folder} has two pictures of row {place[0]}, column '
                                  f'{place[1]}: {places[place].string} and {match.string}')
        places[place] = match
    if not places:
        raise LightFieldError(f'{folder} has no picture called {of.files!r}')
    top, bottom = (end(row for row, _ in places) for end in (min, max))
    left, right = (end(column for _, column in places) for end in (min, max))
    if max(bottom - top, right - left) >= _MOST_VIEWS:
        odd = places[max(places, key=lambda place: max(place[0] - top, place[1] - left))].string
        raise LightFieldError(f'{folder}: the names {of.files!r} give rows {top} to {bottom}, '
                              f'columns {left} to {right}, more than {_MOST_VIEWS}: does {odd} '
                              'belong there?')
    if len(places) < (bottom - top + 1) * (right - left + 1):
        row, column = next(
            (row, column) for row in range(top, bottom + 1) for column in range(left, right + 1)
            if (row, column) not in places)
        missing = (bottom - top + 1) * (right - left + 1) - len(places)
        raise LightFieldError(f'{folder} has no picture of row {row}, column {column}; {missing} '
                              f'are missing in rows {top} to {bottom}, columns {left} to {right}')
    rows, columns = bottom - top + 1, right - left + 1
    if (of.rows or rows, of.columns or columns) != (rows, columns):
        raise LightFieldError(f'{folder} has {rows} rows of {columns} views, {NAME} says '
                              f'{of.rows} of {of.columns}')
    ordered = [[places[top + row, left + column] for column in range(columns)]
               for row in range(rows)]
    found = np.array([[[float(each.groupdict().get(axis) or 'nan') for axis in 'xy']
                       for each in row] for row in ordered])
    return [[each.string for each in row] for row in ordered], found


def _positions(of: GridSettings, found: NDArray[np.float64],
               yaml: Path) -> NDArray[np.float64]:
    """(rows, columns, 2) [m], x to the right and y down."""
    rows, columns = found.shape[:2]
    named = np.isfinite(found).all()
    if of.positions is not None:
        if len(of.positions) != rows * columns:
            raise LightFieldError(f'{yaml}: {len(of.positions)} positions for {rows} rows of '
                                  f'{columns} views; give one for each')
        positions = np.array(of.positions).reshape(rows, columns, 2)
    elif of.unit is not None:
        if not named:
            raise LightFieldError(f'{yaml}: unit is given, but the names {of.files!r} have no '
                                  '{x} and {y}; give baseline instead')
        positions = found * of.unit
    else:
        assert of.baseline is not None
        positions = nominal_positions(rows, columns) * [of.baseline, of.baseline_y or of.baseline]
        if named and columns > 1 and of.baseline_y is None:
            step = abs(np.diff(found[..., 0], axis=1).mean())
            if not step > 0:
                raise LightFieldError(f'{yaml}: x is the same in the names of all columns')
            positions = found * (of.baseline / step)
    return np.asarray(positions * [-1 if of.flip_x else 1, -1 if of.flip_y else 1])


def _pattern(names: str, yaml: Path) -> re.Pattern[str]:
    """Regular expression of a pattern with *, {row}, {column}, {x}, {y}; else LightFieldError."""
    expression, before, doubtful = '', '', 0
    for part in re.split(r'(\{\w*\}|\*+)', names):
        # How much a star, and a part right after another one, takes is tried out.
        doubtful += part[:1] == '*' or (part[:1] == '{' and before[:1] in ('{', '*'))
        before = part or before
        if part.startswith('{'):
            name = part[1:-1]
            if name not in _PARTS or f'(?P<{name}>' in expression:
                raise LightFieldError(f'{yaml}: files {names!r}: {part} is not known or is there '
                                      'twice; known are {row}, {column}, {x}, {y}')
            expression += f'(?P<{name}>{_PARTS[name]})'
        else:
            expression += '.*' if part[:1] == '*' else re.escape(part)
    if doubtful > _MOST_DOUBTFUL:
        raise LightFieldError(f'{yaml}: files {names!r}: more than {_MOST_DOUBTFUL} of * and of '
                              'parts without anything between them; write more of the names')
    return re.compile(expression)


def _natural(name: str) -> list[tuple[int, str]]:
    """Sort key by numbers: view_2 before view_10."""
    return [(int(part), '') if part.isdigit() else (-1, part)
            for part in re.split(r'(\d+)', name)]
