"""Pictures against outlines that are known: those of a ball and of a box."""

import cv2
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.layers import Layers
from pmcl_ros.drawing.pictures import (
    depth_picture,
    layers_picture,
    outlines,
    overlay,
    silhouette,
    write_png,
)
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import OutputError

PINHOLE = Pinhole(120, 90, 200.0, 180.0, 58.2, 46.1)
SIZE = np.array([0.1, 0.06, 0.04])


def model_of(mesh):
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    return ObjectModel('model', vertices, faces, None, True)


BALL = model_of(trimesh.creation.icosphere(subdivisions=4, radius=0.05))
BOX = model_of(trimesh.creation.box(extents=SIZE))


def pose_at(x, y, z, rotvec=(0, 0, 0)):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(rotvec).as_matrix()
    pose[:3, 3] = x, y, z
    return pose


def rays(zoom=1):
    """(zoom * height, zoom * width, 3) the direction of each pixel's centre."""
    y, x = np.indices((zoom * PINHOLE.height, zoom * PINHOLE.width))
    x, y = (x + 0.5) / zoom - 0.5, (y + 0.5) / zoom - 0.5
    return np.stack([(x - PINHOLE.cx) / PINHOLE.fx, (y - PINHOLE.cy) / PINHOLE.fy,
                     np.ones(x.shape)], axis=-1)


def ball_mask(pose, zoom=1):
    """Which pixels' rays hit the ball."""
    directions = rays(zoom)
    along = directions @ pose[:3, 3]
    closest = pose[:3, 3] @ pose[:3, 3] - along ** 2 / (directions ** 2).sum(-1)
    return (closest <= 0.05 ** 2) & (along > 0)


def box_mask(pose, zoom=1):
    """Which pixels' rays hit the box."""
    inverse = np.linalg.inv(pose)
    origin, directions = inverse[:3, 3], rays(zoom) @ inverse[:3, :3].T
    with np.errstate(divide='ignore'):
        ends = np.stack([(side * SIZE / 2 - origin) / directions for side in (-1, 1)])
    return ends.min(0).max(-1) <= ends.max(0).min(-1)


def within_a_pixel(mask, expected):
    square = np.ones((3, 3), np.uint8)
    grown = cv2.dilate(expected.astype(np.uint8), square).astype(bool)
    shrunk = cv2.erode(expected.astype(np.uint8), square).astype(bool)
    return not (mask & ~grown).any() and not (shrunk & ~mask).any()


POSES = [pose_at(0, 0, 0.4), pose_at(0.05, -0.03, 0.4, (0.3, 0.5, 0.2)),
         pose_at(-0.05, 0.03, 0.5, (1.1, -0.4, 0.9)),
         pose_at(-0.11, -0.09, 0.4, (0, 2, 1))]  # the last reaches out of the image


@pytest.mark.parametrize('zoom', [1, 3])
@pytest.mark.parametrize('pose', POSES)
@pytest.mark.parametrize(('model', 'expected'), [(BALL, ball_mask), (BOX, box_mask)])
def test_a_silhouette_is_what_the_rays_hit_within_a_pixel(model, expected, pose, zoom):
    mask = silhouette(PINHOLE, model, pose, zoom)
    assert mask.shape == (90 * zoom, 120 * zoom)
    assert mask.dtype == bool
    assert expected(pose, zoom).any()
    assert within_a_pixel(mask, expected(pose, zoom))


@pytest.mark.parametrize('pose', [pose_at(0, 0, -0.4), pose_at(5, 0, 0.4)])
def test_what_is_behind_or_beside_the_camera_covers_nothing(pose):
    assert not silhouette(PINHOLE, BALL, pose).any()
    picture = np.full((90, 120, 3), 99, np.uint8)
    assert (overlay(picture, PINHOLE, BALL, pose) == 99).all()


def test_a_word_stands_at_an_object_before_the_camera_alone():
    picture = np.full((90, 120, 3), 99, np.uint8)
    assert (outlines(picture, PINHOLE, [(BALL, pose_at(0, 0, -0.4), 'behind')]) == 99).all()
    before = outlines(picture, PINHOLE, [(BALL, pose_at(0, 0, 0.4), 'before')])
    assert (before != outlines(picture, PINHOLE, [(BALL, pose_at(0, 0, 0.4), '')])).any()


