"""Plans of cameras around a scene, their errors, and the captures that are made with them."""

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from pmcl_ros.cli import main
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.readers.read import has_posed_views, read_source
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.simulation.camera_plan import CameraPlan, in_room
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene

CAMERA = {'width': 96, 'height': 64, 'fx': 90.0, 'fy': 92.0, 'cx': 50.0, 'cy': 30.0}


@pytest.fixture(scope='module')
def scene():
    camera = OrdinaryCamera.make(CAMERA)
    rng = np.random.default_rng(3)
    return random_scene(rng, SceneSettings(kinds=('opaque',), empty=0, field=camera.field),
                        sensor=camera.sensor(rng))


def test_an_arc_is_level_and_looks_at_the_middle_of_the_region(scene):
    cameras = CameraPlan.parse('arc:5:60').cameras(scene)
    middle = np.array(scene.targets[0].roi_center)
    seen = (middle - cameras[:, :3, 3])[:, None] @ cameras[:, :3, :3]
    np.testing.assert_allclose(seen[:, 0], np.tile(middle, (5, 1)), atol=1e-12)
    np.testing.assert_allclose(cameras[2], np.eye(4), atol=1e-12)
    room = in_room(scene, cameras)
    np.testing.assert_allclose(room[:, 2, 3], 0, atol=1e-12)  # all at one height
    steps = room[1:, :3, :3] @ room[:-1, :3, :3].transpose(0, 2, 1)
    angles = np.arccos((np.trace(steps, axis1=1, axis2=2) - 1) / 2)
    np.testing.assert_allclose(np.rad2deg(angles), 15)
    np.testing.assert_allclose(steps @ [0, 0, 1], np.tile([0, 0, 1], (4, 1)), atol=1e-12)


def test_a_grid_is_parallel_and_as_wide_as_it_says(scene):
    cameras = CameraPlan.parse('grid:3x3:0.1').cameras(scene)
    assert len(cameras) == 9
    np.testing.assert_array_equal(cameras[:, :3, :3], np.tile(np.eye(3), (9, 1, 1)))
    assert np.ptp(cameras[:, 0, 3]) == pytest.approx(0.1)
    assert np.ptp(cameras[:, 1, 3]) == pytest.approx(0.1)
    np.testing.assert_array_equal(cameras[:, 2, 3], 0)


def test_the_errors_are_those_that_were_asked_for(scene):
    cameras = np.tile(CameraPlan.parse('arc:2:40').cameras(scene), (2000, 1, 1))
    plan = CameraPlan(arc=(2, 40), sigma_mm=2, sigma_deg=0.5, common=0.25)
    draws = [np.linalg.inv(cameras[:40]) @ plan.reported(cameras[:40], np.random.default_rng(seed))
             for seed in range(300)]
    shift = 1e3 * np.array(draws)[..., :3, 3]  # (draws, views, 3)
    assert shift.std() == pytest.approx(2, rel=0.1)
    assert shift.mean(axis=1).var() == pytest.approx(4 * (0.25 + 0.75 / 40), rel=0.2)
    turn = np.array(draws)[..., 2, 1] - np.array(draws)[..., 1, 2]
    assert np.rad2deg(turn / 2).std() == pytest.approx(0.5, rel=0.1)


@pytest.mark.parametrize(('text', 'message'), [
    ('arc:0:60', '1 to 360 cameras'), ('arc:3:400', '0 to 360 degrees'),
    ('arc:30:3000', r'an arc of 30 cameras over 3000 degrees: .*, 0 to 360 degrees'),
    ('arc:3000:30', 'an arc of 3000 cameras over 30 degrees: 1 to 360 cameras'),
    ('grid:1x1:0.1', 'at least 2 cameras'), ('grid:2x2:0', 'neighbours 0.00001 to'),
    ('grid:3x3:100', r'a grid of 3x3 over 100 m: .* neighbours 0.00001 to 10 m apart'),
    ('grid:3x100:0.1', r'a grid of 3x100 over 0.1 m: .* 1 to 99 rows and columns'),
    ('circle:3', 'expected arc:COUNT:DEGREES'), ('grid:2x2:.', 'expected arc')])
def test_another_plan_is_refused_in_one_line(text, message):
    with pytest.raises(SettingsError, match=message) as caught:
        CameraPlan.parse(text)
    assert '\n' not in str(caught.value)


def test_more_views_than_there_are_cannot_be_hidden():
    for given in ({'arc': (3, 40)}, {'grid': (1, 3, 0.1)}):
        with pytest.raises(SettingsError, match='4 hidden views of 3: set hidden to 3 at most'):
            CameraPlan.make({**given, 'hidden': 4}, 'plan')


