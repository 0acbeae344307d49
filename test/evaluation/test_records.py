"""What a run leaves on disk, read back as other programs would."""

import csv
import json

import numpy as np
import pytest
from pmcl_scenes import bracket
from scipy.spatial.transform import Rotation
from test_recall import trial
from tiny_capture import write_capture

from pmcl_ros.evaluation.captures import find_captures
from pmcl_ros.evaluation.records import TrialsFile, settings, write_bop
from pmcl_ros.evaluation.trial_plan import TrialPlan
from pmcl_ros.evaluation.variants import Variant


@pytest.fixture
def plan(tmp_path):
    for name, mesh in (('a', None), ('b', bracket()), ('c', None)):
        write_capture(tmp_path / name, mesh=mesh)
    return TrialPlan(tuple(find_captures(tmp_path)),
                     (Variant('default'), Variant.parse('moves=2')), (0, 1))


def random_pose(seed):
    rng = np.random.default_rng(seed)
    return np.concatenate([Rotation.random(None, rng).as_matrix(), rng.random((3, 1))], axis=1)


def read_bop(path):
    """As bop_toolkit_lib.inout.load_bop_results reads it, word by word."""
    results = []
    with path.open() as stream:
        for line_id, line in enumerate(stream):
            if line_id == 0:
                assert line.strip() == 'scene_id,im_id,obj_id,score,R,t,time'
                continue
            elements = line.strip().split(',')
            assert len(elements) == 7
            results.append({
                'scene_id': int(elements[0]), 'im_id': int(elements[1]),
                'obj_id': int(elements[2]), 'score': float(elements[3]),
                'R': np.array(list(map(float, elements[4].split())), float).reshape(3, 3),
                't': np.array(list(map(float, elements[5].split())), float).reshape(3, 1),
                'time': float(elements[6])})
    return results


def test_bops_file_holds_the_poses_in_millimetres(plan, tmp_path):
    poses = [random_pose(seed) for seed in range(3)]
    trials = [trial(capture='b', sought='b', seed=4, pose=tuple(poses[0].ravel()), score=2.5,
                    seconds=1.5, dlv_seconds=0.25, decode_seconds=0.125),
              trial(capture='c', sought='c', seed=0, pose=tuple(poses[1].ravel())),
              trial(capture='c', sought='c', seed=1, pose=tuple(poses[1].ravel()), lost=True),
              trial(capture='a', sought='b', wrong=True, pose=tuple(poses[2].ravel()))]
    write_bop(tmp_path / 'bop.csv', trials, plan)
    first, second = read_bop(tmp_path / 'bop.csv')
    # a and c are the same mesh, so the same object; scenes count captures.
    assert [(each['scene_id'], each['im_id'], each['obj_id']) for each in (first, second)] == [
        (1, 4, 2), (2, 0, 1)]
    np.testing.assert_array_equal(first['R'], poses[0][:, :3])
    np.testing.assert_allclose(first['t'], 1e3 * poses[0][:, 3:], rtol=1e-15)
    assert (first['score'], first['time']) == (2.5, 1.875)


def test_trials_are_on_disk_as_soon_as_they_are_added(tmp_path):
    pose = tuple(random_pose(0).ravel().tolist())
    path = tmp_path / 'trials.csv'
    with TrialsFile(path) as file:
        for seed in range(3):
            file.add(trial(1 / 3, seed=seed, pose=pose, lost=seed == 2))
            with path.open() as stream:
                rows = list(csv.DictReader(stream))
            assert len(rows) == seed + 1
    assert [each['lost'] for each in rows] == ['False', 'False', 'True']
    assert float(rows[0]['translation_mm']) == 1 / 3
    assert tuple(map(float, rows[0]['pose'].split())) == pose


def test_settings_say_what_a_table_was_made_with(plan, tmp_path):
    white = tmp_path / 'white.RAW'
    white.write_bytes(b'white')
    values = json.loads(json.dumps(settings(plan, {'white.RAW': white, 'all': tmp_path}, 2, 3.0)))
    assert values['rows']['moves=2']['search']['moves'] == 2
    assert values['rows']['default']['search']['moves'] != 2
    assert [each['obj_id'] for each in values['captures']] == [1, 2, 1]
    assert set(values['captures'][0]['sha256']) == {'model.obj', 'truth.json', 'views.npz'}
    assert list(values['files']) == ['white.RAW']
    assert {'numpy', 'numba', 'moderngl'} <= set(values['libraries'])
    assert values['machine']['cores'] >= 1
