"""Several objects in several views: against known truth."""

from dataclasses import replace

import numpy as np
import pytest
from contour_maps import NUMBERS, map_seen
from multi_object_scenes import BOTTLE, CUP, ZOOM, standing, surface
from pmcl_scenes import CAMERA, COARSE
from scipy.spatial.transform import Rotation

from pmcl_ros.evidence.posed_evidence import PosedEvidence, ViewsEvidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.pmcl.multi_object.penetration import MAX_PENETRATION, Interior, outside_of
from pmcl_ros.pmcl.multi_object.posed_scene import PosedSceneLocalizer
from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.multi_view.other_objects import OtherObjects
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError

# Solids are not evidence, as in the shipped numbers: those of other objects would be.
OF_CONTOURS = NUMBERS.model_copy(update={'contour_weight': 0.6, 'inside_weight': 0.0})
MIDDLE = np.array([0.0, 0.0, 0.45])
# A base whose z is up, as poses in the frame of the first camera are seen from it.
BASE = np.eye(4)
BASE[:3, :3], BASE[:3, 3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0.3, 0.1, 0.5]
SETTINGS = PmclSettings(roi_center=tuple(BASE[:3, :3] @ MIDDLE + BASE[:3, 3]),
                        roi_size=(0.16, 0.16, 0.12), proposals=100, particles=96, moves=1)
FRONT, BEHIND = standing(-0.015, 0.025, 0.41, 0.2), standing(0.02, 0.005, 0.5, 0.2)
BESIDE = standing(0.035, 0.02, 0.47, 0.2)


def seen(things, angles=(-25, 0, 25), opaque=False, pinhole=COARSE):
    """Views from around of (model, pose): of glass the contours of all are seen."""
    views = []
    for angle in angles:
        camera = np.eye(4)
        camera[:3, :3] = Rotation.from_euler('y', angle, degrees=True).as_matrix()
        camera[:3, 3] = MIDDLE - camera[:3, :3] @ MIDDLE
        depths = np.array([surface(model, np.linalg.inv(camera) @ pose, pinhole)
                           for model, pose in things])
        there = depths > 0
        if opaque:
            there &= depths == np.where(depths > 0, depths, np.inf).min(axis=0)
        maps = [map_seen(each, pinhole, 0.3, 0.6, ZOOM) for each in there]
        base = np.array([-4, 0, 0, 0, 0], np.float32)
        tensor = sum(each.tensor - base for each in maps) + base
        views.append(PosedEvidence(replace(maps[0], tensor=tensor, numbers=OF_CONTOURS),
                                   BASE @ camera))
    return ViewsEvidence(Header(7, 'base'), tuple(views))


def located(models, evidence, progress=None):
    with PosedSceneLocalizer(models, SETTINGS) as localizer:
        return localizer.localize(evidence, np.random.default_rng(0), progress)


def off(estimate, pose, model):
    error = pose_error(estimate.pose, BASE @ pose, model.symmetry)
    return 1e3 * error.translation, np.rad2deg(error.rotation)


@pytest.fixture(scope='module')
def both():
    return seen([(CUP, FRONT), (BOTTLE, BEHIND)])


def test_one_before_another_are_found_where_they_are(both):
    found = located([BOTTLE, CUP], both)
    assert found.names == ('bottle', 'cup')
    for estimate, pose, model in zip(found.estimates, (BEHIND, FRONT), (BOTTLE, CUP), strict=True):
        assert not estimate.lost
        millimetres, degrees = off(estimate, pose, model)
        assert millimetres < 1.5
        assert degrees < 1.5
    assert found.depth <= MAX_PENETRATION
    estimate, model = found.least_sure([BOTTLE, CUP])
    assert (estimate, model) in zip(found.estimates, (BOTTLE, CUP), strict=True)
    sigmas = [np.linalg.eigvalsh(each.covariance[:3, :3])[-1] for each in found.estimates]
    assert np.linalg.eigvalsh(estimate.covariance[:3, :3])[-1] == max(sigmas)


def test_what_another_one_hides_is_not_missing():
    evidence = seen([(CUP, FRONT), (BOTTLE, BEHIND)], opaque=True, pinhole=CAMERA)
    found = located([CUP, BOTTLE], evidence)
    hidden = found.estimates[1]
    assert not found.estimates[0].lost
    assert not hidden.lost
    assert off(hidden, BEHIND, BOTTLE)[0] < 2
    assert found.alone[1].lost


