"""What is counted of next views, and the command that looks."""

import re

import numpy as np
import yaml
from command_line import Runner

from pmcl_ros.cli import main
from pmcl_ros.evaluation.studies.view_gain import ViewGain, reachable, summary
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.simulation.camera_plan import CameraPlan
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene


def trial(mm, sigma, lost=False, expected=1.0):
    return Trial('glass: cup', 'best', 0, translation_mm=mm, axis_deg=1.0, lost=lost,
                 extra={'sigma_mm': sigma, 'expected_mm': expected})


def test_the_summary_counts_the_scenes_that_begin_with_a_pose_and_all():
    text = summary([
        ViewGain(7, trial(2, 2.5), trial(0.5, 0.6, expected=0.7), trial(1, 0.9)),
        ViewGain(8, trial(3, 1.5), trial(0.9, 0.8, expected=0.9), trial(0.7, 0.9)),
        ViewGain(9, trial(50, 1.5), trial(60, 1.8), trial(1, 0.8)),
        ViewGain(10, trial(4, 1.5, lost=True), trial(1, 1), trial(2, 2))])
    assert ('| 7 | glass: cup | 2.00 ± 2.50, expected 1.00 | 0.50 ± 0.60, expected 0.70 | 1.00 ± '
            '0.90, expected 1.00 |') in text
    assert '| 9 | glass: cup | elsewhere ± 1.50' in text
    assert '| 10 | glass: cup | (4.00) ± 1.50' in text
    assert 'find the object in 50 % (2 of 4; 15 to 85 %); wrong: 1' in text
    assert ('these, median standard deviation: before 2.00 mm, best 0.70 mm, random 0.90 '
            'mm; expected with the best 0.80 mm') in text
    assert 'these, median error: before 2.50 mm, best 0.70 mm, random 0.85 mm' in text
    assert ('these, the best is nearer the truth than the random one: 50 % (1 of 2; 9 to 91 %); '
            'surer: 100 % (2 of 2; 34 to 100 %)') in text
    assert 'all, the best is nearer the truth than the random one: 50 % (2 of 4' in text
    assert 'all, found: before 2, best 3, random 4 of 4' in text


def test_cameras_beyond_the_table_or_the_wall_are_left_out():
    scene = random_scene(np.random.default_rng(3), SceneSettings(views=3))
    near = CameraPlan(arc=(5, 40)).cameras(scene)
    np.testing.assert_array_equal(reachable(scene, near), near)
    for sheet in scene.sheets[:2]:  # table and wall
        through = near.copy()
        apart = (near[:, :3, 3] - sheet.pose[:3, 3]) @ sheet.pose[:3, 2]
        through[:, :3, 3] -= 2 * apart[:, None] * sheet.pose[:3, 2]
        np.testing.assert_array_equal(reachable(scene, np.concatenate([near, through])), near)


def test_the_command_prints_a_row_for_each_scene(tmp_path):
    (tmp_path / 'camera.yaml').write_text(yaml.safe_dump(
        {'width': 200, 'height': 150, 'fx': 190.0, 'cx': 99.5, 'cy': 74.5}))
    done = Runner().invoke(main, [
        'view-gain', '--count', '1', '--seed', '5', '--kind', 'opaque', '--camera',
        str(tmp_path / 'camera.yaml'), '--samples', '1', '--apart', '20', '--candidates', '6',
        '--out', str(tmp_path)], catch_exceptions=False)
    assert done.exit_code == 0
    assert re.search(r'^\| 5 \| opaque: .* ± .* ± .* ± ', done.stdout, re.MULTILINE)
    assert (tmp_path / 'view_gain.md').read_text() == done.stdout


def test_no_candidate_that_can_be_reached_is_one_line():
    """The only one of this scene is below the table."""
    done = Runner().invoke(main, ['view-gain', '--count', '1', '--seed', '5', '--kind', 'opaque',
                                  '--samples', '1', '--candidates', '1', '--cap', '150'])
    assert done.exit_code == 1
    assert done.stderr.splitlines()[-1] == (
        'Error: seed 5: table and wall are before all 1 candidates of 150 degrees: give more '
        '--candidates, or another --cap')
