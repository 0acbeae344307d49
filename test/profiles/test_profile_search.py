"""The search by dynamic programming, in exactly drawn pictures."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import PLACE, UP, boxes_about, camera, masks_of, pictured, solid
from scipy.spatial import cKDTree

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evidence.build_map import build_map
from pmcl_ros.profiles.foot import standing_on_foot
from pmcl_ros.profiles.measure import measured
from pmcl_ros.profiles.outline import Cylinder
from pmcl_ros.profiles.revolution import Revolution
from pmcl_ros.profiles.search import PosedMap, searched

FRAME = np.eye(4)
FRAME[:3, 3] = PLACE


def maps_of(views, boxes, drawn=True):
    found = []
    for number, view in enumerate(views):
        left, top, width, height = boxes.get(number, (0, 0, 400, 360))
        found.append(PosedMap(build_map(view, DlvSettings()), view.camera_to_reference,
                              (left, top, left + width, top + height),
                              drawn and number in boxes))
    return found


def test_a_bowl_reaches_below_the_cylinder_of_its_boxes():
    """It shows less of its foot's circle than a cylinder would, which is 37 mm high, not 60."""
    heights = np.linspace(-0.03, 0.03, 40)
    wall = np.stack([0.045 - 0.033 * (0.5 - heights / 0.06) ** 2, heights], axis=1)
    cameras = [camera(azimuth, steep=0.5) for azimuth in (-0.5, 0.0, 0.5)]
    masks = masks_of(solid(wall), cameras)
    found = searched(maps_of(pictured(masks, cameras), boxes_about(masks)),
                        Cylinder(FRAME, 0.049, 0.037), 0.0025)
    assert found.high == pytest.approx(0.03, abs=2e-3)
    assert found.low == pytest.approx(-0.03, abs=2e-3)


def test_the_object_ends_where_its_box_does(true_surface):
    """A strong line across it is no top where the box goes on."""
    cameras = [camera(azimuth) for azimuth in (-0.5, 0.0, 0.5)]
    wall, line = true_surface.wall, 0.03
    whole = masks_of(solid(wall), cameras)
    lower = masks_of(solid(wall[wall[:, 1] < line]), cameras)
    views = pictured(lower, cameras, before=pictured(whole, cameras, shade=(0.685, 0.685, 0.735)))
    about = Cylinder(FRAME, 0.034, 0.1)
    found = searched(maps_of(views, boxes_about(whole)), about, 0.0025)
    assert found.high == pytest.approx(0.05, abs=3e-3)
    found = searched(maps_of(views, boxes_about(whole), drawn=False), about, 0.0025)
    assert found.high == pytest.approx(line, abs=3e-3)


@pytest.fixture(scope='module')
def stemmed():
    """The wall of a glass on a stem and a foot."""
    heights = np.array([-0.05, -0.047, -0.043, -0.035, 0.0, 0.02, 0.05])
    radii = np.array([0.027, 0.027, 0.01, 0.004, 0.004, 0.024, 0.027])
    return Revolution.from_curve(FRAME, heights, radii, 0.002)


def test_a_stem_is_tried_on_a_foot(stemmed, true_surface):
    """From above a foot has the outline of a cone, on which the search may put the stem."""
    foot = standing_on_foot(stemmed, 0.0025)
    assert foot.on_foot
    cone = Revolution.from_curve(FRAME, np.array([-0.05, -0.047, -0.035, 0.0, 0.02, 0.05]),
                                 np.array([0.027, 0.027, 0.004, 0.004, 0.024, 0.027]), 0.0025)
    walls = [each.wall for each in (foot, standing_on_foot(cone, 0.0025))]
    for wall in walls:
        assert cKDTree(stemmed.wall).query(wall)[0].max() < 2e-3
    assert cKDTree(stemmed.wall).query(cone.wall)[0].max() > 3e-3
    assert standing_on_foot(true_surface, 0.0025) is None


@pytest.mark.parametrize('edge', [0.001, 0.003, 0.005])
def test_a_foot_is_as_wide_as_the_cone_whatever_its_edges(edge):
    cone = Revolution.from_curve(FRAME, np.array([-0.05, -0.026, 0.05]),
                                 np.array([0.027, 0.004, 0.004]), 0.0025)
    cone = replace(cone, edges=(edge, 0.001))
    foot = standing_on_foot(cone, 0.0025)
    assert foot.radii[0] == pytest.approx(cone.wall[:, 0].max(), abs=3e-4)
    assert foot.edges[0] < 0.001
    assert (foot.low, foot.high) == pytest.approx((-0.05, 0.05))


def test_a_low_cone_below_a_neck_stays_one():
    """It has a stem, so a foot is tried; seen from so low its flank is not that of a foot.

    Where that is taken after all, its refinement has led to the flank.
    """
    wall = Revolution.from_curve(FRAME, np.array([-0.05, -0.03, -0.02, 0.05]),
                                 np.array([0.034, 0.016, 0.007, 0.007]), 0.002)
    assert standing_on_foot(wall, 0.0025) is not None
    cameras = [camera(azimuth, steep=0.2) for azimuth in (-0.5, 0.0, 0.5)]
    masks = masks_of(solid(wall.wall), cameras)
    found = measured(pictured(masks, cameras), boxes_about(masks), UP).surface
    assert standing_on_foot(found, 0.0025) is not None
    seen = found.wall[abs(found.wall[:, 1]) < 0.048]
    assert cKDTree(wall.wall).query(seen)[0].max() < 1.5e-3
