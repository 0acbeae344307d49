import logging

import numpy as np
import pytest
import trimesh

from pmcl_ros.geometry.moved_surface import Surface
from pmcl_ros.geometry.revolution_axis import revolution_axis
from pmcl_ros.geometry.se3 import pose_of, rotations_about

RADIUS = 0.04
Z = np.array([0, 0, 1.0])


def prism(sides):
    return trimesh.creation.cylinder(RADIUS, 0.1, sections=sides)


def ellipse(share):
    mesh = prism(64)
    mesh.vertices[:, 0] *= 1 - share
    return mesh


@pytest.mark.parametrize('sides', [3, 4, 6, 8, 12, 24])
def test_a_prism_is_off_itself_by_what_its_sides_are_flat(sides):
    half = rotations_about(Z, np.array([np.pi / sides]))
    surface = Surface.from_mesh(prism(sides))
    assert surface.moved_by(half) == pytest.approx(
        RADIUS * (1 - np.cos(np.pi / sides)), abs=1e-4)
    assert surface.moved_by(half @ half) == pytest.approx(0, abs=1e-9)


def test_beyond_a_limit_no_distance_is_told():
    aside = pose_of(np.eye(3), [0.02, 0, 0])[None]
    surface = Surface.from_mesh(prism(32))
    assert surface.moved_by(aside) == pytest.approx(0.02, abs=2e-4)
    assert surface.moved_by(aside, 0.021) == surface.moved_by(aside)
    assert surface.moved_by(aside, 0.019) == np.inf


def uneven():
    mesh = prism(64)
    return mesh.subdivide(face_index=np.flatnonzero(mesh.triangles_center @ [1, 0, 1] > 0))


@pytest.mark.parametrize(('mesh', 'is_round', 'told'), [
    (prism(6), False, ''), (prism(8), False, ''), (prism(9), False, ''),
    (prism(12), True, 'turned about z its surface is 1.4 mm off itself'), (prism(16), True, ''),
    (prism(32), True, ''), (ellipse(0.1), False, ''),
    (ellipse(0.03), True, 'turned about z its surface is 1.2 mm off itself'),
    (ellipse(0.015), True, ''), (uneven(), True, ''),
    (trimesh.creation.cylinder(0.004, 0.18, sections=6), True, 'is 0.5 mm off')], ids=[
    'hexagon', 'octagon', '9', '12', '16', '32', 'ellipse', 'oval', 'nearly a circle',
    'uneven faces', 'pencil'])
def test_what_is_turned_off_itself_has_no_axis(caplog, mesh, is_round, told):
    """About z, and about any axis: the principal ones are tried then."""
    oblique = rotations_about(np.array([0.6, 0, 0.8]), np.array([1.1]))[0]
    with caplog.at_level(logging.WARNING):
        axis = revolution_axis(mesh, 'thing')
    warnings = [each.getMessage() for each in caplog.records]
    assert len(warnings) == bool(told)
    assert all(told in each and 'write symmetries_continuous: []' in each for each in warnings)
    assert (axis is not None) is is_round
    other = revolution_axis(mesh.copy().apply_transform(oblique), 'thing')
    assert (other is not None) is is_round
    if is_round:
        np.testing.assert_array_equal(axis, Z)
        assert abs(other @ oblique[:3, 2]) > 1 - 1e-6


@pytest.mark.parametrize('mesh', [trimesh.creation.box((0.08, 0.079, 0.081)),
                                  trimesh.creation.box((0.2, 0.2, 0.004))])
def test_what_has_edges_is_not_round(mesh):
    assert revolution_axis(mesh, 'thing') is None
