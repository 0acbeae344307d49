import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice

LATTICES = st.builds(
    lambda pitch, ratio, rotation, x, y: Lattice(
        pitch_px=pitch, row_step_px=ratio * pitch, rotation=rotation, centre_px=(x, y)),
    st.floats(3, 15), st.floats(0.8, 0.95), st.floats(-0.49, 0.49), st.floats(-200, 200),
    st.floats(-200, 200))


def test_centres_by_example():
    lattice = Lattice(pitch_px=10, row_step_px=8, rotation=0, centre_px=(100, 50))
    i, j = np.array([0, 1, 0, 0, -1, 0]), np.array([0, 0, 1, 2, -1, -2])
    np.testing.assert_allclose(lattice.centres(i, j), [
        [100, 50], [110, 50], [105, 58], [100, 66], [95, 42], [100, 34]])


def test_rotation_is_from_x_towards_y():
    lattice = Lattice(pitch_px=10, row_step_px=8, rotation=np.arcsin(0.28), centre_px=(0, 0))
    np.testing.assert_allclose(lattice.centres(np.array([1, 0]), np.array([0, 2])),
                               [[9.6, 2.8], [-0.28 * 16, 0.96 * 16]])


@settings(deadline=None)
@given(LATTICES, st.integers(-99, 99), st.integers(-99, 99))
def test_centres_are_the_formula(lattice, i, j):
    along = (i + (0.5 if j % 2 else 0)) * lattice.pitch_px
    turned = np.exp(1j * lattice.rotation) * complex(along, j * lattice.row_step_px)
    x, y = lattice.centre_px
    np.testing.assert_allclose(lattice.centres(np.array(i), np.array(j)),
                               [x + turned.real, y + turned.imag], atol=1e-9)


@settings(deadline=None)
@given(LATTICES, st.integers(20, 90), st.integers(20, 90))
def test_the_index_range_covers_the_sensor_and_little_more(lattice, width, height):
    i0, i1, j0, j1 = lattice.index_range(width, height)
    i, j = np.meshgrid(np.arange(i0 - 30, i1 + 30), np.arange(j0 - 30, j1 + 30))
    x, y = np.moveaxis(lattice.centres(i, j), -1, 0)
    reach = min(lattice.pitch_px, lattice.row_step_px) / 2 + 0.5  # of a lenslet's pixels
    inside = (np.hypot(x - np.clip(x, 0, width - 1), y - np.clip(y, 0, height - 1)) <= reach)
    assert inside.any()
    for lenslets, first, end in ((i[inside], i0, i1), (j[inside], j0, j1)):
        assert first <= lenslets.min() <= first + 4
        assert lenslets.max() < end <= lenslets.max() + 5


@settings(deadline=None)
@given(LATTICES, st.integers(0, 2 ** 32 - 1))
def test_the_nearest_lenslet_is_the_nearest_of_all(lattice, seed):
    points = np.random.default_rng(seed).uniform(-60, 60, (20, 2)) + lattice.centre_px
    i, j = lattice.nearest(points)
    centres = lattice.centres(*np.meshgrid(np.arange(-40, 40), np.arange(-40, 40)))
    apart = np.hypot(*np.moveaxis(points[:, None] - centres.reshape(-1, 2), -1, 0))
    found = np.hypot(*(points - lattice.centres(i, j)).T)
    np.testing.assert_allclose(found, apart.min(axis=1), atol=1e-9)


def test_the_nearest_lenslet_of_one_point():
    lattice = Lattice(pitch_px=10, row_step_px=8, rotation=0, centre_px=(100, 50))
    assert lattice.nearest(np.array([94.0, 43.0])) == (-1, -1)


def test_a_lattice_differs_from_a_moved_one_by_the_way():
    one = Lattice(pitch_px=10, row_step_px=8, rotation=0.01, centre_px=(100, 50))
    i, j = np.array(7), np.array(-4)  # the same lattice, counted from another lenslet
    x, y = one.centres(i, j)
    other = one.model_copy(update={'centre_px': (x + 0.3, y - 0.4)})
    apart = one.difference(other, 300, 200)
    np.testing.assert_allclose(apart, 0.5)
    assert abs(len(apart) - 300 * 200 / 80) < 60
