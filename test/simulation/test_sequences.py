"""Sequences: their motion is what they say, their pictures are of it, their bags hold both."""

import json

import cv2
import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from pmcl_ros.cli import main
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.light_field import ViewGrid, nominal_positions
from pmcl_ros.messages.bags import read, topics
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.tracking.settings import TrackingSettings
from pmcl_ros.runtime.errors import BagError, SettingsError
from pmcl_ros.simulation.files import write_sequence
from pmcl_ros.simulation.layers import Plane, TexturedMesh, composited, view_shifts
from pmcl_ros.simulation.sequence import Sequence, SequenceSettings, wander

SMALL = SequenceSettings(frames=12, occluded=2, size=64)
CAMERA = Pinhole(90, 80, 200.0, 210.0, 44.0, 41.5)
GRID = ViewGrid(CAMERA, 0.004, nominal_positions(3, 3), np.ones((3, 3), np.float32))


@pytest.fixture(scope='module')
def sequence():
    return Sequence(1, SMALL)


@pytest.mark.parametrize('speed', [0.0, 0.003, 0.02])
def test_a_path_is_as_fast_as_it_may_be_and_stays_near(speed):
    reach = np.array([0.05, 0.04, 0.03])
    poses = wander(np.random.default_rng(3), 400, reach, 0.2, speed)
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert steps.max() <= speed + 1e-12
    assert steps.max() >= 0.8 * speed
    assert (np.abs(poses[:, :3, 3]) <= reach).all()
    turns = Rotation.from_matrix(poses[:, :3, :3]).as_rotvec()
    assert (np.abs(turns) <= 0.2 + 1e-9).all()


def test_the_object_is_where_its_world_and_the_camera_say(sequence):
    world = sequence.cameras @ sequence.poses
    steps = np.linalg.norm(np.diff(world[:, :3, 3], axis=0), axis=1)
    assert 0 < steps.max() <= SMALL.object_speed
    low = np.array(sequence.roi_center) - np.array(sequence.roi_size) / 2
    high = np.array(sequence.roi_center) + np.array(sequence.roi_size) / 2
    assert (sequence.poses[:, :3, 3] > low).all()
    assert (sequence.poses[:, :3, 3] < high).all()
    resting = Sequence(1, SMALL.model_copy(update={'object_speed': 0.0}))
    world = resting.cameras @ resting.poses
    np.testing.assert_allclose(world, np.broadcast_to(world[0], world.shape), atol=1e-12)


def test_frames_are_always_the_same_and_differ_from_each_other(sequence):
    again = Sequence(1, SMALL).frame(4).light_field
    first = sequence.frame(4).light_field
    np.testing.assert_array_equal(first.views, again.views)
    assert first.header == again.header
    assert first.header.stamp_ns - sequence.header(3).stamp_ns == 10 ** 8
    assert np.abs(first.views - sequence.frame(0).light_field.views).max() > 0.1
    other = Sequence(2, SMALL)
    assert other.kind != sequence.kind


def test_hidden_frames_show_nothing_of_the_object(sequence):
    assert list(sequence.hidden) == [5, 6]
    resting = {'object_speed': 0.0, 'camera_speed': 0.0, 'noise': 0.0}
    still = Sequence(1, SMALL.model_copy(update=resting))
    hidden, seen = (still.frame(number).light_field.views for number in (5, 4))
    first = Sequence(4, SMALL.model_copy(update=resting))
    assert np.abs(hidden - seen).max() > 0.05
    np.testing.assert_allclose(hidden, still.frame(6).light_field.views, atol=1e-6)
    assert first.kind == still.kind


@pytest.mark.parametrize('view', [0, 4, 8])
def test_a_plane_is_seen_where_its_corners_are(view):
    pose = pose_of(Rotation.from_rotvec([0.3, -0.2, 0.5]), np.array([0.01, -0.02, 0.6]))
    size = (0.08, 0.06)
    plane = Plane.from_texture(pose, np.ones((768, 768, 3), np.float32), 0.1, 0.0005, size)
    fixed = np.eye(4)
    fixed[:3, 3] = -view_shifts(GRID)[view]
    drawn = plane.drawn(CAMERA, fixed)[..., 3]
    corners = np.array([[x, y, 0, 1] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]) * [
        size[0] / 2, size[1] / 2, 0, 1]
    pixels = CAMERA.project((corners @ (fixed @ pose).T)[:, :3])
    expected = np.zeros((8 * CAMERA.height, 8 * CAMERA.width), np.float32)
    cv2.fillPoly(expected, [np.rint(8 * (pixels + 0.5) - 0.5).astype(np.int32)], 1.0)
    expected = cv2.resize(expected, (CAMERA.width, CAMERA.height), interpolation=cv2.INTER_AREA)
    assert expected.sum() > 300
    assert drawn.sum() == pytest.approx(expected.sum(), rel=0.02)
    for axis in (0, 1):
        places = np.arange(expected.shape[axis])
        middles = [(each.sum(axis=1 - axis) @ places) / each.sum() for each in (drawn, expected)]
        assert middles[0] == pytest.approx(middles[1], abs=0.1)


