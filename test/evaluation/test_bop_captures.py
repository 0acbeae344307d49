"""Scenes of a BOP data set as captures: true poses in their frames, groups, what is left out."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from command_line import pmcl
from scipy.spatial.transform import Rotation
from test_recall import trial
from test_records import read_bop

from pmcl_ros.evaluation.bop_captures import BopChoice, bop_captures, bop_scenes
from pmcl_ros.evaluation.captures import select
from pmcl_ros.evaluation.records import settings, write_bop
from pmcl_ros.evaluation.trial_plan import TrialPlan
from pmcl_ros.evaluation.variants import Variant
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews, PoseErrors
from pmcl_ros.reading import Reading
from pmcl_ros.runtime.errors import LightFieldError, PmclError, SettingsError

PICTURES = 7
SHAPES = {1: trimesh.creation.cylinder(20, 90), 4: trimesh.creation.box((30, 50, 70))}  # mm


def random_pose(seed):
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(None, rng).as_matrix(), rng.uniform(-1, 1, 3)
    return pose


CAMERAS = [random_pose(seed) for seed in range(PICTURES)]  # camera to world, metres
OBJECTS = {1: random_pose(100), 4: random_pose(101)}  # object to world


def named(rotation, place, pose):
    return {rotation: pose[:3, :3].ravel().tolist(), place: (1000 * pose[:3, 3]).tolist()}


def entries(camera):
    return [{'obj_id': number} | named('cam_R_m2c', 'cam_t_m2c', np.linalg.inv(camera) @ pose)
            for number, pose in OBJECTS.items()]


def write_scene(folder, posed=True):
    (folder / 'rgb').mkdir(parents=True)
    models = folder.parents[1] / 'models'
    models.mkdir(exist_ok=True)
    for number, mesh in SHAPES.items():
        mesh.export(models / f'obj_{number:06d}.ply')
    cameras, truths = {}, {}
    for number, pose in enumerate(CAMERAS):
        cv2.imwrite(str(folder / 'rgb' / f'{number:06d}.png'), np.full((64, 80, 3), number, 'u1'))
        cameras[str(number)] = {'cam_K': [9, 0, 4.5, 0, 9, 3.5, 0, 0, 1]}
        if posed:
            cameras[str(number)] |= named('cam_R_w2c', 'cam_t_w2c', np.linalg.inv(pose))
        truths[str(number)] = entries(pose)
    (folder / 'scene_camera.json').write_text(json.dumps(cameras))
    (folder / 'scene_gt.json').write_text(json.dumps(truths))
    return folder


@pytest.fixture
def scene(tmp_path):
    return write_scene(tmp_path / 'set' / 'test' / '000012')


def change(scene, name, edit):
    values = json.loads((scene / name).read_text())
    edit(values)
    (scene / name).write_text(json.dumps(values))


def write_targets(path, *targets):
    path.write_text(json.dumps([dict(zip(('scene_id', 'im_id', 'obj_id'), each, strict=True))
                                for each in targets]))
    return path


def test_views_with_poses_are_localised_together_in_the_world(scene):
    assert bop_scenes(scene) == bop_scenes(scene.parent) == [scene]
    with pytest.raises(LightFieldError, match=f'no scene, .* evaluate all of {scene.parent}$'):
        bop_scenes(scene.parent.parent)
    found = bop_captures([scene], BopChoice(views=3))
    # Two groups spread over seven pictures, 0 2 4 and 1 3 5, two objects in each.
    assert [each.name for each in found] == [
        f'000012/{first:06d}/obj_{number:06d}' for first in (0, 1) for number in (1, 4)]
    assert [[int(path.stem) for path in each.pictures] for each in found[1:3]] == [
        [0, 2, 4], [1, 3, 5]]
    for each in found:
        np.testing.assert_allclose(each.truth.pose, OBJECTS[each.object_id], atol=1e-12)
        off = np.array(each.truth.roi_center) - each.truth.pose[:3, 3]
        assert 0 < abs(off).max() <= 0.2 * 0.16
    views = found[2].read(None)
    assert isinstance(views, PosedViews)
    for view, number in zip(views.views, (1, 3, 5), strict=True):
        np.testing.assert_allclose(view.camera_to_reference, CAMERAS[number], atol=1e-12)
        assert view.displayed().max() == number
    reading = Reading(shrink=2, errors=PoseErrors(0.001, 0.01))
    for view in replace(found[2], reading=reading).read(None).views:
        assert view.picture.shape[:2] == (32, 40)
        assert view.sigma == (0.001, 0.01)


@pytest.mark.parametrize(('posed', 'views'), [(False, 5), (True, 1)])
def test_a_picture_alone_has_the_truth_of_its_camera(tmp_path, posed, views):
    scene = write_scene(tmp_path / 'set' / 'test' / '000012', posed)
    found = bop_captures([scene], BopChoice(views, objects=(4,)))
    assert len(found) == PICTURES
    for each, camera in zip(found, CAMERAS, strict=True):
        np.testing.assert_allclose(each.truth.pose, np.linalg.inv(camera) @ OBJECTS[4],
                                   atol=1e-12)
    assert isinstance(found[3].read(None), PosedView)


def test_that_pictures_without_a_pose_have_all_localised_alone_is_told_once(scene, caplog):
    def unpose(cameras):
        for number in ('2', '5'):
            del cameras[number]['cam_R_w2c'], cameras[number]['cam_t_w2c']

    change(scene, 'scene_camera.json', unpose)
    assert len(bop_captures([scene], BopChoice(1, objects=(4,)))) == PICTURES
    assert caplog.messages == []
    for _ in range(2):
        found = bop_captures([scene], BopChoice(objects=(4,)))
        assert [len(each.pictures) for each in found] == [1] * PICTURES
    assert caplog.messages == [
        f'{scene}/scene_camera.json: 2 of 7 pictures have no pose of their camera, as 000002: '
        'each picture is localised alone; take those out to localise the others together']


def test_a_model_is_in_metres_with_its_symmetries(scene):
    captures = bop_captures([scene], BopChoice())
    glass, box = (each.load_model(each.model) for each in captures)
    assert glass.axis is not None
    assert box.axis is None
    np.testing.assert_allclose(np.ptp(box.vertices, axis=0), (0.03, 0.05, 0.07))
    assert captures[0].object != captures[1].object


def test_what_is_hardly_visible_and_what_is_no_target_is_left_out(scene, tmp_path):
    shares = {str(number): [{'visib_fract': 0.05 if number < 6 else 1.0}, {'visib_fract': 0.5}]
              for number in range(PICTURES)}
    (scene / 'scene_gt_info.json').write_text(json.dumps(shares))
    alone = bop_captures([scene], BopChoice(views=1))
    assert [each.bop_numbers for each in alone if each.object_id == 1] == [(12, 6, 1)]
    # On average 0.19 of the seven, 0.05 of the first three.
    assert {each.object_id for each in bop_captures([scene], BopChoice(views=7))} == {1, 4}
    assert {each.object_id for each in bop_captures([scene], BopChoice(views=3))} == {4}
    targets = tmp_path / 'targets.json'
    targets.write_text(json.dumps([{'scene_id': 12, 'im_id': 3, 'obj_id': 4, 'inst_count': 1},
                                   {'scene_id': 11, 'im_id': 2, 'obj_id': 4, 'inst_count': 1}]))
    chosen = bop_captures([scene], BopChoice(views=1, targets=targets))
    assert [each.bop_numbers for each in chosen] == [(12, 3, 4)]
    # A picture that is left alone has the truth of its camera, whatever else the scene has.
    lone, = bop_captures([scene], BopChoice(views=5, targets=targets))
    assert isinstance(lone.read(None), PosedView)
    np.testing.assert_allclose(lone.truth.pose, np.linalg.inv(CAMERAS[3]) @ OBJECTS[4], atol=1e-12)


def test_pictures_come_by_number_whatever_the_order_of_the_file(scene):
    cameras = json.loads((scene / 'scene_camera.json').read_text())
    (scene / 'scene_camera.json').write_text(json.dumps(dict(reversed(cameras.items()))))
    for each in bop_captures([scene], BopChoice(views=3)):
        shown = [view.displayed().max() for view in each.read(None).views]
        assert shown == [int(path.stem) for path in each.pictures]


def test_visibility_is_that_of_the_object_though_pictures_list_it_in_other_places(scene):
    change(scene, 'scene_gt.json', lambda values: values['2'].reverse())
    change(scene, 'scene_gt.json', lambda values: values['4'].pop(0))
    shares = {'0': [{'visib_fract': 0.1}, {'visib_fract': 0.3}],
              '2': [{'visib_fract': 0.0}, {'visib_fract': 0.1}], '4': [{'visib_fract': 0.9}]}
    (scene / 'scene_gt_info.json').write_text(json.dumps(shares))
    found = bop_captures([scene], BopChoice(views=3))
    # Object 1: 0.1, 0.1, and not there. Object 4: 0.3, 0.0 and 0.9.
    assert [each.object_id for each in found if each.pictures[0].stem == '000000'] == [4]


def test_targets_that_the_first_picture_of_a_group_does_not_have_are_told_once(
        scene, tmp_path, caplog):
    targets = write_targets(tmp_path / 'targets.json', (12, 1, 1), (12, 3, 1), (12, 3, 4),
                            (12, 5, 4))
    def found(views, objects=()):
        caplog.clear()
        return [each.bop_numbers[1:] for each in bop_captures(
            [scene], BopChoice(views, objects, targets))]
    assert found(3) == [(1, 1)]
    assert caplog.messages == ['targets that are not looked for, as the first picture of their '
                               'group does not have them: 1; --views 1 takes all']
    assert found(3, (1,)) == [(1, 1)]
    assert caplog.messages == []
    assert found(1) == [(1, 1), (3, 1), (3, 4), (5, 4)]
    assert caplog.messages == []


@pytest.mark.parametrize('folder', ['.', 'rgb/..'])
def test_the_scene_of_the_working_directory_has_its_number(scene, monkeypatch, folder):
    monkeypatch.chdir(scene)
    for each in bop_captures(bop_scenes(Path(folder)), BopChoice(views=3)):
        assert each.bop_numbers[0] == 12
        assert each.name.startswith('000012/')


def test_copies_of_an_object_are_captures_of_their_own(scene):
    change(scene, 'scene_gt.json', lambda values: values['0'].append(values['0'][1]))
    names = [each.name for each in bop_captures([scene], BopChoice(views=7))]
    assert names == [f'000012/000000/{each}' for each in (
        'obj_000001', 'obj_000004', 'obj_000004_1')]
    captures = bop_captures([scene], BopChoice(views=7))
    assert captures[1].truth.roi_center != captures[2].truth.roi_center


def test_an_object_in_the_scene_is_not_looked_for_as_a_wrong_one(tmp_path):
    """Of two scenes with the same objects there is no other object to look for."""
    scenes = [write_scene(tmp_path / 'set' / 'test' / name) for name in ('000001', '000002')]
    change(scenes[0], 'scene_gt.json', lambda values: [each.pop(0) for each in values.values()])
    found = tuple(bop_captures(scenes, BopChoice(views=7)))
    jobs = TrialPlan(found, (Variant('default'),), (0,), found).jobs()
    wrong = [job for job in jobs if job.sought.object_id != job.capture.object_id]
    assert [(job.capture.name, job.sought.object_id) for job in wrong] == [
        ('000001/000000/obj_000004', 1)]
    # Nor one that is left out, as it is hardly visible.
    change(scenes[0], 'scene_gt.json', lambda values: values['3'].append(
        {'obj_id': 1} | named('cam_R_m2c', 'cam_t_m2c', np.eye(4))))
    found = tuple(bop_captures(scenes, BopChoice(views=7)))
    jobs = TrialPlan(found, (Variant('default'),), (0,), found).jobs()
    assert all(job.sought.object_id == job.capture.object_id
               for job in jobs if job.capture.source == scenes[0])


def test_files_of_results_have_the_numbers_of_the_data_set(scene, tmp_path):
    captures = tuple(bop_captures([scene], BopChoice(views=3)))
    plan = TrialPlan(captures, (Variant('default'),), (0,))
    pose = tuple(random_pose(7)[:3].ravel())
    more = trial(capture=captures[3].name, pose=pose, seed=1)  # a toolkit would take the best
    # The toolkit asks for the time of a picture, whatever was found in it.
    other = trial(capture=captures[2].name, pose=pose, lost=True, seconds=3)
    own = trial(capture=captures[3].name, pose=pose, seconds=2, dlv_seconds=1, decode_seconds=0)
    write_bop(tmp_path / 'bop.csv', [other, own, more], plan)
    row, = read_bop(tmp_path / 'bop.csv')
    assert (row['scene_id'], row['im_id'], row['obj_id']) == (12, 1, 4)
    assert row['time'] == 6 + other.dlv_seconds + other.decode_seconds
    used = settings(plan, {}, 1, 1.0)['captures'][3]
    assert (used['scene_id'], used['obj_id']) == (12, 4)
    assert set(used['sha256']) == {
        'scene_camera.json', 'scene_gt.json', '../../models/obj_000004.ply',
        *(f'rgb/{number:06d}.png' for number in (1, 3, 5))}


@pytest.mark.parametrize(('edit', 'reason'), [
    (lambda values: values['0'][0].pop('obj_id'), 'picture 0: obj_id None is no number'),
    (lambda values: values['0'][0].update(cam_t_m2c=[1, 2]), 'expected 9 and 3 numbers, got 9'),
    (lambda values: values['0'][1].update(cam_R_m2c=[[9] * 3] * 3), 'is no rotation'),
    (lambda values: values['0'][0].update(obj_id=9), r'no folder above .*/obj_000009\.ply'),
    (lambda values: values.update({'0': 3}), 'expected numbers of pictures')])
def test_a_broken_truth_is_refused_in_one_line(scene, edit, reason):
    change(scene, 'scene_gt.json', edit)
    with pytest.raises(PmclError, match=reason) as caught:
        bop_captures([scene], BopChoice())
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('text', ['[1]', '[{"scene_id": 1}]', '{', '3'])
def test_a_list_of_targets_that_is_none_is_refused(scene, tmp_path, text):
    (tmp_path / 'targets.json').write_text(text)
    with pytest.raises(PmclError, match=r'targets\.json'):
        bop_captures([scene], BopChoice(targets=tmp_path / 'targets.json'))


def test_names_that_are_not_there_are_told_with_some_that_are(scene):
    captures = bop_captures([scene], BopChoice(views=1))
    assert select(captures, [captures[2].name], scene) == [captures[2]]
    with pytest.raises(SettingsError, match=r'no capture glass; there are 000012/000000/.*'):
        select(captures, ['glass'], scene)


def test_which_pictures_are_taken_is_said_in_one_way(scene, tmp_path):
    done = pmcl('evaluate', scene, '--every', 2, '--out', tmp_path / 'out', status=2)
    assert 'are chosen by --views and --targets; leave out' in ' '.join(done.stderr.split())