def test_the_command_writes_posed_views_that_are_read_again(tmp_path):
    camera, plan = tmp_path / 'camera.yaml', tmp_path / 'plan.yaml'
    camera.write_text(str(CAMERA))
    errors = 'sigma_mm: 1.0, sigma_deg: 0.2, common: 0.5'
    plan.write_text(f'{{arc: [3, 40], {errors}}}')
    hiding = tmp_path / 'hiding.yaml'
    hiding.write_text(f'{{arc: [3, 40], {errors}, stated: false, hidden: 1}}')
    command = ['scenes', 'render', '--camera', str(camera), '--count', '1', '--seed', '5',
               '--samples', '1', '--kind', 'opaque']
    for name, chosen in (('exact', 'arc:3:40'), ('off', str(plan)), ('hidden', str(hiding))):
        result = CliRunner().invoke(main, [*command, '--cameras', chosen, '-o',
                                           str(tmp_path / name)])
        assert result.exit_code == 0, result.output
    folders = [tmp_path / name / '000005' for name in ('exact', 'off', 'hidden')]
    exact, off, hidden = (read_source(each) for each in folders)
    assert isinstance(exact, PosedViews)
    assert has_posed_views(folders[0])
    assert exact.header.frame_id == 'room'
    for one, other in zip(exact.views, off.views, strict=True):
        np.testing.assert_array_equal(one.picture, other.picture)
        apart = np.linalg.inv(one.camera_to_reference) @ other.camera_to_reference
        assert 1e-4 < np.linalg.norm(apart[:3, 3]) < 8e-3
        assert (other.sigma, other.group, other.common) == (
            (0.001, pytest.approx(np.deg2rad(0.2))), 'arm', 0.5)
        assert one.sigma == (0, 0)
    # A card changes one view. The same errors are not stated.
    assert sum((one.picture != other.picture).any()
               for one, other in zip(exact.views, hidden.views, strict=True)) == 1
    for one, other in zip(off.views, hidden.views, strict=True):
        np.testing.assert_array_equal(one.camera_to_reference, other.camera_to_reference)
        assert other.sigma == (0, 0)
    # The object stands on the table, upright or not: its pose is in the frame of the room.
    truth = Truth.load(folders[0] / 'truth.json')
    for each in exact.views:
        before = np.linalg.inv(each.camera_to_reference) @ truth.pose
        assert 0.3 < before[2, 3] < 0.9
    np.testing.assert_allclose(truth.roi_center, truth.pose[:3, 3], atol=0.06)


def test_a_list_of_poses_is_where_pictures_are_taken(tmp_path, scene):
    turned = np.eye(4)
    turned[:3, :3] = Rotation.from_euler('y', 10, degrees=True).as_matrix()
    turned[:3, 3] = 0.06, -0.01, 0.02
    plan, camera = tmp_path / 'plan.yaml', tmp_path / 'camera.yaml'
    # Four rows of four, and 16 numbers.
    plan.write_text(str({'poses': [np.eye(4).tolist(), turned.ravel().tolist()]}))
    camera.write_text(str(CAMERA))
    cameras = CameraPlan.parse(str(plan)).cameras(scene)
    np.testing.assert_allclose(cameras, [np.eye(4), turned])
    command = ['scenes', 'render', '--camera', str(camera), '--count', '1', '--seed', '5',
               '--samples', '1', '--kind', 'opaque']
    for chosen in ([], ['--cameras', str(plan)]):
        made = CliRunner().invoke(main, [*command, *chosen, '-o',
                                         str(tmp_path / str(len(chosen)))])
        assert made.exit_code == 0, made.output
    first, second = read_source(tmp_path / '2' / '000005').views
    apart = np.linalg.inv(first.camera_to_reference) @ second.camera_to_reference
    np.testing.assert_allclose(apart, turned, atol=1e-9)
    alone = read_source(tmp_path / '0' / '000005').picture
    np.testing.assert_array_equal(first.picture, alone)  # that of the scene's own camera
    assert np.abs(second.picture - alone).mean() > 0.02


def test_a_plan_that_is_not_there_is_told():
    with pytest.raises(SettingsError, match=r'^there is no some\.yaml$'):
        CameraPlan.parse('some.yaml')


def test_cameras_need_a_camera():
    result = CliRunner().invoke(main, ['scenes', 'render', '--cameras', 'arc:3:40', '-o', 'x'])
    assert result.exit_code == 2
    assert 'Say --camera too' in result.output
