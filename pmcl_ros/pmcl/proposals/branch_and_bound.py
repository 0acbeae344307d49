"""Places where templates fit best, by branch and bound: the same as by trying every place.

The sum of a template's points, each at its best of four by four neighbouring places, is at most
too high for all of these places. Squares of places whose bound is below the sums that have been
found already are left out (correlative scan matching with maps of several resolutions: Olson 2015;
Hess et al. 2016).
"""

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pmcl_ros.runtime.kernels import borrowed, compiled, rounds

SQUARE = 8  # cells, the side of a square: in each the best place of a template is told
BLOCK = 4  # cells, the side of places that share a bound; half of a square
MARGIN = BLOCK - 1  # cells that maps have to hold beyond the last that a template reaches


def blocks_of(maps: NDArray[np.int16], rows: tuple[int, int] = (0, 0),
              columns: tuple[int, int] = (0, 0)) -> NDArray[np.int16]:
    """The greatest of 4x4 cells from each cell on: what bounds are summed from.

    maps: (directions, rows, columns). rows, columns: of zeros before and after these. Returns
    (directions, 4, 4, rows / 4, columns / 4), rounded up: the cells' last two bits of row and
    column first, so that every fourth cell is beside the next. Cells beyond the last count as the
    least number.
    """
    ones = np.ones((BLOCK, BLOCK), np.uint8)
    least = np.iinfo(np.int16).min
    number, height, width = maps.shape
    height, width = height + sum(rows), width + sum(columns)
    down, along = -(-height // BLOCK), -(-width // BLOCK)
    blocks = np.empty((number, BLOCK, BLOCK, down, along), np.int16)
    for each, into in zip(maps, blocks, strict=True):
        greatest = np.pad(cv2.dilate(np.pad(each, (rows, columns)), ones, anchor=(0, 0)),
                          ((0, -height % BLOCK), (0, -width % BLOCK)), constant_values=least)
        into[:] = greatest.reshape(down, BLOCK, along, BLOCK).transpose(1, 3, 0, 2)
    return blocks


@compiled(parallel=True)
def upper_bounds(blocks, offsets, directions,  # type: ignore[no-untyped-def]
                 row, column, rows, columns, greatest, portion):
    """Fill greatest (templates, squares): no place of the square has a greater sum.

    blocks: of `blocks_of`. offsets: (templates, points, 2) whole cells, x and y; a multiple of
    four points. directions: (templates, points) which map. row, column: the first place. Squares
    are row-major.
    """
    count, points = directions.shape
    width = blocks.shape[4]
    lines = borrowed(blocks.reshape(len(blocks) * BLOCK * BLOCK, -1))
    down, along = -(-rows // BLOCK), -(-columns // BLOCK)
    length = (down - 1) * width + along
    across = -(-columns // SQUARE)
    squares = greatest.shape[1]
    for n in rounds(count, portion):
        y, x = row + offsets[n, :, 1], column + offsets[n, :, 0]
        line = (directions[n] * BLOCK + y % BLOCK) * BLOCK + x % BLOCK
        starts = y // BLOCK * width + x // BLOCK
        total = np.zeros(length, np.int16)
        # Whole rows are added, one after the other, with what lies between the places: long loops
        # without branches.
        for p in range(0, points, 4):
            a = lines[line[p], starts[p]:starts[p] + length]
            b = lines[line[p + 1], starts[p + 1]:starts[p + 1] + length]
            c = lines[line[p + 2], starts[p + 2]:starts[p + 2] + length]
            d = lines[line[p + 3], starts[p + 3]:starts[p + 3] + length]
            for i in range(length):
                total[i] += a[i] + b[i] + c[i] + d[i]
        for k in range(squares):
            top, left = k // across * 2, k % across * 2
            greatest[n, k] = total[top * width + left]
            for r in range(top, min(top + 2, down)):
                for c in range(left, min(left + 2, along)):
                    greatest[n, k] = max(greatest[n, k], total[r * width + c])


def strips_of(maps: NDArray[np.int16]) -> NDArray[np.int16]:
    """Eight cells from each on, down: so a square is one run.

    maps: (directions, rows, columns); around them cells count as 0, `SQUARE` of them on each side
    are in the strips (directions, rows + 9, columns + 16, 8).
    """
    padded = np.pad(maps, ((0, 0), (SQUARE, SQUARE), (SQUARE, SQUARE)))
    return np.ascontiguousarray(sliding_window_view(padded, SQUARE, axis=1))


@compiled(parallel=True)
def best_places(strips, offsets, directions,  # type: ignore[no-untyped-def]
                row, column, rows, columns, templates, squares, best, place, portion):
    """Of pairs (n,) of a template and a square: best sum there, and its place (row-major).

    strips: of `strips_of`. row, column: the first place in their maps; the rest as of
    `upper_bounds`. Templates may lie outside of the maps.
    """
    count, points = len(templates), directions.shape[1]
    height, width = strips.shape[1:3]
    lowest, rightmost = height - 1, width - SQUARE
    run = borrowed(strips.reshape(-1))
    across = -(-columns // SQUARE)
    for n in rounds(count, portion):
        which = templates[n]
        top, left = squares[n] // across * SQUARE, squares[n] % across * SQUARE
        y, x = row + top + offsets[which, :, 1], column + left + offsets[which, :, 0]
        # All squares outside of the maps are alike.
        y = np.minimum(np.maximum(y + SQUARE, 0), lowest)
        x = np.minimum(np.maximum(x + SQUARE, 0), rightmost)
        starts = ((directions[which] * height + y) * width + x) * SQUARE
        total = np.zeros(SQUARE * SQUARE, np.int16)
        for p in range(0, points, 4):
            a = run[starts[p]:starts[p] + SQUARE * SQUARE]
            b = run[starts[p + 1]:starts[p + 1] + SQUARE * SQUARE]
            c = run[starts[p + 2]:starts[p + 2] + SQUARE * SQUARE]
            d = run[starts[p + 3]:starts[p + 3] + SQUARE * SQUARE]
            for i in range(SQUARE * SQUARE):
                total[i] += a[i] + b[i] + c[i] + d[i]
        best[n] = total[0]
        place[n] = top * columns + left
        for r in range(min(SQUARE, rows - top)):
            for k in range(min(SQUARE, columns - left)):
                if total[k * SQUARE + r] > best[n]:
                    best[n] = total[k * SQUARE + r]
                    place[n] = (top + r) * columns + left + k
