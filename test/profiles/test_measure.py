import json
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from command_line import Runner
from conftest import PLACE, UP, boxes_about, camera, masks_of, pictured, radius, solid

from pmcl_ros.cli import main
from pmcl_ros.cli.profile import box_about
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.profiles.measure import measured
from pmcl_ros.runtime.errors import ProfileError


def _run(*arguments):
    return Runner().invoke(main, ['profile', *(str(each) for each in arguments)])


def _box_options(boxes):
    return [each for number, box in boxes.items() for each in ('--box', number, *box)]


def test_command_measures_the_profile_and_writes_an_object(folder, boxes, tmp_path):
    out = tmp_path / 'glass.yaml'
    found = _run(folder, *_box_options(boxes), '-o', out, '--mesh', 'obj', '--json',
                 '--pictures', tmp_path / 'pictures', '--material', 'glass')
    assert found.exit_code == 0, found.output
    told = json.loads(found.stdout.splitlines()[0])  # before click 8.2 stderr comes with it
    pose = np.array(told['object_to_reference'])
    np.testing.assert_allclose(pose[:3, 3], PLACE, atol=7e-4)
    assert pose[2, 2] > np.cos(np.deg2rad(0.7))
    heights, radii, sigma = np.array(told['profile']).T
    inner = abs(heights) < 0.045
    off = radii[inner] - radius(heights[inner])
    assert abs(off).max() < 1e-3
    assert np.median(abs(off)) < 6e-4  # 0.8 px: glass shows its outline farther in
    assert np.ptp(heights) == pytest.approx(0.1, abs=2e-3)
    assert (sigma > 0).all()
    assert np.median(sigma) < 1e-3
    model = ObjectModel.load(out)
    assert model.closed
    assert model.clear
    written = yaml.safe_load(out.read_text())
    assert written['appearance'] == {'material': 'glass'}
    np.testing.assert_array_equal(model.axis, UP)
    assert np.ptp(model.vertices[:, 2]) == pytest.approx(np.ptp(heights), abs=1e-6)
    assert len(list((tmp_path / 'pictures').glob('*.png'))) == 3
    again = _run(folder, *_box_options(boxes), '-o', out, '--mesh', 'obj')
    assert again.exit_code == 1
    assert again.output.startswith('Error: ')
    assert '--force' in again.output


def test_boxes_are_of_the_pictures_before_they_are_shrunk(folder, boxes, tmp_path):
    heights = []
    for shrink in (1, 2):
        found = _run(folder, *_box_options(boxes), '-o', tmp_path / f'{shrink}.yaml', '--json',
                     '--shrink', shrink)
        assert found.exit_code == 0, found.output
        told = json.loads(found.stdout.splitlines()[0])
        heights.append(np.ptp(np.array(told['profile'])[:, 0]))
        assert not ObjectModel.load(tmp_path / f'{shrink}.yaml').clear  # as nothing was said
    assert heights[1] == pytest.approx(heights[0], abs=4e-3)


def test_the_edge_of_the_bottom_is_as_usual(true_surface):
    """From above, the height of the bottom follows from it alone."""
    cameras = [camera(azimuth) for azimuth in (-0.5, 0.0, 0.5)]
    masks = masks_of(solid(replace(true_surface, edges=(0.003, 0.001)).wall), cameras)
    found = measured(pictured(masks, cameras), boxes_about(masks), UP)
    assert found.surface.edges[0] == 0.003
    assert found.pose[2, 3] + found.rows[0, 0] == pytest.approx(PLACE[2] - 0.05, abs=1e-3)


def test_a_view_that_looks_elsewhere_is_left_out(views, boxes, caplog):
    away = [replace(views[1], camera_to_reference=views[1].camera_to_reference @ turn)
            for turn in (np.diag([-1.0, 1, -1, 1]), np.diag([1.0, -1, -1, 1]))]
    found = measured([views[0], *away, views[2]], {0: boxes[0], 3: boxes[2]}, UP)
    assert np.ptp(found.rows[:, 0]) == pytest.approx(0.1, abs=2e-3)
    assert not found.surface.on_foot  # it has no stem
    assert [f'view {k} does not see the object' in caplog.text for k in range(4)] == [
        False, True, True, False]


@pytest.mark.parametrize('height', [0.06, 0.17, 100.0])
def test_a_height_that_the_boxes_contradict_is_refused(views, boxes, height):
    with pytest.raises(ProfileError, match=f'--height says {1e3 * height:.0f} mm') as told:
        measured(views, boxes, UP, height)
    low, high = map(float, re.search(r'that is (\d+) to (\d+) mm', str(told.value)).groups())
    assert 70 < low < 100 < high < 160


def test_one_view_is_enough_with_the_height(views, boxes):
    found = measured(views[:1], {0: boxes[0]}, UP, height=0.1)
    heights, radii, _ = found.rows.T
    assert np.ptp(heights) == pytest.approx(0.1, abs=1e-3)
    inner = abs(heights) < 0.045
    np.testing.assert_allclose(radii[inner], radius(heights[inner]), atol=2e-3)


@pytest.mark.parametrize('height', [None, 0.1])
def test_a_rolled_camera_sees_the_same_vessel(vessel, height):
    """Its boxes are 90 degrees from upright."""
    quarter = np.array([[0, -1.0, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    cameras = [camera(azimuth) @ quarter for azimuth in (-0.5, 0.0, 0.5)]
    masks = masks_of(vessel, cameras)
    boxes = boxes_about(masks)
    found = measured(pictured(masks, cameras), {0: boxes[0]} if height else boxes, UP, height)
    heights, radii, _ = found.rows.T
    assert np.ptp(heights) == pytest.approx(0.1, abs=2e-3)
    inner = abs(heights) < 0.045
    np.testing.assert_allclose(radii[inner], radius(heights[inner]), atol=1e-3)


@pytest.mark.parametrize(('options', 'what'), [
    (['--box', 0, 150, 100, 100, 150], 'boxes in two views, or --height'),
    (['--box', 0, 150, 100, 100, 150, '--box', 5, 150, 100, 100, 150], 'no view 5'),
    (['--box', 0, 150, 100, 2, 150, '--box', 2, 150, 100, 100, 150], 'at least 8 px'),
    (['--box', 0, 150, 100, 100, 'nan', '--box', 2, 150, 100, 100, 150], 'at least 8 px'),
    (['--box', 0, 900, 100, 100, 150, '--box', 2, 150, 100, 100, 150], 'outside its picture'),
    (['--box', 0, 10, 10, 50, 50, '--box', 2, 10, 300, 50, 50], 'no outline fits'),
    (['--points', 0, '150,100', '--box', 2, 1, 1, 90, 90], 'two points or more'),
    (['--points', 0, '150,100 160,200', '--box', 0, 1, 1, 90, 90], 'not several'),
    (['--up', 0, 0, 0, '--box', 0, 150, 100, 100, 150], 'no direction')])
def test_bad_outlines_are_one_clear_line(folder, tmp_path, options, what):
    found = _run(folder, *options, '-o', tmp_path / 'glass.yaml')
    assert found.exit_code in (1, 2)
    assert what in found.output
    assert 'Traceback' not in found.output
    assert not list(tmp_path.iterdir())


def test_views_from_one_side_do_not_tell_the_depth(views, boxes):
    with pytest.raises(ProfileError, match='degrees apart'):
        measured([views[0], views[0]], {0: boxes[0], 1: boxes[0]}, UP)


def test_points_are_a_box():
    assert box_about('20,5 10,60 110,70 50,205.5') == (10, 5, 100, 200.5)
