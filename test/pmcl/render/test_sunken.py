"""What is in water is proposed, found and drawn where refraction shows it."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from contour_maps import map_seen
from pmcl_scenes import CAMERA, cup, model_of
from scipy.spatial.transform import Rotation

from pmcl_ros.drawing.pictures import overlay, silhouette
from pmcl_ros.drawing.view_overlay import overlay_in_view
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.interface import Interface
from pmcl_ros.geometry.se3 import inverse, retract
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.sunken import as_it_appears, with_sunken
from pmcl_ros.pmcl.settings import PmclSettings

TUBE = trimesh.creation.cylinder(0.03, 0.1, sections=24)
MODEL = ObjectModel('tube', np.asarray(TUBE.vertices), np.asarray(TUBE.faces), None, True)
# A front 0.3 m ahead that the camera does not face squarely.
FRONT = Interface(np.array([[0, 0, 0.3]]),
                  Rotation.from_euler('y', 25, degrees=True).as_matrix()[None, :, 2] * -1, 1.333)


def test_where_it_is_appears_where_the_template_fits():
    true = np.tile(np.eye(4), (40, 1, 1))
    rng = np.random.default_rng(0)
    true[:, :3, 3] = rng.uniform([-0.05, -0.05, 0.48], [0.05, 0.05, 0.6], (40, 3))
    true[:, :3, :3] = Rotation.random(40, random_state=1).as_matrix()
    fitted = true.copy()  # a template is rigid: it fits the mean of what is seen
    for pose, shown in zip(true, fitted, strict=True):
        points = MODEL.vertices @ pose[:3, :3].T + pose[:3, 3]
        shown[:3, 3] += (FRONT.apparent(points) - points).mean(axis=0)
    assert np.linalg.norm(fitted[:, :3, 3] - true[:, :3, 3], axis=1).min() > 0.03
    proposed = with_sunken(fitted, MODEL, FRONT)
    np.testing.assert_array_equal(proposed[:40], fitted)
    assert len(proposed) == 80
    off = np.linalg.norm(proposed[40:, :3, 3] - true[:, :3, 3], axis=1)
    assert off.max() < 0.01
    np.testing.assert_array_equal(proposed[40:, :3, :3], true[:, :3, :3])


def test_in_the_air_there_is_nothing_to_add():
    pose = np.eye(4)[None].copy()
    pose[:, 2, 3] = 0.2
    assert len(with_sunken(pose, MODEL, FRONT)) == 1
    assert with_sunken(pose, MODEL, None) is pose


def test_straight_down_it_appears_at_three_quarters_of_its_depth():
    surface = Interface(np.array([[0, 0, 0.3]]), np.array([[0, 0, -1.0]]), 1.333)
    pose = np.eye(4)
    pose[2, 3] = 0.5
    thin = replace(MODEL, vertices=MODEL.vertices * [1e-3, 1e-3, 1])
    seen = as_it_appears(thin, pose, surface).vertices
    depth = 0.3 + (0.5 + np.array([-0.05, 0.05]) - 0.3) / 1.333
    assert (seen[:, 2].min(), seen[:, 2].max()) == pytest.approx(depth - 0.5, abs=1e-6)
    assert as_it_appears(thin, pose, None) is thin


def contour_of(pixels, depths):
    """Points of a contour somewhere, of which only these count."""
    zero, number = np.zeros(len(depths)), np.zeros(len(depths), int)
    return ContourPoints(pixels, np.tile([1.0, 0.0], (len(depths), 1)), depths, zero + 1,
                         zero[:, None], zero, number, zero, zero + 1, 0.0)


@pytest.mark.parametrize('surface', [-0.03, -0.015, -0.005, 0.01])  # m: below the camera
def test_a_contour_in_the_air_is_not_seen_through_the_water(surface):
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0, [CAMERA.width, CAMERA.height], (500, 2))
    made = contour_of(pixels, rng.uniform(0.25, 0.8, 500))
    # A tank's front, and the surface.
    normals = Rotation.from_euler('xy', rng.normal(0, 5, 2), degrees=True).apply(
        [[0, 0, -1], [0, -1, 0]])
    points = np.array([[0, 0, 0.3], [0, surface, 0]])
    planes = np.column_stack([normals, -np.einsum('ki,ki->k', normals, points)])
    seen = made.seen_through(planes, CAMERA, 0.002)
    rays = np.column_stack([(pixels - [CAMERA.cx, CAMERA.cy]) / [CAMERA.fx, CAMERA.fy],
                            np.ones(500)])
    part = np.linspace(0, 1, 2001)
    above = np.einsum('s,ni,ki->snk', part, made.depths[:, None] * rays, normals) + planes[:, 3]
    wet = (above < 0).all(axis=2)
    kept = (np.abs(above[-1]) > 0.002).all(axis=1) & (wet[-1] | ~wet.any(axis=0))
    grazing = wet.sum(axis=0) == 1  # so short a way that samples may miss it
    left = np.isin(pixels[:, 0], seen.pixels[:, 0])
    np.testing.assert_array_equal(left[~grazing], kept[~grazing])
    assert 50 < left.sum() < 500
    behind = ~wet[-1] & wet.any(axis=0)
    assert (behind.sum() > 5) == (surface < 0)


CUP = model_of(cup(), [0, 0, 1])
WATER = Interface(np.array([[0.0, 0.02, 0.33]]),
                  Rotation.from_euler('x', 20, degrees=True).as_matrix()[None, :, 2] * -1, 1.333)
SUNKEN = np.eye(4)
SUNKEN[:3, :3] = Rotation.from_euler('xz', [110, 15], degrees=True).as_matrix()
SUNKEN[:3, 3] = 0.01, 0.0, 0.45


def test_one_picture_tells_where_a_thing_in_water_is():
    drawn = as_it_appears(CUP, SUNKEN, WATER)
    seen = map_seen(silhouette(CAMERA, drawn, SUNKEN, 4), CAMERA, 0.3, 0.7)
    settings = {'roi_center': (0.0, 0.0, 0.43), 'roi_size': (0.08, 0.08, 0.1), 'proposals': 60,
                'particles': 64, 'moves': 1}
    off = []
    for declared in ({}, {'interface_index': WATER.index,
                          'interface_point': WATER.points.ravel().tolist(),
                          'interface_normal': WATER.normals.ravel().tolist()}):
        with Localizer(CUP, PmclSettings(**settings | declared)) as localizer:
            found = localizer.localize(seen, np.random.default_rng(0))
        off.append(np.linalg.norm(found.pose[:3, 3] - SUNKEN[:3, 3]))
    assert off[0] > 0.02
    assert off[1] < 0.004


def test_the_overlay_shows_it_as_the_water_does():
    camera = retract(np.eye(4)[None], np.array([[0.2, -0.1, 0.4, 0.5, -1.0, 0.3]]))[0]
    grey = np.full((CAMERA.height, CAMERA.width, 3), 0.5, np.float32)
    view = PosedView(Header(), grey, CAMERA, camera)
    drawn = overlay_in_view(view, CUP, camera @ SUNKEN, WATER.seen_from(inverse(camera)))
    straight = overlay(view.displayed(), CAMERA, CUP, SUNKEN)
    shown = overlay(view.displayed(), CAMERA, as_it_appears(CUP, SUNKEN, WATER), SUNKEN)
    assert (drawn != shown).any(axis=2).mean() < 1e-3
    assert (drawn != straight).any(axis=2).sum() > 500
    np.testing.assert_array_equal(overlay_in_view(view, CUP, camera @ SUNKEN, None), straight)