def test_a_solid_moves_from_view_to_view_by_its_depth(sequence):
    texture = np.full((768, 768, 3), 0.5, np.float32)
    solid = TexturedMesh(sequence.model, texture, 0.1, 1.0, 1.0, 0.003, np.array([0, 0, -1.0]))
    depth = 0.5
    pose = pose_of(Rotation.from_rotvec([1.2, 0.3, 0]), np.array([0.0, 0.0, depth]))
    drawn, window = solid.drawn(GRID, pose, np.array([0, 0, -1.0]))
    covered = drawn[..., 3]
    columns = window.left + np.arange(window.size[0])
    rows = window.top + np.arange(window.size[1])
    x = (covered.sum(axis=1) @ columns) / covered.sum(axis=(1, 2))
    y = (covered.sum(axis=2) @ rows) / covered.sum(axis=(1, 2))
    shift = GRID.baseline / depth
    x, y = x.reshape(3, 3), y.reshape(3, 3)
    np.testing.assert_allclose(np.diff(x, axis=1), -CAMERA.fx * shift, rtol=0.06)
    np.testing.assert_allclose(np.diff(y, axis=0), -CAMERA.fy * shift, rtol=0.06)
    assert covered.max() == pytest.approx(1, abs=1e-5)


def test_layers_mix_by_opacity():
    below = np.full((2, 2, 3), 0.8, np.float32)
    layer = np.concatenate([np.full((2, 2, 3), 0.05), np.full((2, 2, 1), 0.25)], axis=2)
    np.testing.assert_allclose(composited(below, layer.astype(np.float32)), 0.65, rtol=1e-6)


def test_a_bag_holds_all_frames_and_the_truth_is_beside_it(tmp_path, sequence):
    write_sequence(tmp_path / 'out', sequence)
    counts = {each.name: each.messages for each in topics(tmp_path / 'out' / 'bag')}
    assert counts == dict.fromkeys(
        ['/camera_pose', '/center/camera_info', '/center/image', '/views', '/views/camera_info',
         '/views/pupil'], 12)
    truth = json.loads((tmp_path / 'out' / 'truth.json').read_text())
    stamps = [each.time_ns for each in read(tmp_path / 'out' / 'bag') if each.topic == '/views']
    assert stamps == [each['stamp_ns'] for each in truth['frames']]
    np.testing.assert_allclose([each['object_to_camera'] for each in truth['frames']],
                               sequence.poses)
    assert [each['occluded'] for each in truth['frames']].count(True) == 2
    assert (tmp_path / 'out' / 'model.obj').exists()
    of = yaml.safe_load((tmp_path / 'out' / 'parameters.yaml').read_text())
    nodes = {each: values['ros__parameters'] for each, values in of.items()}
    dlv, pmcl = nodes['/**/dlv_node'], nodes['/**/pmcl_node']
    assert DlvSettings.make(dlv).views == SMALL.views
    given = {**pmcl}
    assert ObjectModel.load(given.pop('object')).radius == pytest.approx(sequence.model.radius)
    assert TrackingSettings.make(given).tracking == 'constant_velocity'
    # the labels are around all of the object, wherever it is
    depths = (sequence.model.vertices @ sequence.poses[:, 2:3, :3].transpose(0, 2, 1))[..., 0]
    depths += sequence.poses[:, 2, 3, None]
    assert dlv['near'] < depths.min()
    assert depths.max() < dlv['far']
    with pytest.raises(BagError, match='already there'):
        write_sequence(tmp_path / 'out', sequence)


def test_the_command_writes_one(tmp_path):
    call = ['scenes', 'sequence', '--frames', '2', '--occluded', '0', '--size', '48',
            '--kind', 'film', '-o', str(tmp_path / 'made')]
    done = CliRunner().invoke(main, [*call, '--seed', '3'])
    assert done.exit_code == 0, done.output
    assert json.loads((tmp_path / 'made' / 'truth.json').read_text())['kind'] == 'film'
    for name in ('model.obj', 'truth.json', 'parameters.yaml', 'bag/metadata.yaml'):
        (tmp_path / 'made' / name).unlink()  # as a run that was killed
    done = CliRunner().invoke(main, [*call, '--seed', '4'])
    assert f'{tmp_path / "made" / "bag"} is there already' in done.output
    done = CliRunner().invoke(main, [*call, '--seed', '4', '--force'])
    assert done.exit_code == 0, done.output
    assert json.loads((tmp_path / 'made' / 'truth.json').read_text())['seed'] == 4


@pytest.mark.parametrize(('values', 'message'), [
    ({'views': 4}, 'views: .*must be odd'), ({'object_speed': 1}, 'object_speed'),
    ({'kinds': ['glass']}, 'kinds'), ({'frames': 5, 'occluded': 4}, 'set occluded to 3 at most')])
def test_impossible_settings_are_refused(values, message):
    with pytest.raises(SettingsError, match=message):
        SequenceSettings.make(values)
