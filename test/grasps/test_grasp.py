import numpy as np
import pytest
import trimesh
import yaml
from click.testing import CliRunner

from pmcl_ros.cli import main
from pmcl_ros.grasps.grasp import GraspFile
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.runtime.errors import ObjectModelError, SettingsError

FETCH = GripperSettings()


@pytest.fixture
def file(tmp_path, vessels, made, mesh_of):
    """A grasp file beside a folder with its mesh."""
    (tmp_path / 'meshes').mkdir()
    mesh_of(vessels['cup']).export(tmp_path / 'meshes' / 'cup.obj')
    path = tmp_path / 'cup.grasps.yaml'
    GraspFile.write(path, tmp_path / 'meshes' / 'cup.obj', FETCH, made['cup'], 'a cup')
    return path


def test_what_is_written_is_read(file, made):
    model, gripper, grasps = GraspFile.read(file)
    assert (model.name, gripper) == ('cup', FETCH)
    assert yaml.safe_load(file.read_text())['object'] == 'meshes/cup.obj'
    assert '# a cup\n' in file.read_text()
    assert len(grasps) == len(made['cup'])
    for one, other in zip(grasps, made['cup'], strict=True):
        assert (one.name, one.kind) == (other.name, other.kind)
        np.testing.assert_allclose(one.pose, other.pose, atol=1e-6)
        assert (one.width, one.opening) == pytest.approx((other.width, other.opening), abs=1e-6)


def test_a_hand_written_file_needs_no_gripper(file):
    file.write_text(yaml.safe_dump({'object': 'meshes/cup.obj', 'grasps': [
        {'name': 'mine', 'position': [0, 0, 0.05], 'approach': [0, 0, -1], 'closing': [0, 1, 0],
         'width': 0.066, 'opening': 0.1}]}))
    _, gripper, (grasp,) = GraspFile.read(file)
    assert gripper == FETCH
    np.testing.assert_array_equal(grasp.pose[:3, 2], [1, 0, 0])


def test_vectors_that_are_rounded_give_a_rotation(file):
    file.write_text(yaml.safe_dump({'object': 'meshes/cup.obj', 'grasps': [
        {'name': 'mine', 'position': [0, 0, 0.05], 'approach': [0.0005, 0.6, -0.8006],
         'closing': [0.0004, 0.8, 0.5998], 'width': 0.066, 'opening': 0.1}]}))
    _, _, (grasp,) = GraspFile.read(file)
    np.testing.assert_allclose(grasp.pose[:3, :3] @ grasp.pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(grasp.pose[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(grasp.closing, [0, 0.8, 0.6], atol=2e-3)
    np.testing.assert_allclose(np.cross(grasp.approach, [0.0005, 0.6, -0.8006]), 0, atol=1e-12)


@pytest.mark.parametrize(('change', 'reason'), [
    ({'approach': [0.0, 0, -0.5]}, r"'(\w+)': approach .*unit vectors"),
    ({'approach': [0.0, 0, -1], 'closing': [0, 0.6, 0.8]}, 'right angle'),
    ({'approach': [0.0, 0, -1], 'closing': [0, 0.6, -0.8]}, 'right angle'),
    ({'width': 0.08, 'opening': 0.08}, r'width 0\.08 m must be smaller than opening'),
    ({'width': 0.2}, r'width 0\.2 m must be smaller than opening'),
    ({'opening': 0.3}, "larger than the gripper's 0.1 m"),
    ({'name': 'rim_top'}, 'several grasps are called rim_top'),
    ({'kind': 'sideways'}, "kind: Input should be 'rim', 'side'"),
    ({'tilt': 1}, 'tilt: there is no such key'),
])
def test_what_is_wrong_is_told(file, change, reason):
    values = yaml.safe_load(file.read_text())
    values['grasps'][0] |= change
    file.write_text(yaml.safe_dump(values))
    with pytest.raises(SettingsError, match=reason):
        GraspFile.read(file)


def test_a_missing_mesh_is_told(file):
    (file.parent / 'meshes' / 'cup.obj').unlink()
    with pytest.raises(ObjectModelError, match=r'no mesh file .*cup\.obj'):
        GraspFile.read(file)


def run(*arguments):
    return CliRunner().invoke(main, ['grasps', *map(str, arguments)])


def test_the_command_lists_writes_and_draws(file, tmp_path, made):
    import cv2
    mesh, out, picture = (tmp_path / each for each in ('meshes/cup.obj', 'new/cup.yaml',
                                                       'new/cup.png'))
    done = run(mesh, '--out', out, '--picture', picture)
    assert done.exit_code == 0, done.output
    for grasp in made['cup']:
        assert grasp.name in done.output
    _, _, grasps = GraspFile.read(out)
    assert [each.name for each in grasps] == [each.name for each in made['cup']]
    drawn = cv2.imread(str(picture))
    rows = -(-len(grasps) // 4)
    height, width = drawn.shape[0] // rows, drawn.shape[1] // 4
    inside = [drawn[height * (k // 4):, width * (k % 4):][:height, :width].reshape(-1, 3)
              for k in range(len(grasps))]
    for each in inside:  # glass, and fingers, in every drawing
        assert (each == (178, 114, 0)).all(axis=1).sum() > 100
        assert (each == (0, 94, 213)).all(axis=1).sum() > 100


def test_the_command_takes_a_gripper_and_says_why_it_does_not(file, tmp_path):
    gripper, box = tmp_path / 'gripper.yaml', tmp_path / 'box.obj'
    FETCH.model_copy(update={'opening': 0.004}).save(gripper)
    done = run(tmp_path / 'meshes/cup.obj', '--gripper', gripper)
    assert done.exit_code == 1
    assert "no grasp of 'cup' leaves 3 mm of room" in done.output
    trimesh.creation.box((0.05, 0.06, 0.1)).export(box)
    done = run(box)
    assert done.exit_code == 1
    assert 'no surface of revolution' in done.output