@pytest.mark.parametrize(('width', 'drawn'), [(328, 984), (640, 1280), (1600, 1600), (4000, 4000)])
def test_small_pictures_alone_are_enlarged(width, drawn):
    height = width // 2
    pinhole = Pinhole(width, height, float(width), float(width), width / 2, height / 2)
    picture = np.zeros((height, width, 3), np.uint8)
    ball = pose_at(0, 0, 0.4)
    for canvas in (overlay(picture, pinhole, BALL, ball),
                   outlines(picture, pinhole, [(BALL, ball, '')])):
        assert canvas.shape == (drawn // 2, drawn, 3)
        green = np.flatnonzero((canvas[..., 1] > 200).any(axis=0))
        assert np.ptp(green) == pytest.approx(drawn * 0.1 / 0.4, rel=0.03)


@pytest.mark.parametrize('z', [0, 1e-12, 0.03, 0.05, 0.051])
def test_an_object_around_the_camera_can_be_drawn(z):
    picture = overlay(np.zeros((90, 120, 3), np.uint8), PINHOLE, BALL, pose_at(0, 0, z))
    assert picture.shape == (270, 360, 3)


@pytest.mark.parametrize('pose', POSES[:3])
@pytest.mark.parametrize(('model', 'expected'), [(BALL, ball_mask), (BOX, box_mask)])
def test_the_overlay_draws_the_outline_and_the_axes_and_nothing_else(model, expected, pose):
    picture = np.full((90, 120, 3), 128, np.uint8)
    canvas = overlay(picture, PINHOLE, model, pose)
    assert canvas.shape == (270, 360, 3)
    assert (picture == 128).all()
    inside = expected(pose, 3).astype(np.uint8)
    edge = cv2.morphologyEx(inside, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    near_edge = cv2.dilate(edge, np.ones((5, 5), np.uint8)).astype(bool)
    # Every pixel of the outline has green beside it.
    green = ((canvas[..., 1] > 200) & (canvas[..., 0] < 80)).astype(np.uint8)
    assert cv2.dilate(green, np.ones((5, 5), np.uint8))[edge.astype(bool)].all()
    # Elsewhere are only the arms of the axes, each in its colour.
    away = np.zeros(near_edge.shape, np.uint8)
    arms = 0.4 * np.linalg.norm(model.vertices, axis=1).max() * pose[:3, :3].T + pose[:3, 3]
    origin, *tips = 3 * PINHOLE.project(np.vstack([pose[:3, 3], arms])) + 1
    for tip in tips:
        cv2.line(away, *np.rint([origin, tip]).astype(int).tolist(), 1, 15)
    drawn = (canvas != 128).any(-1)
    assert not (drawn & ~near_edge & ~away.astype(bool)).any()
    for k, tip in enumerate(tips):
        # Near the tip, where no other arm is; an arm that points at the camera has no length.
        others = [np.linalg.norm(tip - other) for other in (origin, *tips[:k], *tips[k + 1:])]
        if min(others) > 12:
            x, y = np.rint(0.2 * origin + 0.8 * tip).astype(int)
            assert canvas[y, x].argmax() == k
            assert drawn[y, x]


def test_a_depth_picture_is_warm_near_cold_far_and_black_where_unknown():
    depth = np.full((20, 160), np.nan, np.float32)
    depth[:, 40:80], depth[:, 80:120], depth[:10, 120:] = 0.3, 0.9, 0.45
    picture = depth_picture(depth, 0.3, 0.9)
    assert picture.shape == (34, 160, 3)
    assert picture.dtype == np.uint8
    np.testing.assert_array_equal(picture[:20].any(-1), np.isfinite(depth))
    near, far, middle = (picture[0, x].astype(int) for x in (60, 100, 140))
    assert near[0] > near[2] + 50
    assert far[2] > far[0]
    # The scale below is of the same colours, uniform in inverse depth: 0.45 is in the middle.
    scale = picture[20:]
    np.testing.assert_array_equal(scale[0, 0], far)
    np.testing.assert_array_equal(scale[0, -1], near)
    assert np.abs(scale[0, 78:82] - middle).sum(axis=1).min() < 12
    for x in (10, 80, 140):  # the texts, on white
        assert (scale[:, x - 8:x + 8] > 220).all(-1).any()


def test_depths_beyond_the_scale_are_shown_as_its_ends():
    ends = depth_picture(np.array([[0.3, 0.9] * 50]), 0.3, 0.9)[0]
    beyond = depth_picture(np.array([[0.01, 7] * 50]), 0.3, 0.9)[0]
    np.testing.assert_array_equal(beyond, ends)


def test_a_png_holds_the_picture(tmp_path):
    picture = np.random.default_rng(0).integers(0, 256, (9, 12, 3)).astype(np.uint8)
    write_png(tmp_path / 'picture.png', picture)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / 'picture.png'))[..., ::-1], picture)


def test_a_png_that_cannot_be_written_is_named(tmp_path):
    picture = np.zeros((2, 2, 3), np.uint8)
    write_png(tmp_path / 'made' / 'picture.png', picture)
    with pytest.raises(OutputError, match=r'cannot write .*: .*picture\.png is no folder'):
        write_png(tmp_path / 'made' / 'picture.png' / 'picture.png', picture)
    with pytest.raises(OutputError, match=r'cannot write .*: Is a directory'):
        write_png(tmp_path, picture)


def test_layers_picture_shows_the_front_and_what_is_behind_side_by_side():
    front, back = np.full((20, 60), 0.4, np.float32), np.full((20, 60), 0.8, np.float32)
    back[:, :30] = np.nan  # only one surface there
    layers = Layers(np.stack([back, front], axis=2), *[np.ones((20, 60, 2), np.float32)] * 2)
    picture = layers_picture(layers, 0.3, 0.9)
    behind = np.where(np.isnan(back), np.nan, 0.8)
    low = np.s_[17:20]  # below the names
    np.testing.assert_array_equal(picture[low, :60], depth_picture(front, 0.3, 0.9)[low])
    np.testing.assert_array_equal(picture[low, 60:], depth_picture(behind, 0.3, 0.9)[low])
    assert not picture[low, 60:90].any()
