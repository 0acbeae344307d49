"""Cuts through a ball and a plane of labels, whose shapes are known."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from pmcl_scenes import model_of

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.report.slices import cut, depths_at, label_at, middle, outlines
from pmcl_ros.geometry.pinhole import Pinhole

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
