"""The sums under lenslets, against the same sums written pixel by pixel."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.lightfield.lenslets import Lenslets, sum_lenslets

WIDTH, HEIGHT = 30, 32
RADIUS = 5.0
V, U = np.indices((HEIGHT, WIDTH))
# Red is on odd rows and columns, blue on even ones (BGGR).
COLOURS = np.where((V + U) % 2 == 1, 1, np.where(V % 2 == 1, 0, 2))
LATTICE = Lattice(pitch_px=9.95, row_step_px=8.62, rotation=0.1, centre_px=(15.3, 14.8))
AT = st.tuples(st.floats(-8, WIDTH + 7), st.floats(-8, HEIGHT + 7))
INSIDE = st.tuples(st.floats(8, WIDTH - 9), st.floats(8, HEIGHT - 9))


def all_views(half):
    return np.argwhere(np.ones((2 * half + 1, 2 * half + 1), bool))


def sums(counts, centres, half=4, black=0, scale=1.0, views=None, factors=None):
    """(rows, n, 3, columns) of `sum_lenslets`."""
    views = all_views(half) if views is None else views
    centres = np.asarray(centres, float).reshape(1, -1, 2) if np.ndim(centres) < 3 else centres
    rows, columns = centres.shape[:2]
    out = np.full((rows, len(views), 3, columns), np.nan, np.float32)
    factors = np.ones_like(out) if factors is None else factors
    sum_lenslets(counts, black, Lenslets((0, 0), centres, RADIUS), views, half, factors, scale,
                 out)
    return out


def tents(centre, half):
    """(n, 3, height, width) w m of every pixel, for each view and colour."""
    x, y = centre
    square = (U - x) ** 2 + (V - y) ** 2
    part = np.clip(0.5 + (RADIUS ** 2 - square) / (2 * RADIUS), 0, 1)
    found = []
    for row, column in all_views(half):
        weight = (np.clip(2 - abs(U - x - column + half), 0, None)
                  * np.clip(2 - abs(V - y - row + half), 0, None)) / 4
        found.append([weight * part * (k == COLOURS) / (2 if k == 1 else 1) for k in range(3)])
    return np.array(found)


@settings(max_examples=60, deadline=None)
@given(st.lists(AT, min_size=1, max_size=40), st.integers(0, 5), st.integers(0, 400),
       st.integers(0, 2**32 - 1))
def test_the_sums_are_those_written_pixel_by_pixel(centres, half, black, seed):
    counts = np.random.default_rng(seed).integers(0, 4096, (HEIGHT, WIDTH)).astype(np.uint16)
    found = sums(counts, centres, half, black, 1 / 4096)[0]
    for k in {0, len(centres) // 2, len(centres) - 1}:
        expected = np.einsum('nkvu,vu->nk', tents(centres[k], half),
                             (counts - float(black)) / 4096)
        np.testing.assert_allclose(found[:, :, k], expected, atol=3e-5)


def test_long_rows_of_lenslets_are_summed_alike():
    rng = np.random.default_rng(3)
    counts = rng.integers(0, 4096, (HEIGHT, WIDTH)).astype(np.uint16)
    centres = rng.uniform(2, 28, (3, 901, 2))
    whole = sums(counts, centres)
    for k in (0, 300, 450, 451, 900):
        np.testing.assert_allclose(whole[..., k:k + 1], sums(counts, centres[:, k:k + 1]),
                                   rtol=1e-5, atol=1e-2)


def test_factors_and_chosen_views():
    rng = np.random.default_rng(4)
    counts = rng.integers(0, 4096, (HEIGHT, WIDTH)).astype(np.uint16)
    views = all_views(4)[[3, 40, 77]]
    centres = rng.uniform(2, 28, (2, 5, 2))
    factors = rng.uniform(0.5, 2, (2, 3, 3, 5)).astype(np.float32)
    found = sums(counts, centres, views=views, factors=factors)
    expected = sums(counts, centres)[:, [3, 40, 77]] * factors
    np.testing.assert_allclose(found, expected, rtol=1e-5)


@settings(max_examples=30, deadline=None)
@given(INSIDE)
def test_only_the_lenslets_own_disc_is_read(centre):
    distance = np.hypot(U - centre[0], V - centre[1])
    neighbours = np.where(distance > RADIUS + 0.5, 4095, 0).astype(np.uint16)
    assert not sums(neighbours, [centre]).any()
    edge = np.where(distance > RADIUS - 0.4, 4095, 0).astype(np.uint16)
    assert (sums(edge, [centre])[0, [0, 8, 72, 80]] > 0).any()


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(0, 60)] * 3), st.tuples(*[st.floats(0, 40)] * 3), INSIDE)
def test_linear_functions_are_reproduced_where_all_around_is_in_the_disc(across, down, centre):
    planes = np.array(across)[COLOURS] * U + np.array(down)[COLOURS] * V
    counts = np.rint(planes).astype(np.uint16)
    inner = all_views(4)
    inner = inner[np.hypot(*(inner - 4).T) <= RADIUS - 0.5 - 2 * np.sqrt(2)]
    assert len(inner) >= 9
    found = sums(counts, [centre], views=inner)[0, :, :, 0]
    place = inner[:, ::-1] - 4 + np.array(centre)
    expected = np.outer(place[:, 0], across) + np.outer(place[:, 1], down)
    np.testing.assert_allclose(found, expected, atol=0.51)


@settings(max_examples=30, deadline=None)
@given(st.floats(-40, 10), st.floats(20, 70), st.floats(-40, 10), st.floats(20, 70))
def test_a_block_covers_the_corners_of_all_cells(left, right, top, bottom):
    block = Lenslets.covering(LATTICE, left, right, top, bottom)
    x, y = np.meshgrid(np.linspace(left, right, 23), np.linspace(top, bottom, 23))
    places = np.stack([x, y], axis=-1).reshape(-1, 2)
    j0, i0 = block.origin
    rows, columns = block.shape
    j, i = np.meshgrid(np.arange(j0 - 4, j0 + rows + 4), np.arange(i0 - 4, i0 + columns + 4),
                       indexing='ij')
    more = cKDTree(LATTICE.centres(i, j).reshape(-1, 2)).query(places, k=3)[0]
    own = cKDTree(block.centres.reshape(-1, 2)).query(places, k=3)[0]
    np.testing.assert_allclose(own, more)


@settings(max_examples=30, deadline=None)
@given(st.lists(INSIDE, min_size=1, max_size=20))
def test_the_nearest_lenslet(places):
    block = Lenslets.covering(LATTICE, 0, WIDTH, 0, HEIGHT)
    found = block.centres[tuple(block.nearest(LATTICE, np.array(places)).T)]
    distance = np.hypot(*(found - places).T)
    best = cKDTree(block.centres.reshape(-1, 2)).query(places)[0]
    np.testing.assert_allclose(distance, best)


def test_counts_of_an_odd_width_are_no_mosaic():
    with pytest.raises(ValueError, match=r'divisor|compatible|multiple'):
        sums(np.zeros((8, 7), np.uint16), [[3.0, 3.0]])
