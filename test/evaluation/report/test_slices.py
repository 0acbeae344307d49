"""Slices of a light field and a volume, and cuts through meshes whose shapes are known."""

import numpy as np
import pytest
import trimesh
from dlv_fields import make_grid, planes_field
from hypothesis import given, settings
from hypothesis import strategies as st
from pmcl_scenes import model_of

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.report.slices import (
    cut,
    depths_at,
    epipolar_slice,
    label_at,
    middle,
    outlines,
    track,
    volume_slice,
)
from pmcl_ros.geometry.pinhole import Pinhole

FAR, NEAR, SPLIT = 0.8, 0.5, 34
GRID = make_grid(views=(7, 7), size=(70, 60), baseline=0.005, jitter=0.1)
FIELD = planes_field(GRID, FAR, NEAR, SPLIT)


def slope_of(epi, low, high):
    """px per view step that patterns move in an epipolar slice, from its brightness alone."""
    grey = epi.pixels[:, low:high].astype(float).mean(axis=-1)
    across = np.gradient(grey, axis=1)
    up = np.gradient(grey, epi.positions, axis=0)
    inside = np.s_[1:-1, 2:-2]
    return -(across[inside] * up[inside]).sum() / (across[inside] ** 2).sum()


@pytest.mark.parametrize(('along', 'pixel', 'reach', 'depth'), [
    ('x', 25, (2, 28), FAR), ('x', 40, (42, 68), NEAR),
    ('y', 15, (2, 58), FAR), ('y', 55, (2, 58), NEAR)])
def test_lines_lean_as_what_lies_at_their_depth(along, pixel, reach, depth):
    epi = epipolar_slice(FIELD, along, pixel)
    assert epi.pixels.shape == (7, 70 if along == 'x' else 60, 3)
    line = track(GRID, along, 30.0, depth, epi.positions)
    assert line[3] == pytest.approx(30)  # the centre view's own pixel
    slope = np.polyfit(epi.positions, line, 1)[0]
    assert slope_of(epi, *reach) == pytest.approx(slope, rel=0.06)
    # Another depth's line leans otherwise by far more than that.
    other = np.polyfit(epi.positions, track(GRID, along, 30.0, FAR + NEAR - depth,
                                            epi.positions), 1)[0]
    assert abs(other / slope - 1) > 0.3


@settings(max_examples=25)
@given(st.sampled_from('xy'), st.floats(0, 60), st.floats(0.3, 3))
def test_a_track_is_where_the_views_project_a_point(along, pixel, depth):
    axis = 'xy'.index(along)
    focal = (GRID.pinhole.fx, GRID.pinhole.fy)[axis]
    centre = (GRID.pinhole.cx, GRID.pinhole.cy)[axis]
    positions = np.linspace(-3, 3, 5)
    point = (pixel - centre) / focal * depth - positions * GRID.baseline
    np.testing.assert_allclose(track(GRID, along, pixel, depth, positions),
                               focal * point / depth + centre, atol=1e-9)


@pytest.fixture(scope='module')
def volume():
    return build_volume(FIELD, DlvSettings(near=0.4, far=1.0, labels=40, edge_labels=4))


@pytest.mark.parametrize(('part', 'depth'), [(np.s_[6:26], FAR), (np.s_[42:64], NEAR)])
def test_slices_are_brightest_at_the_planes_depth(volume, part, depth):
    wanted = label_at(volume.depths, depth)
    for row in (20, 40):
        seen = volume_slice(volume, 'x', row)
        assert seen.shape == (40, 70)  # the first row is the farthest label
        assert np.abs(seen[:, part].sum(axis=1).argmax() - wanted) <= 1
    column = (part.start + part.stop) // 2
    side = volume_slice(volume, 'y', column)
    assert side.shape == (60, 40)  # the first column is the nearest label
    assert np.abs(39 - side[5:-5].sum(axis=0).argmax() - wanted) <= 1


PINHOLE = Pinhole(120, 90, 200.0, 180.0, 58.2, 46.1)
RADIUS = 0.05
BALL = model_of(trimesh.creation.icosphere(subdivisions=4, radius=RADIUS))


def pose_at(x, y, z):
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def hits(pose, x, y):
    """(2, n) depths at which rays of pixels meet the ball; NaN where they miss."""
    rays = np.stack([(x - PINHOLE.cx) / PINHOLE.fx, (y - PINHOLE.cy) / PINHOLE.fy,
                     np.ones(np.shape(x))], axis=-1)
    square, along = (rays ** 2).sum(-1), rays @ pose[:3, 3]
    rest = along ** 2 - square * (pose[:3, 3] @ pose[:3, 3] - RADIUS ** 2)
    with np.errstate(invalid='ignore'):
        return (along + np.sqrt(rest) * np.array([[-1], [1]])) / square


@pytest.mark.parametrize('pose', [pose_at(0, 0, 0.4), pose_at(0.02, -0.03, 0.45)])
def test_a_cut_meets_the_rays_where_the_surface_does(pose):
    column, row = np.rint(PINHOLE.project(pose[:3, 3]) + np.array([4, -6]))
    for along, line, pixels in (('x', row, np.arange(120.0)), ('y', column, np.arange(90.0))):
        pieces = cut(PINHOLE, BALL, pose, along, line)
        others = np.full(len(pixels), line)
        expected = hits(pose, *((pixels, others) if along == 'x' else (others, pixels))).T
        inside = 0
        for pixel, both in zip(pixels, expected, strict=True):
            if np.ptp(both) > 0.02:  # not just grazed
                np.testing.assert_allclose(depths_at(pieces, pixel), both, atol=5e-4)
                inside += 1
            elif np.isnan(both).all():
                assert not len(depths_at(pieces, pixel))
        assert inside > 20


@pytest.mark.parametrize('pose', [pose_at(0, 0, 0.4), pose_at(0.02, -0.03, 0.45)])
def test_an_outline_is_where_rays_begin_to_hit_within_half_a_pixel(pose):
    (line,) = outlines(PINHOLE, BALL, pose)
    for off, hit in ((0.5, False), (-0.5, True)):  # outwards and inwards
        towards = line - line.mean(axis=0)
        moved = line + off * towards / np.linalg.norm(towards, axis=1, keepdims=True)
        assert (np.isfinite(hits(pose, *moved.T)).all(axis=0) == hit).all()


def test_what_is_beside_or_behind_is_cut_nowhere():
    for pose in (pose_at(3, 0, 0.4), pose_at(0, 0, -0.4)):
        pieces = cut(PINHOLE, BALL, pose, 'x', 46)
        inside = (pieces[..., 0] > 0) & (pieces[..., 0] < 120)
        assert not inside.any()
        assert not outlines(PINHOLE, BALL, pose)


@given(st.floats(0.1, 1), st.floats(1.1, 5), st.integers(2, 90))
def test_labels_and_depths_are_inverse(near, ratio, count):
    depths = depth_labels(near, ratio * near, count)
    np.testing.assert_allclose(label_at(depths, depths), np.arange(count), atol=1e-7)
    between = 1 / ((1 / depths[0] + 1 / depths[1]) / 2)
    assert label_at(depths, between) == pytest.approx(0.5)


def test_the_middle_is_the_boxs_wherever_the_origin_lies():
    shifted = model_of(trimesh.creation.box([0.1, 0.06, 0.04]).apply_translation([0, 0, 0.02]))
    turned = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0.4], [0, 0, 0, 1.0]])
    np.testing.assert_allclose(middle(shifted, turned), [0, -0.02, 0.4])