def test_what_hides_a_pose_is_the_nearest_of_other_objects_and_it_is_outside_of_all(both):
    placed = [(CUP, BASE @ FRONT), (BOTTLE, BASE @ BEHIND)]
    interiors = [Interior.from_model(model) for model, _ in placed]
    first = both.views[0].camera_to_reference

    def seen_beside(things):
        others = OtherObjects(outside_of(interiors[0], [
            (interiors[0 if model is CUP else 1], pose) for model, pose in things]), things)
        return JointEvidence.from_views(both, NumbaRenderer(), CUP, SETTINGS, others)

    cup, bottle, together, again = (seen_beside(things) for things in (
        placed[:1], placed[1:], placed, placed[::-1]))
    overlap = False
    for number in range(3):
        alone = [np.where(each.fronts[number] > 0, each.fronts[number], np.inf)
                 for each in (cup, bottle)]
        overlap |= np.isfinite(alone).all(axis=0).any()
        nearest = np.minimum(*alone)
        for each in (together, again):
            np.testing.assert_array_equal(each.fronts[number],
                                          np.where(np.isfinite(nearest), nearest, 0))
    assert overlap
    free = standing(-0.05, 0.02, 0.49)
    poses = np.linalg.inv(first) @ BASE @ np.stack([FRONT, BEHIND, free])
    assert together.feasible(poses).tolist() == [False, False, True]
    assert cup.feasible(poses).tolist() == [False, True, True]


def test_copies_are_found_and_numbered_along_the_frame_s_x_axis():
    far, near = (BESIDE, FRONT)
    found = located([CUP, CUP], seen([(CUP, far), (CUP, near)]))
    assert found.names == ('cup', 'cup_2')
    for estimate, pose in zip(found.estimates, (near, far), strict=True):
        assert not estimate.lost
        assert off(estimate, pose, CUP)[0] < 1.5
    assert found.depth <= MAX_PENETRATION


def test_what_is_not_there_takes_no_contour_of_what_is():
    evidence = seen([(CUP, FRONT)])
    found = located([CUP, BOTTLE, CUP], evidence)
    assert [each.lost for each in found.estimates] == [False, True, True]
    with MultiViewLocalizer(CUP, SETTINGS) as localizer:
        alone = localizer.localize(evidence, np.random.default_rng(0).spawn(1)[0])
    np.testing.assert_array_equal(found.estimates[0].pose, alone.pose)
    np.testing.assert_array_equal(found.estimates[0].particles, alone.particles)


def test_it_stops_when_asked(both):
    parts = []
    found = located([CUP, BOTTLE], both, lambda part: parts.append(part) or len(parts) < 3)
    assert len(parts) == 3
    assert len(found.estimates) == 2


def test_once_stopped_no_further_object_is_searched_for(both, monkeypatch):
    localize, searched = MultiViewLocalizer.localize, []
    monkeypatch.setattr(MultiViewLocalizer, 'localize', lambda each, *given, **named: (
        searched.append(each.model.name), localize(each, *given, **named))[1])
    found = located([CUP, BOTTLE], both, lambda _: False)
    assert searched == ['cup']
    assert all(each.lost for each in found.estimates)


def test_the_contour_of_a_pose_is_in_the_pixels_of_the_view(both):
    """Where the map of the view shows it, also of a region in a part of the picture."""
    small = SETTINGS.model_copy(update={'roi_size': (0.02, 0.02, 0.02), 'roi_center': tuple(
        (BASE @ FRONT)[:3, 3])})
    with MultiViewLocalizer(CUP, small) as localizer:
        contours = localizer.contours(both, BASE @ FRONT)
    assert sorted(contours) == [0, 1, 2]
    for number, points in contours.items():
        column, row = np.rint(points.pixels.T).astype(int)
        inside = ((column >= 0) & (row >= 0) & (column < COARSE.width) & (row < COARSE.height))
        shown = both.views[number].evidence.tensor[row[inside], column[inside], 0, 0]
        assert (shown > -3.6).mean() > 0.95


def test_what_cannot_be_searched_is_refused():
    with pytest.raises(LocalizationError, match='no objects are listed'):
        PosedSceneLocalizer([], SETTINGS)
    with pytest.raises(LocalizationError, match='mode default, it is faithful'):
        PosedSceneLocalizer([CUP], SETTINGS.model_copy(update={'mode': 'faithful'}))
