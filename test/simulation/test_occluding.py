"""Labels of contours agree with outlines that are known exactly."""

import numpy as np
import pytest
import trimesh
from plain_scenes import WHITE, plain_scene, pose_at
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.simulation.occluding import DIRECTIONS, contour_labels
from pmcl_ros.simulation.scenes.materials import Clear, Opaque
from pmcl_ros.simulation.scenes.scene import Sheet, Solid
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles
from pmcl_ros.simulation.scenes.world import World

_CAMERA = Pinhole(90, 70, 400.0, 400.0, 44.3, 34.8)


def _ball(radius, pose, medium):
    turn = np.linspace(-np.pi / 2, np.pi / 2, 200)
    profile = radius * np.stack([np.abs(np.cos(turn)), np.sin(turn)], axis=1)
    return Solid(Frusta.from_profile(profile, 0, 1), (medium,), pose)


def _labels(solids, sheets=(), camera=_CAMERA):
    return contour_labels(World.from_scene(plain_scene(solids, sheets)), camera)


def _angles(labels):
    """Pixels (n, 2) of contours, and their normals (n, 2)."""
    y, x = np.nonzero(labels.direction >= 0)
    turn = 2 * np.pi * labels.direction[y, x] / DIRECTIONS
    return np.stack([x, y], axis=1), np.stack([np.cos(turn), np.sin(turn)], axis=1)


def _degrees(one, two):
    return np.rad2deg(np.arccos(np.clip((one * two).sum(axis=1), -1, 1)))


@pytest.mark.parametrize('radius', [0.01, 0.025])
def test_the_outline_of_a_ball(radius):
    labels = _labels([_ball(radius, pose_at(0, 0, 0.5), Clear(1.5))])
    middle, outline = np.array([44.3, 34.8]), 400 * radius / np.sqrt(0.25 - radius ** 2)
    y, x = np.mgrid[:70, :90]
    away = np.hypot(x - middle[0], y - middle[1]) - outline
    assert (labels.inside == (away < 0))[np.abs(away) > 0.2].all()
    marked = labels.direction >= 0
    assert np.abs(away[marked]).max() < 0.75
    assert marked[np.abs(away) < 0.35].all()
    pixels, normals = _angles(labels)
    true = (pixels - middle) / np.linalg.norm(pixels - middle, axis=1, keepdims=True)
    assert _degrees(normals, true).max() < 360 / DIRECTIONS / 2 + 5


def test_the_outline_of_a_turned_box_has_the_directions_of_its_edges():
    size, turn = np.array([0.05, 0.03, 0.02]), 0.4
    mesh = trimesh.creation.box(size)
    pose = pose_of(Rotation.from_euler('z', turn), np.array([0, 0, 0.5]))
    labels = _labels([Solid(Triangles(np.array(mesh.triangles), 0, 1),
                            (Opaque(WHITE),), pose)])
    across = 400 * size[:2] / 2 / (0.5 - size[2] / 2)  # px, of the face before the camera
    pixels, normals = _angles(labels)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    places = (pixels - [44.3, 34.8]) @ axes.T
    beyond = np.abs(places) - across
    edge = beyond.argmax(axis=1)
    assert np.abs(beyond.max(axis=1)).max() < 1.0
    far_from_corners = beyond.min(axis=1) < -3
    true = np.sign(places[np.arange(len(edge)), edge])[:, None] * axes[edge]
    assert _degrees(normals, true)[far_from_corners].max() < 360 / DIRECTIONS / 2 + 3
    assert np.abs(beyond.max(axis=1)[far_from_corners]).max() < 0.6
    assert len(pixels) == pytest.approx(4 * across.sum(), rel=0.25)


def test_both_sides_of_something_thin_have_their_own_directions():
    profile = np.array([[0, -0.1], [0.0015, -0.1], [0.0015, 0.1], [0, 0.1]])
    upright = Rotation.from_euler('x', np.pi / 2)
    rod = Solid(Frusta.from_profile(profile, 0, 1), (Clear(1.5),),
                pose_of(upright, np.array([0, 0, 0.4])))
    pixels, normals = _angles(_labels([rod]))
    side = np.sign(pixels[:, 0] - 44.3)
    assert (normals[:, 0] * side > 0.97).all()
    assert set(side) == {-1, 1}


def test_solids_part_from_what_is_behind_only():
    near, far = (_ball(0.02, pose_at(x, 0, z), Clear(1.5)) for x, z in ((0, 0.4), (0.02, 0.6)))
    labels = _labels([near, far])
    pixels, normals = _angles(labels)
    middle, outline = np.array([44.3, 34.8]), 400 * 0.02 / np.sqrt(0.16 - 0.0004)
    away = np.linalg.norm(pixels - middle, axis=1) - outline
    assert (away > -0.75).all()  # nothing of the far one through the near one
    true = (pixels - middle) / np.linalg.norm(pixels - middle, axis=1, keepdims=True)
    on_near = np.abs(away) < 0.5
    ring = np.abs(np.arctan2(*true[on_near].T)) < np.pi
    assert ring.sum() > 0.9 * 2 * np.pi * outline
    degrees = _degrees(normals, true)[on_near]
    assert np.median(degrees) < 4
    assert np.percentile(degrees, 95) < 12


def test_opaque_sheets_hide_and_translucent_ones_do_not():
    ball = _ball(0.02, pose_at(0, 0, 0.5), Clear(1.5))

    def sheet(depth, opacity):
        return Sheet(pose_at(0.5, 0, depth), (1.0, 1.0), WHITE, 0.1, opacity)

    bare = _labels([ball])
    for beside in (sheet(0.3, 0.5), sheet(0.55, 1.0)):
        labels = _labels([ball], [beside])
        assert np.array_equal(labels.direction, bare.direction)
        assert np.array_equal(labels.inside, bare.inside)
    half = _labels([ball], [sheet(0.3, 1.0)])
    assert not half.inside[:, 45:].any()
    assert (half.direction[:, 46:] == -1).all()  # a sheet's own edge is no contour of a solid
    assert np.array_equal(half.inside[:, :44], bare.inside[:, :44])
    pixels, normals = _angles(half)
    assert len(pixels) < 0.6 * (bare.direction >= 0).sum()
    assert (normals[:, 0] < 0.3).all()


def test_the_foot_on_a_table_is_a_contour():
    mesh = trimesh.creation.box([0.04, 0.04, 0.04])
    tilt = Rotation.from_euler('x', -0.5 - np.pi / 2)  # the world's z to the image's up
    place = pose_of(tilt, np.array([0, 0.02, 0.5]))
    box = Solid(Triangles(np.array(mesh.triangles), 0, 1), (Opaque(WHITE),), place)
    table = Sheet(place @ pose_at(0, 0, -0.02), (2.0, 2.0), WHITE, 0.1)
    labels = _labels([box], [table])
    alone = _labels([box])
    assert labels.inside.any()
    assert np.array_equal(labels.inside, alone.inside)
    assert (labels.direction == alone.direction)[alone.direction >= 0].mean() > 0.95


def test_an_empty_scene_has_no_contour():
    labels = _labels([])
    assert (labels.direction == -1).all()
    assert not labels.inside.any()
