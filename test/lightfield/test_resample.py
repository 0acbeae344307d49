"""Resampling against the barycentric coordinates of the three lenslets that are nearest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.lightfield.lenslets import Lenslets
from pmcl_ros.lightfield.light_field import VIEW_MOST, VIEW_WHITE
from pmcl_ros.lightfield.resample import StandIns, ViewPixels, resample_views

WIDTH, HEIGHT = 120, 90  # raw px
LATTICES = st.builds(
    lambda pitch, ratio, rotation, x, y: Lattice(
        pitch_px=pitch, row_step_px=ratio * pitch, rotation=rotation, centre_px=(x, y)),
    st.floats(8, 12), st.floats(0.84, 0.9), st.floats(-0.49, 0.49), st.floats(-50, 150),
    st.floats(-50, 150))
# Of equilateral triangles: those of the nearest three lenslets.
REGULAR = LATTICES.map(lambda lattice: lattice.model_copy(
    update={'row_step_px': np.sqrt(0.75) * lattice.pitch_px}))
SIZES = st.sampled_from([(12, 9), (12, 9), (7, 5), (31, 22)])
SHIFTS = np.array([[0, 0], [0.7, -1.3], [-2, 2]])
NONE = StandIns(np.zeros((0, 4), np.int64), np.zeros(4, np.int64))


def pixels_of(size=(12, 9), k1=0.0, k2=0.0):
    pinhole = Pinhole(*size, 2.5 * size[0], 2.4 * size[1], 0.45 * size[0], 0.52 * size[1])
    return ViewPixels(pinhole, (WIDTH / size[0], HEIGHT / size[1]), k1, k2)


def block_of(lattice, pixels):
    reach = pixels.reach(SHIFTS)
    return Lenslets.covering(lattice, reach[:, 0].min(), reach[:, 1].max(), reach[:, 2].min(),
                             reach[:, 3].max())


def counted(values):
    """What views tell of values: whole counts."""
    return np.clip(np.floor(values * VIEW_WHITE + 0.5), 0, VIEW_MOST) / VIEW_WHITE


def resampled(samples, lattice, block, pixels, slots=(1, 4, 2), stand_ins=NONE):
    """(3, height, width, 3) views at SHIFTS of samples (n, rows, columns, 3)."""
    out = np.full((5, pixels.pinhole.height, pixels.pinhole.width, 3), 7, np.float32)
    ordered = np.ascontiguousarray(samples.transpose(1, 0, 3, 2), np.float32)
    resample_views(ordered, lattice, block.origin, pixels, SHIFTS, stand_ins,
                   np.array(slots), out)
    assert not np.delete(out, slots, axis=0).any()
    return out[list(slots)]


def places(pixels, shift):
    """(height, width, 2) raw px where a view of that shift is read, as the formulas say."""
    pinhole, (wide, high) = pixels.pinhole, pixels.scale
    y, x = np.indices((pinhole.height, pinhole.width)).astype(float)
    u = (x + shift[0] - pinhole.cx) / pinhole.fx
    v = (y + shift[1] - pinhole.cy) / pinhole.fy
    stretch = 1 + pixels.k1 * (u * u + v * v) + pixels.k2 * (u * u + v * v) ** 2
    x = u * stretch * pinhole.fx + pinhole.cx
    y = v * stretch * pinhole.fy + pinhole.cy
    return np.stack([(x + 0.5) * wide - 0.5, (y + 0.5) * high - 0.5], axis=-1)


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
@given(LATTICES, SIZES, st.tuples(st.floats(-2, 2), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)),
       st.sampled_from([(0, 0), (-0.4, 0.2), (0.5, 0)]))
def test_linear_functions_are_reproduced(lattice, size, slopes, distortion):
    level, across, down = slopes
    pixels = pixels_of(size, *distortion)
    block = block_of(lattice, pixels)
    values = level + across * block.centres[..., 0] + down * block.centres[..., 1]
    samples = np.stack([values, 2 * values, 1 - values], axis=-1)
    views = resampled(np.repeat(samples[None], 3, axis=0), lattice, block, pixels)
    assert views.dtype == np.float32
    for view, shift in zip(views, SHIFTS, strict=True):
        place = places(pixels, shift)
        expected = level + across * place[..., 0] + down * place[..., 1]
        expected = np.stack([expected, 2 * expected, 1 - expected], axis=-1)
        np.testing.assert_allclose(view, counted(expected), atol=1e-4)
        np.testing.assert_array_equal(view, counted(view))


@settings(max_examples=40, deadline=None)
@given(REGULAR, SIZES, st.integers(0, 2**32 - 1), st.sampled_from([(0, 0), (-0.4, 0.2)]))
def test_a_pixel_is_interpolated_in_its_triangle_of_nearest_lenslets(lattice, size, seed,
                                                                     distortion):
    pixels = pixels_of(size, *distortion)
    block = block_of(lattice, pixels)
    samples = np.random.default_rng(seed).random((3, *block.shape, 3), np.float32)
    views = resampled(samples, lattice, block, pixels)
    for view, sample, shift in zip(views, samples, SHIFTS, strict=True):
        expected = interpolated(block.centres, sample, places(pixels, shift))
        np.testing.assert_allclose(view, expected, atol=1e-4)


@settings(max_examples=30, deadline=None)
@given(SIZES, st.sampled_from([(0, 0), (-0.4, 0.2), (0.5, 0)]))
def test_the_reach_is_that_of_all_pixels(size, distortion):
    pixels = pixels_of(size, *distortion)
    for (left, right, top, bottom), shift in zip(pixels.reach(SHIFTS), SHIFTS, strict=True):
        place = places(pixels, shift)
        assert (left, top) == pytest.approx(tuple(place.min(axis=(0, 1))))
        assert (right, bottom) == pytest.approx(tuple(place.max(axis=(0, 1))))


def test_a_pixel_of_the_usual_size_lies_where_it_should():
    pixels = ViewPixels(Pinhole(328, 328, 945, 945, 163.5, 163.5), (10, 10))
    np.testing.assert_allclose(pixels.places(np.array([0, 7]), np.array([3, 327])),
                               [[4.5, 34.5], [74.5, 3274.5]])


@settings(max_examples=25, deadline=None)
@given(REGULAR, st.integers(0, 2**32 - 1), st.tuples(st.integers(-4, 4), st.integers(-4, 4)))
def test_lenslets_off_the_sensor_are_those_next_to_them(lattice, seed, offset):
    pixels = pixels_of()
    block = block_of(lattice, pixels)
    offsets = np.repeat([offset], 3, axis=0)
    stand_ins = StandIns.find(block, lattice, offsets, pixels.reach(SHIFTS), WIDTH, HEIGHT)
    samples = np.random.default_rng(seed).random((3, *block.shape, 3), np.float32)
    at = block.centres + offset
    on = ((at >= 0) & (at <= [WIDTH - 1, HEIGHT - 1])).all(axis=-1)
    samples[:, ~on] = np.nan
    views = resampled(samples, lattice, block, pixels, stand_ins=stand_ins)
    assert np.isfinite(views).all()
    assert views.min() >= 0
    assert views.max() <= 1
    rows, columns, instead_rows, instead_columns = stand_ins.lenslets.T
    assert not on[rows, columns].any()
    assert on[instead_rows, instead_columns].all()
    apart = np.hypot(*(at[rows, columns] - at[instead_rows, instead_columns]).T)
    beyond = np.hypot(*(at[rows, columns] - np.clip(at[rows, columns], 0,
                                                    [WIDTH - 1, HEIGHT - 1])).T)
    assert (apart < beyond + 3 * lattice.pitch_px).all()
