"""Branch and bound of templates: bounds hold, and the best of all places are found."""

import numpy as np
import pytest

from pmcl_ros.pmcl.proposals.branch_and_bound import (
    MARGIN,
    SQUARE,
    best_places,
    blocks_of,
    strips_of,
    upper_bounds,
)
from pmcl_ros.pmcl.proposals.evidence_maps import Origins, PaddedMaps

TEMPLATES, POINTS, REACH = 7, 12, 9


@pytest.fixture(params=[(17, 22), (8, 8), (1, 5), (13, 1)], ids=str)
def problem(request):
    """Maps, templates, and the sums (templates, rows, columns) of every place, by numpy."""
    rng = np.random.default_rng(0)
    rows, columns = request.param
    row, column = REACH + 3, REACH + 2
    height, width = row + rows + REACH + MARGIN, column + columns + REACH + MARGIN
    maps = rng.integers(-255, 511, (5, height, width)).astype(np.int16)
    offsets = rng.integers(-REACH, REACH + 1, (TEMPLATES, POINTS, 2)).astype(np.int32)
    directions = rng.integers(0, 5, (TEMPLATES, POINTS)).astype(np.uint8)
    y, x = np.meshgrid(np.arange(rows) + row, np.arange(columns) + column, indexing='ij')
    sums = maps[directions[:, :, None, None], y + offsets[:, :, 1, None, None],
                x + offsets[:, :, 0, None, None]].sum(axis=1)
    return maps, (offsets, directions, row, column, rows, columns), sums


def best_in(maps, where, square):
    """Of each template: the best sum in a square, and its place."""
    best, place = np.zeros(TEMPLATES, np.int16), np.zeros(TEMPLATES, np.int32)
    best_places(strips_of(maps), *where, np.arange(TEMPLATES), np.full(TEMPLATES, square), best,
                place)
    return best, place


def bounds_of(maps, where):
    *_, rows, columns = where
    bounds = np.zeros((TEMPLATES, -(-rows // SQUARE) * -(-columns // SQUARE)), np.int16)
    upper_bounds(blocks_of(maps), *where, bounds)
    return bounds


def squares_of(sums):
    """(templates, squares) lists of the sums in each square, with their places."""
    _, rows, columns = sums.shape
    places = np.arange(rows * columns).reshape(rows, columns)
    return [(sums[:, top:top + SQUARE, left:left + SQUARE].reshape(len(sums), -1),
             places[top:top + SQUARE, left:left + SQUARE].ravel())
            for top in range(0, rows, SQUARE) for left in range(0, columns, SQUARE)]


def test_best_places_are_those_of_every_place(problem):
    maps, where, sums = problem
    for square, (each, places) in enumerate(squares_of(sums)):
        best, place = best_in(maps, where, square)
        np.testing.assert_array_equal(best, each.max(axis=1))
        np.testing.assert_array_equal(place, places[each.argmax(axis=1)])


@pytest.mark.parametrize('first', [(-40, -40), (-9, 3), (2, -20), (25, 12), (90, 3)])
def test_around_the_maps_nothing_speaks_either_way(first):
    rng = np.random.default_rng(1)
    maps, around = rng.integers(-255, 511, (5, 14, 19)).astype(np.int16), 150
    offsets = rng.integers(-REACH, REACH + 1, (TEMPLATES, POINTS, 2)).astype(np.int32)
    directions = rng.integers(0, 5, (TEMPLATES, POINTS)).astype(np.uint8)
    padded = np.pad(maps, ((0, 0), (around, around), (around, around)))
    row, column = first
    for square in range(4):
        best, place = best_in(maps, (offsets, directions, row, column, 16, 16), square)
        wanted = best_in(padded, (offsets, directions, row + around, column + around, 16, 16),
                         square)
        np.testing.assert_array_equal(best, wanted[0])
        np.testing.assert_array_equal(place, wanted[1])
    np.testing.assert_array_equal(blocks_of(maps, (around, around), (around, around)),
                                  blocks_of(padded))


@pytest.mark.parametrize('first', [(-20, -31), (-9, 3), (2, -12), (8, 6), (30, 28)], ids=str)
@pytest.mark.parametrize('others', [False, True])
def test_bounds_about_cells_are_those_with_room_all_around(first, others):
    """Whether the maps are of these cells alone, or of those of other depths too."""
    rng = np.random.default_rng(1)
    maps, around = rng.integers(-255, 511, (5, 14, 19)).astype(np.int16), 150
    offsets = rng.integers(-REACH, REACH + 1, (TEMPLATES, POINTS, 2)).astype(np.int32)
    directions = rng.integers(0, 5, (TEMPLATES, POINTS)).astype(np.uint8)
    (top, left), rows, columns = first, 17, 22
    cells = Origins(0.4, 1.0, REACH, np.arange(top, top + rows), np.arange(left, left + columns))
    wider = Origins(0.3, 1.3, REACH + 4, np.arange(-40, 50), np.arange(-40, 60))
    padded = PaddedMaps.around(maps, [wider, cells] if others else [cells])
    blocks, row, column = padded.blocks_about(cells)
    found, wanted = np.zeros((2, TEMPLATES, 9), np.int16)
    upper_bounds(blocks, offsets, directions, row, column, rows, columns, found)
    room = blocks_of(maps, (around, around), (around, around))
    upper_bounds(room, offsets, directions, top + around, left + around, rows, columns, wanted)
    np.testing.assert_array_equal(found, wanted)


def test_no_place_is_better_than_its_bound(problem):
    maps, where, sums = problem
    bounds = bounds_of(maps, where)
    best = np.stack([each.max(axis=1) for each, _ in squares_of(sums)], axis=1)
    assert bounds.shape == best.shape
    assert (bounds >= best).all()


def test_a_bound_is_that_of_the_only_place_where_a_template_fits(problem):
    maps, where, _ = problem
    offsets, directions, row, column, rows, columns = where
    for y, x in np.ndindex(rows, columns):
        only = np.zeros_like(maps)
        only[directions[0], row + y + offsets[0, :, 1], column + x + offsets[0, :, 0]] = 510
        square = y // SQUARE * -(-columns // SQUARE) + x // SQUARE
        assert bounds_of(only, where)[0, square] == 510 * POINTS, (y, x)


def test_a_bound_is_reached_where_places_are_alike(problem):
    maps, where, _ = problem
    flat = np.broadcast_to(maps[:, :1, :1], maps.shape)  # nothing differs between places
    np.testing.assert_array_equal(bounds_of(flat, where)[:, 0], best_in(flat, where, 0)[0])
