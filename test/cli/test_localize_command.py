"""`pmcl localize --set ...`, in this process: the volume on the GPU is the one in memory."""

import json

import numpy as np
import pytest
import trimesh
from command_line import Runner
from scipy.spatial.transform import Rotation
from tiny_capture import QUICK, write_capture

from pmcl_ros.cli.localize import localize
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.runtime.errors import SettingsError


@pytest.fixture(scope='module')
def capture(tmp_path_factory):
    folder = tmp_path_factory.mktemp('tiny') / 'glass'
    write_capture(folder, seed=1)
    return folder


def run(capture, *more):
    truth = Truth.load(capture / 'truth.json')
    numbers = map(str, [*truth.roi_center, *truth.roi_size])
    return Runner().invoke(localize, [
        str(capture / 'views.npz'), '--object', str(capture / 'model.obj'), '--roi', *numbers,
        '--json', *map(str, more)], catch_exceptions=False)


def test_a_volume_on_the_gpu_gives_the_same_pose_and_pictures(capture, tmp_path):
    found, depths = [], []
    for back_end in ('gl', 'numba'):
        out = tmp_path / back_end
        done = run(capture, '--set', f'{QUICK},renderer=gl,back_end={back_end}', '--out', out)
        assert done.exit_code == 0
        found.append(json.loads(done.stdout))
        depths.append((out / 'depth.png').read_bytes())
    first, second = found
    # The search looks at the edges, which are the same; the volume is drawn.
    assert first['position'] == second['position']
    assert first['orientation_xyzw'] == second['orientation_xyzw']
    assert len(depths[0]) == pytest.approx(len(depths[1]), rel=0.05)
    truth = Truth.load(capture / 'truth.json').pose
    assert np.linalg.norm(np.subtract(first['position'], truth[:3, 3])) < 0.03


@pytest.mark.parametrize(('changes', 'message'), [
    ('row=faithful', 'there are no rows here; say --mode')])
def test_rows_are_no_parameters_here(capture, changes, message):
    done = run(capture, '--set', changes)
    assert done.exit_code == 2
    assert message in done.output


def test_values_may_be_set_one_by_one(capture):
    faces = ['interface_point=[0, 0, 0.9, 0, 0.5, 0]', 'interface_normal=[0, 0, -1, 0, -1, 0]']
    together = run(capture, '--set', ','.join([QUICK, 'interface_index=1.33', *faces]))
    apart = run(capture, '--set', QUICK, '--set', 'interface_index=1.33',
                *(each for face in faces for each in ('--set', face)))
    assert together.exit_code == apart.exit_code == 0, apart.output
    assert json.loads(together.stdout)['position'] == json.loads(apart.stdout)['position']
    with pytest.raises(SettingsError, match='three numbers of each plane: not 6 and 3'):
        run(capture, '--set', 'interface_index=1.33', '--set', faces[0])


def test_several_objects_are_told_by_their_names_and_the_missing_one_lost(capture, tmp_path):
    carton = tmp_path / 'carton.stl'
    trimesh.creation.box((0.02, 0.09, 0.04)).export(carton)
    done = run(capture, '--object', carton, '--set', f'{QUICK},renderer=numba', '--out', tmp_path)
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert [*told['objects']] == ['model', 'carton']
    assert told['objects']['carton']['lost']
    truth = Truth.load(capture / 'truth.json').pose
    assert np.linalg.norm(np.subtract(told['objects']['model']['position'], truth[:3, 3])) < 0.03
    assert told['interpenetration'] <= 0.002
    assert (tmp_path / 'overlay.png').stat().st_size > 1000
    with_truth = run(capture, '--object', carton, '--truth', capture / 'truth.json')
    assert with_truth.exit_code == 2
    assert 'give one --object' in with_truth.output


def test_the_region_is_all_that_is_in_view_or_what_stands_on_a_table(capture, tmp_path):
    truth = Truth.load(capture / 'truth.json').pose
    known = [capture / 'views.npz', '--object', capture / 'model.obj', '--json', '--set', QUICK]

    def found(*region, status=0):
        done = Runner().invoke(localize, [str(each) for each in (*known, *region)],
                                  catch_exceptions=False)
        assert done.exit_code == status, done.output
        return done

    # The cup, whose origin is at its bottom, stands on the plane of that.
    for region in (['--depths', 0.3, 0.55], ['--table', *truth[:3, 3], *truth[:3, 2]]):
        done = found(*region)
        assert np.linalg.norm(np.subtract(json.loads(done.stdout)['position'],
                                          truth[:3, 3])) < 0.03
        printed = done.stderr.partition('--roi ')[2].split()[:6]
        assert len([float(each) for each in printed]) == 6
    done = found(status=2)
    assert '--roi CX CY CZ SX SY SZ' in done.output
    assert '--depths 0.3 0.9' in done.output
    assert '--table X Y Z NX NY NZ' in done.output
    table = ['--table', *truth[:3, 3], *truth[:3, 2]]
    done = found(*table, '--tilt', 0, 20)
    upright = Rotation.from_quat(json.loads(done.stdout)['orientation_xyzw']).as_matrix()[:, 2]
    assert upright @ truth[:3, 2] > np.cos(np.deg2rad(20))
    # Upside down, what stands upright is not found.
    done = found(*table, '--up', *-truth[:3, 2], '--tilt', 0, 20)
    assert json.loads(done.stdout)['lost']
    over = Rotation.from_quat(json.loads(done.stdout)['orientation_xyzw']).as_matrix()[:, 2]
    assert over @ truth[:3, 2] < -np.cos(np.deg2rad(20.1))
    done = found('--depths', 0.3, 0.55, '--tilt', 0, 20, status=2)
    assert 'to --up X Y Z, or to the normal of --table' in done.output
    done = found(*table, '--up', 0, 0, 1, status=2)
    assert 'give --tilt 0 30 for what stands' in done.output
    done = found('--roi', *'001111', '--depths', 0.3, 0.6, status=2)
    assert 'give one' in done.output
    done = found('--roi', 0, 0, 400, 150, 150, 200, status=2)
    assert '--roi is 200 m wide: it is in metres, 0.2 for 200 mm' in done.output


def test_an_object_that_is_not_there_has_no_error(capture, tmp_path):
    values = json.loads((capture / 'truth.json').read_text())
    truth = tmp_path / 'truth.json'
    truth.write_text(json.dumps(values | {'empty': True}))
    done = run(capture, '--set', QUICK, '--truth', truth)
    assert f'the object is not there, says {truth}' in done.stderr
    assert 'off by' not in done.stderr
