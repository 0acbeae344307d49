"""Resampling against the barycentric coordinates of the three lenslets that are nearest."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from pmcl_ros.lightfield.lattice import Lattice
from pmcl_ros.lightfield.resample import resample_views

WIDTH, HEIGHT = 12, 9
LATTICES = st.builds(
    lambda pitch, ratio, rotation, x, y: Lattice(
        pitch_px=pitch, row_step_px=ratio * pitch, rotation=rotation, centre_px=(x, y)),
    st.floats(8, 12), st.floats(0.84, 0.9), st.floats(-0.49, 0.49), st.floats(-50, 150),
    st.floats(-50, 150))
# Of equilateral triangles: those of the nearest three lenslets.
REGULAR = LATTICES.map(lambda lattice: lattice.model_copy(
    update={'row_step_px': np.sqrt(0.75) * lattice.pitch_px}))
SHIFTS = np.array([[0, 0], [0.7, -1.3], [-2, 2]])


def lenslets(lattice, more=6):
    """The origin (j0, i0) and the centres of lenslets on and `more` of them around the sensor."""
    i0, i1, j0, j1 = lattice.index_range(10 * WIDTH, 10 * HEIGHT)
    i, j = np.meshgrid(np.arange(i0 - more, i1 + more), np.arange(j0 - more, j1 + more))
    return (j0 - more, i0 - more), lattice.centres(i, j)


def places(shift):
    """(HEIGHT, WIDTH, 2) raw px where a view of that shift is read."""
    y, x = np.indices((HEIGHT, WIDTH))
    return np.stack([10 * (x + shift[0]) + 4.5, 10 * (y + shift[1]) + 4.5], axis=-1)


def interpolated(centres, values, place):
    """Values at places (..., 2), by the barycentric coordinates of the nearest three centres."""
    nearest = cKDTree(centres.reshape(-1, 2)).query(place, k=3)[1]
    corners = centres.reshape(-1, 2)[nearest]  # (..., corner, 2)
    ones = np.ones((*place.shape[:-1], 3, 1))
    equations = np.concatenate([corners, ones], axis=-1).swapaxes(-1, -2)
    right = np.concatenate([place, ones[..., 0, :]], axis=-1)
    weights = np.linalg.solve(equations, right[..., None])
    return (weights * values.reshape(-1, values.shape[-1])[nearest]).sum(axis=-2)


@settings(max_examples=40, deadline=None)
@given(LATTICES, st.tuples(st.floats(-2, 2), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)))
def test_linear_functions_are_reproduced(lattice, slopes):
    level, across, down = slopes
    origin, centres = lenslets(lattice)
    values = level + across * centres[..., 0] + down * centres[..., 1]
    samples = np.stack([values, 2 * values, 1 - values], axis=-1)
    samples = np.repeat(samples[None], 3, axis=0).astype(np.float32)
    views = resample_views(samples, lattice, origin, WIDTH, HEIGHT, SHIFTS)
    assert views.dtype == np.float32
    for view, shift in zip(views, SHIFTS, strict=True):
        place = places(shift)
        expected = level + across * place[..., 0] + down * place[..., 1]
        expected = np.stack([expected, 2 * expected, 1 - expected], axis=-1)
        np.testing.assert_allclose(view, expected, atol=1e-4)


@settings(max_examples=40, deadline=None)
@given(REGULAR, st.integers(0, 2**32 - 1))
def test_a_pixel_is_interpolated_in_its_triangle_of_nearest_lenslets(lattice, seed):
    origin, centres = lenslets(lattice)
    samples = np.random.default_rng(seed).random((3, *centres.shape[:2], 3), np.float32)
    views = resample_views(samples, lattice, origin, WIDTH, HEIGHT, SHIFTS)
    for view, sample, shift in zip(views, samples, SHIFTS, strict=True):
        np.testing.assert_allclose(view, interpolated(centres, sample, places(shift)), atol=1e-4)


@settings(max_examples=40, deadline=None)
@given(REGULAR, st.integers(0, 2**32 - 1), st.floats(0.05, 0.95))
def test_lenslets_without_light_count_for_nothing(lattice, seed, dark):
    rng = np.random.default_rng(seed)
    origin, centres = lenslets(lattice)
    lit = rng.random(centres.shape[:2]) > dark
    samples = rng.random((*lit.shape, 3), np.float32)
    samples[~lit, rng.integers(0, 3)] = np.nan  # one colour is enough
    view = resample_views(samples[None], lattice, origin, WIDTH, HEIGHT, SHIFTS[:1])[0]
    values = np.concatenate([np.where(lit[..., None], samples, 0), lit[..., None]], axis=-1)
    found = interpolated(centres, values, places(SHIFTS[0]))
    colour, weight = np.split(found, [3], axis=-1)
    expected = np.where(weight > 0.2, colour / np.maximum(weight, 0.1), 0)
    clear = np.abs(weight[..., 0] - 0.2) > 1e-3
    np.testing.assert_allclose(view[clear], expected[clear], atol=1e-4)
    assert np.isfinite(view).all()


@settings(max_examples=25, deadline=None)
@given(LATTICES, st.tuples(*[st.integers(6, 12)] * 4))
def test_lenslets_that_are_not_there_are_as_without_light(lattice, cut):
    (j0, i0), centres = lenslets(lattice)
    samples = np.random.default_rng(0).random((1, *centres.shape[:2], 3), np.float32)
    top, bottom, left, right = cut
    part = samples[:, top:-bottom, left:-right].copy()
    samples[:, :top] = samples[:, -bottom:] = np.nan
    samples[:, :, :left] = samples[:, :, -right:] = np.nan
    whole = resample_views(samples, lattice, (j0, i0), WIDTH, HEIGHT, SHIFTS[:1])
    found = resample_views(part, lattice, (j0 + top, i0 + left), WIDTH, HEIGHT, SHIFTS[:1])
    np.testing.assert_array_equal(found, whole)
