import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.geometry.faces import Faces


@given(st.integers(0, 10_000), st.sampled_from([1, 7, 8, 9, 64, 65, 300]))
def test_distances_to_faces_are_those_of_trimesh(seed, count):
    """Of triangles of any size and place: large ones are nearest where small ones are nearer."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(0, 0.05, (count, 1, 3)) + (
        10 ** rng.uniform(-4, -1, (count, 1, 1)) * rng.normal(0, 1, (count, 3, 3)))
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3),
                           process=False)
    points = rng.normal(0, 0.08, (20, 3))
    larger = mesh.copy().apply_scale(1e4)  # trimesh takes small triangles for points
    expected = trimesh.proximity.closest_point_naive(larger, 1e4 * points)[1] / 1e4
    faces = Faces.from_mesh(mesh)
    found = [faces.farthest(each[None]) for each in points]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert faces.farthest(points) == pytest.approx(expected.max(), abs=1e-9)


def test_faces_without_area_are_edges_and_points():
    corners = np.array([[[0, 0, 0], [1.0, 0, 0], [1, 0, 0]], [[5, 0, 0]] * 3])
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(6).reshape(-1, 3), process=False)
    faces, points = Faces.from_mesh(mesh), np.array([[0.5, 2.0, 0], [-3, 4, 0], [5, 0, 1]])
    found = [faces.farthest(each[None]) for each in points]
    assert found == pytest.approx([2, 5, 1], abs=1e-12)
