"""The search in contour maps: the score's definition, and known poses."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from contour_maps import NUMBERS, map_seen
from pmcl_scenes import CAMERA, bracket, cup, model_of, pose_of
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.learning.contour_errors import Deviation, fitted_offset
from pmcl_ros.learning.contour_tables import Example
from pmcl_ros.learning.searches import found
from pmcl_ros.pmcl.contour_approximations import LinearizedContour
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.settings import PmclSettings

NEAR, FAR = 0.3, 0.6
ZOOM = 4
WHOLE = Window(0, 0, (CAMERA.width, CAMERA.height))


def seen(model, pose, camera=CAMERA):
    """The contour map of an object alone."""
    return map_seen(depth_of(model, pose, camera) > 0, camera, NEAR, FAR, ZOOM)


def depth_of(model, pose, camera=CAMERA):
    """(ZOOM * height, ZOOM * width) depths of an object [m], 0 elsewhere."""
    finer = Pinhole(camera.width * ZOOM, camera.height * ZOOM, camera.fx * ZOOM,
                    camera.fy * ZOOM, camera.cx * ZOOM + 1.5, camera.cy * ZOOM + 1.5)
    scene = Scene(model, finer, Window(0, 0, (finer.width, finer.height)), NEAR, FAR)
    return NumbaRenderer().depths(scene, pose[None])[0]


CUP, BRACKET = model_of(cup(), axis=(0, 0, 1)), model_of(bracket())
CUP_POSE = pose_of(Rotation.from_euler('xyz', [1.9, 0.3, 0.2]), [0.01, -0.005, 0.45])
BRACKET_POSE = pose_of(Rotation.from_euler('xyz', [2.2, 0.5, 0.8]), [-0.01, 0.008, 0.42])


@pytest.mark.parametrize(('model', 'pose'), [(CUP, CUP_POSE), (BRACKET, BRACKET_POSE)],
                         ids=['cup', 'bracket'])
def test_a_known_pose_is_found(model, pose):
    middle = pose[:3, 3] + [0.012, -0.01, 0.015]
    settings = PmclSettings(roi_center=tuple(middle), roi_size=(0.12, 0.12, 0.14),
                            renderer='numba')
    with Localizer(model, settings) as localizer:
        found = localizer.localize(seen(model, pose), np.random.default_rng(0))
    error = pose_error(found.pose, pose, model.symmetry)
    assert not found.lost
    assert error.translation < 0.004
    assert error.rotation < np.deg2rad(3)


def test_contours_that_are_found_inside_are_looked_for_there():
    mask = (depth_of(CUP, CUP_POSE) > 0).astype(np.uint8)
    inside = cv2.erode(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))) > 0
    odds = map_seen(inside, CAMERA, NEAR, FAR, ZOOM)  # half a pixel inside
    region = Region(tuple(CUP_POSE[:3, 3]), (0.06, 0.06, 0.1))
    off, told = [], []
    for offset in (0.0, -0.5):
        numbers = NUMBERS.model_copy(update={'inside_weight': 0.0, 'contour_offset': offset})
        example = Example(replace(odds, numbers=numbers), CUP, CUP_POSE, region)
        estimate = found(example, CUP, None, 0)
        off.append(estimate.pose[2, 3] - CUP_POSE[2, 3])
        told.append(fitted_offset([Deviation.from_estimate(
            example, estimate, example.volume.profile, NumbaRenderer())]))
    # A contour of the half size r px that is half a pixel smaller is farther by 0.5 / r.
    assert off[0] > 0.002
    assert abs(off[1]) < 0.001
    assert told[0] == pytest.approx(-0.5, abs=0.1)
    assert told[1] == pytest.approx(0, abs=0.1)


def test_a_score_is_that_of_its_contour_and_of_the_pixels_it_covers():
    odds, scene = seen(BRACKET, BRACKET_POSE), Scene(BRACKET, CAMERA, WHOLE, NEAR, FAR)
    for inside in (odds.inside, np.zeros_like(odds.inside)):
        odds = replace(odds, inside=inside)
        with NumbaRenderer().contour_score(scene, odds, odds.profile) as score:
            value = score(BRACKET_POSE[None])[0]
            points = score.points(BRACKET_POSE)
        covered = NumbaRenderer().depths(scene, BRACKET_POSE[None])[0] > 0
        expected = NUMBERS.inside_weight * inside[..., 0][covered].sum()
        assert points.covered == pytest.approx(expected, rel=1e-4)
        assert value == pytest.approx(points.lengths @ points.evidence + points.covered, rel=1e-4)
    assert points.covered == 0


def test_covered_pixels_count_near_a_pose_as_at_it():
    """To first order, a silhouette that moves outwards gains what it covers."""
    odds = seen(CUP, CUP_POSE)
    only = replace(odds, tensor=np.zeros_like(odds.tensor),
                   inside=np.ones_like(odds.inside))
    scene = Scene(CUP, CAMERA, WHOLE, NEAR, FAR)
    with NumbaRenderer().contour_score(scene, only, only.profile) as score:
        local = LinearizedContour.from_contour(CUP_POSE, score.points(CUP_POSE), only,
                                               only.profile)
        nearer = np.array([[0, 0, -0.005, 0, 0, 0], [0, 0, 0.005, 0, 0, 0.0]])
        exact = score(retract(CUP_POSE, nearer))
        assert local.evidence(np.zeros((1, 6)))[0] == pytest.approx(score(CUP_POSE[None])[0],
                                                                    rel=1e-6)
    assert exact[0] > exact[1]
    assert np.ptp(local.evidence(nearer)) == pytest.approx(np.ptp(exact), rel=0.1)


def test_a_pose_that_is_as_likely_as_another_is_lost():
    """The right half of a picture and its mirror image: a cup's mirrored pose is one of it."""
    camera = replace(CAMERA, cx=(CAMERA.width - 1) / 2)
    pose = pose_of(Rotation.from_euler('xyz', [1.9, 0.3, 0.2]), [0.04, -0.005, 0.45])
    one = seen(CUP, pose, camera)
    mirrored = one.tensor[:, ::-1] * np.array([1, -1, 1, 1, -1], np.float32)
    right = np.arange(camera.width) > camera.cx
    both = np.where(right[:, None, None], one.tensor, mirrored)
    settings = PmclSettings(roi_center=(0.0, -0.005, 0.45), roi_size=(0.12, 0.06, 0.1),
                            renderer='numba', proposals=100)
    for least, tensor, lost in ((0.9, both, True), (0.0, both, False), (0.9, one.tensor, False)):
        odds = replace(one, tensor=np.ascontiguousarray(tensor), numbers=NUMBERS.model_copy(
            update={'least_weight': least, 'inside_weight': 0.0}))
        with Localizer(CUP, settings) as localizer:
            found = localizer.localize(odds, np.random.default_rng(0))
        assert found.lost is lost, found.modes
