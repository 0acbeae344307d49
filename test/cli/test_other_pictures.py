"""Bags of posed views, a robot's bag and a BOP scene, as users call the commands on them."""

import csv
import json
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
import yaml
from click import UsageError
from command_line import pmcl
from scipy.spatial.transform import Rotation

from pmcl_ros.cli.sources import GivenSource
from pmcl_ros.evaluation.captures import Capture
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.readers.read import read_source
from pmcl_ros.messages import bags
from pmcl_ros.messages.bag_captures import pose_message, read_bag
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.cdr import cdr_from, type_name
from pmcl_ros.messages.image import picture_to_message

CAMERA = {'width': 160, 'height': 120, 'fx': 150.0, 'cx': 79.0, 'cy': 60.5}
STEP = 100_000_000  # ns
FEW = '--set', 'proposals=40,particles=48'


@pytest.fixture(scope='module')
def capture(tmp_path_factory):
    """An opaque glass with a stem, seen from two sides: each picture tells its pose."""
    folder = tmp_path_factory.mktemp('views')
    (folder / 'camera.yaml').write_text(yaml.safe_dump(CAMERA))
    pmcl('scenes', 'render', '--camera', folder / 'camera.yaml', '--cameras', 'arc:2:40',
         '--samples', 2, '--kind', 'opaque', '--seed', 3, '--count', 1, '-o', folder)
    return folder / '000003'


def region(capture):
    truth = Truth.load(capture / 'truth.json')
    return ['--roi', *truth.roi_center, *truth.roi_size]


def localized(source, capture, *more):
    done = pmcl('localize', source, *region(capture), '--json', *FEW, *more)
    return json.loads(next(line for line in done.output.splitlines() if line[:1] == '{'))


@pytest.fixture(scope='module')
def expected(capture):
    """What is found in the folder of the views."""
    found = localized(capture, capture, '--object', capture / 'model.obj')
    assert not found['lost']
    return found


def test_a_bag_of_posed_views_has_the_pose_of_their_folder(capture, expected, tmp_path, capsys):
    bag = tmp_path / 'bag'
    pmcl('bag', 'record', capture, bag)
    assert [each.name for each in bags.topics(bag)] == [
        '/posed_views/camera_info', '/posed_views/poses', '/posed_views/sigma', '/posed_views']
    found = localized(bag, capture, '--object', capture / 'model.obj')
    np.testing.assert_allclose(found['position'], expected['position'], atol=1e-5)
    capsys.readouterr()
    assert GivenSource(bag).open().posed
    frame = read_source(capture).header.frame_id
    assert capsys.readouterr().err == f'{bag}: 2 views, poses in the frame {frame!r}\n'
    for name in ('model.obj', 'truth.json'):
        shutil.copy(capture / name, bag)
    assert isinstance(Capture.load(bag).read(None), PosedViews)  # as pmcl evaluate does
    done = pmcl('bag', 'record', bag, tmp_path / 'smaller', '--shrink', 2, status=2)
    assert 'is a bag: --every and --shrink are for light fields' in done.output


def reported(source, capture, out, *more):
    """The line of a report that tells the pose."""
    done = pmcl('report', source, *region(capture), *more, '-o', out)
    return next(each for each in done.output.splitlines() if each.startswith('found at ('))


@pytest.fixture(scope='module')
def shown(capture, tmp_path_factory):
    """By the report of the views' folder."""
    return reported(capture, capture, tmp_path_factory.mktemp('report') / 'page.html')


def test_a_report_tells_the_pose_of_localize_in_the_same_frame(capture, shown):
    done = pmcl('localize', capture, *region(capture), '--object', capture / 'model.obj')
    assert shown in done.output.splitlines()


def test_of_several_objects_each_is_told_by_its_name(capture, expected, tmp_path):
    trimesh.creation.box((0.05, 0.07, 0.15)).export(tmp_path / 'carton.stl')
    told = localized(capture, capture, '--object', capture / 'model.obj', '--object',
                     tmp_path / 'carton.stl', '--out', tmp_path / 'out')['objects']
    assert told['carton']['lost']
    assert not told['model']['lost']
    np.testing.assert_allclose(told['model']['position'], expected['position'], atol=0.002)
    drawn = [cv2.imread(str(tmp_path / 'out' / f'overlay_{each:03d}.png')) for each in range(2)]
    assert (drawn[0] != drawn[1]).any()


def robots_bag(folder, views):
    """Images, camera_info and poses: the camera rests for 0.3 s at each view."""
    messages = []
    for number, view in enumerate(views.views):
        for k in range(number * 10, number * 10 + 4):
            at = Header(k * STEP, 'base')
            messages.append(pose_message('/arm/pose', at, view.camera_to_reference))
            for topic, message in (
                    ('/eye/camera_info', pinhole_to_message(at, view.pinhole)),
                    ('/eye/image', picture_to_message(at, view.displayed()))):
                messages.append(bags.Recorded(topic, type_name(type(message)), at.stamp_ns,
                                              cdr_from(message)))
    bags.record(folder, messages)
    return folder


def test_a_robot_s_bag_has_the_pose_of_the_views_where_it_rested(capture, expected, tmp_path):
    bag = robots_bag(tmp_path / 'bag', read_source(capture))
    exact = tmp_path / 'exact.yaml'
    exact.write_text('{sigma_position: 0, sigma_rotation: 0}')
    found = localized(bag, capture, '--object', capture / 'model.obj', '--collect', exact,
                      '--image-topic', '/eye/image')
    np.testing.assert_allclose(found['position'], expected['position'], atol=1e-5)
    views = read_bag(bag)
    assert [each.sigma for each in views.views] == [(0.001, 0.0035)] * 2
    pmcl('bag', 'record', bag, tmp_path / 'posed')
    again = read_bag(tmp_path / 'posed')
    for one, other in zip(again.views, views.views, strict=True):
        np.testing.assert_array_equal(one.displayed(), other.displayed())
        np.testing.assert_allclose(one.camera_to_reference, other.camera_to_reference, atol=1e-9)


def colmap_model(folder, views, scale):
    """The same views, where a unit is `scale` metres."""
    (folder / 'images').mkdir(parents=True)
    of = views[0].pinhole
    (folder / 'cameras.txt').write_text(f'1 PINHOLE {of.width} {of.height} {of.fx} {of.fy} '
                                        f'{of.cx + 0.5} {of.cy + 0.5}\n')
    lines = []
    for number, view in enumerate(views):
        cv2.imwrite(str(folder / 'images' / f'{number}.png'), view.displayed()[..., ::-1])
        back = np.linalg.inv(view.camera_to_reference)
        x, y, z, w = Rotation.from_matrix(back[:3, :3]).as_quat()
        place = ' '.join(map(str, back[:3, 3] / scale))
        lines += [f'{number} {w} {x} {y} {z} {place} 1 {number}.png', '']
    (folder / 'images.txt').write_text('\n'.join(lines) + '\n')


def test_a_colmap_model_and_a_robot_s_bag_are_evaluated_as_the_views(capture, tmp_path):
    captures, views = tmp_path / 'captures', read_source(capture)
    shutil.copytree(capture, captures / 'views')
    colmap_model(captures / 'colmap', views.views, 2.5)
    robots_bag(captures / 'bag', views)
    for name in ('bag', 'colmap'):
        for known in ('model.obj', 'truth.json'):
            shutil.copy(capture / known, captures / name)
    settings = tmp_path / 'collect.yaml'
    settings.write_text('{sigma_position: 0.5, gap: 0.3}')
    masks = tmp_path / 'masks'
    masks.mkdir()
    for number, view in enumerate(views.views):
        white = np.full(view.picture.shape[:2], 255, np.uint8)
        cv2.imwrite(str(masks / f'{number}.png.png'), white)
    pmcl('evaluate', captures, '--trials', 1, '--processes', 1, '--out', tmp_path / 'out',
         '--scale', 2.5, '--masks', masks, '--image-topic', '/eye/image', '--collect', settings,
         '--sigma-mm', 1, '--sigma-deg', 0.2, '--common', 0)
    assert set(json.loads((tmp_path / 'out' / 'settings.json').read_text())['files']) == {
        'collect.yaml', 'masks/0.png.png', 'masks/1.png.png'}
    rows = results(tmp_path / 'out')
    assert [each['capture'] for each in rows] == ['bag', 'colmap', 'views']
    assert not any(each['lost'] == 'True' for each in rows)
    for name in ('pose', 'told_mm'):
        bag, colmap, own = (np.array(each[name].split(), float) for each in rows)
        np.testing.assert_allclose(bag, own, rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose(colmap, own, rtol=1e-3, atol=1e-3)


def test_what_masks_of_a_colmap_model_cover_does_not_count(capture, expected, tmp_path):
    """A finger before the left half of the glass in one picture, the right half in the other."""
    folder, masks, covered = tmp_path / 'colmap', tmp_path / 'masks', []
    truth = Truth.load(capture / 'truth.json').pose[:3, 3]
    masks.mkdir()
    for number, view in enumerate(read_source(capture).views):
        into = np.linalg.inv(view.camera_to_reference)
        x, y = view.pinhole.project(into[None, :3, :3] @ truth + into[:3, 3])[0].astype(int)
        finger = np.zeros(view.picture.shape[:2], bool)
        finger[y - 25:y + 25, slice(x) if number == 0 else slice(x, None)] = True
        covered.append(replace(view, picture=np.where(finger[..., None], np.float32(0.9),
                                                      view.picture)))
        wider = cv2.dilate(finger.astype(np.uint8), np.ones((7, 7), np.uint8))
        cv2.imwrite(str(masks / f'{number}.png.png'), 255 * (1 - wider))
    colmap_model(folder, covered, 2.5)
    asked = folder, capture, '--object', capture / 'model.obj', '--scale', 2.5
    assert localized(*asked)['lost']
    found = localized(*asked, '--masks', masks)
    assert not found['lost']
    np.testing.assert_allclose(found['position'], truth, atol=0.002)
    assert found['evidence'] > 0.8 * expected['evidence']


def test_the_scale_of_a_colmap_model_is_asked_for_where_it_loses_the_object(
        capture, tmp_path, caplog):
    folder, views = tmp_path / 'colmap', read_source(capture).views
    colmap_model(folder, views, 2.5)
    apart = 1.4 * np.linalg.norm(np.subtract(*(
        each.camera_to_reference[:3, 3] for each in views)))
    done = pmcl('localize', folder, '--scale', 1.4 * 2.5, *region(capture), *FEW, '--object',
                capture / 'model.obj')
    assert done.stdout.startswith('lost')
    assert ('lost: is the metric scale of --scale or --distance right?'
            f' By it cameras are up to {apart:.3g} m apart') in caplog.text


def results(folder):
    with (folder / 'results.csv').open() as stream:
        return list(csv.DictReader(stream))


@pytest.mark.parametrize(('more', 'reason'), [
    (('--scale', 2), 'has no COLMAP model and no transforms.json: --scale and'),
    (('--pose-topic', '/tf'), 'has no bag: --image-topic'),
    (('--common', 0.5), 'give these too')])
def test_options_of_reading_without_effect_are_refused(capture, more, reason):
    done = pmcl('evaluate', capture.parent, *more, status=2)
    assert reason in ' '.join(done.output.split())


def test_topics_are_of_bags(capture):
    with pytest.raises(UsageError, match=r'is no bag: --image-topic'):
        GivenSource(capture, pose_topic='/tf').open()


@pytest.fixture
def scene(capture, tmp_path):
    """The same pictures as a BOP scene without poses, and the glass in millimetres."""
    views = read_source(capture).views
    folder = tmp_path / 'set' / 'test' / '000004'
    (folder / 'rgb').mkdir(parents=True)
    pinhole = views[0].pinhole
    for number, view in enumerate(views):
        cv2.imwrite(str(folder / 'rgb' / f'{number:06d}.png'), view.displayed()[..., ::-1])
    (folder / 'scene_camera.json').write_text(json.dumps(
        {str(number): {'cam_K': pinhole.matrix.ravel().tolist()} for number in range(2)}))
    mesh = trimesh.load_mesh(capture / 'model.obj', process=False)
    mesh.vertices *= 1000
    models = tmp_path / 'set' / 'models'
    models.mkdir()
    mesh.export(models / 'obj_000003.ply')
    (models / 'models_info.json').write_text(json.dumps(
        {'3': {'diameter': 100.0, 'symmetries_continuous': [{'axis': [0, 0, 1],
                                                             'offset': [0, 0, 0]}]}}))
    return folder


def in_first_camera(capture):
    """A region about the object, and its origin, in the first camera's frame."""
    truth = Truth.load(capture / 'truth.json')
    into = np.linalg.inv(read_source(capture).views[0].camera_to_reference)
    origin = (into @ truth.pose)[:3, 3]
    return ['--roi', *origin, 0.2, 0.2, 0.3], origin


def test_each_picture_of_a_scene_without_poses_is_localised_alone(scene, capture, tmp_path):
    roi, origin = in_first_camera(capture)
    known = scene, '--object-id', 3, *roi, *FEW
    done = pmcl('localize', *known, '--json', '--out', tmp_path / 'out')
    assert done.output.count('no camera poses: each picture is localised alone') == 1
    assert 'obj_000003.ply, in millimetres' in done.output
    assert {each.name for each in (tmp_path / 'out').glob('[!.]*')} == {
        'overlay_000000.png', 'overlay_000001.png'}
    pictures = json.loads(done.stdout.splitlines()[-1])['pictures']
    assert [each['file'] for each in pictures] == ['rgb/000000.png', 'rgb/000001.png']
    cameras = json.loads((scene / 'scene_camera.json').read_text())
    del cameras['0']
    (scene / 'scene_camera.json').write_text(json.dumps(cameras))
    line, = pmcl('localize', *known).stdout.splitlines()
    assert line.startswith('000001.png: ')
    x, y, z = pictures[1]['position']
    assert f'at ({x:.4f}, {y:.4f}, {z:.4f}) m' in line
    assert not pictures[0]['lost']
    found = np.array(pictures[0]['position'])
    off = found / found[2] - origin / origin[2]
    assert abs(off).max() < 0.005  # rad: one picture hardly tells the depth


def test_what_is_logged_of_a_picture_that_is_localised_alone_names_it(scene, capture, caplog):
    roi, _ = in_first_camera(capture)
    blank = scene / 'rgb' / '000001.png'
    cv2.imwrite(str(blank), np.full_like(cv2.imread(str(blank)), 255))
    pmcl('localize', scene, '--object-id', 3, *roi, *FEW)
    line, = (each for each in caplog.messages if 'is of one colour' in each)
    assert line.startswith('000001.png: ')


def test_a_scene_without_poses_is_reported_by_its_first_picture(scene, capture, tmp_path):
    roi, _ = in_first_camera(capture)
    told = [pmcl('report', source, '--object-id', 3, *roi, '-o', tmp_path / f'{number}.html')
            for number, source in enumerate((scene, scene / 'rgb' / '000000.png'))]
    assert 'no camera poses: the report is of' in told[0].stderr
    first, second = (next(line for line in each.stderr.splitlines() if ' at (' in line)
                     for each in told)
    assert first == second
    assert 'has no poses of its cameras' in pmcl(
        'bag', 'record', scene, tmp_path / 'bag', status=1).stderr


@pytest.fixture
def posed_scene(scene, capture):
    """The scene with the poses of its cameras."""
    of = json.loads((scene / 'scene_camera.json').read_text())
    for number, view in enumerate(read_source(capture).views):
        back = np.linalg.inv(view.camera_to_reference)
        of[str(number)] |= {'cam_R_w2c': back[:3, :3].ravel().tolist(),
                            'cam_t_w2c': (1000 * back[:3, 3]).tolist()}
    (scene / 'scene_camera.json').write_text(json.dumps(of))
    return scene


def test_a_next_view_is_told_of_an_object_of_a_scene_with_poses(posed_scene, capture):
    done = pmcl('next-view', posed_scene, '--object-id', 3, *region(capture), '--count', 3)
    assert done.stdout.startswith('now: ')


@pytest.mark.parametrize(('more', 'reason'), [
    ((), 'or --object-id of a BOP scene'),
    (('--object-id', 4), 'models/obj_000004.ply, the model of object 4; copy the data'),
    (('--object-id', 3, '--truth', 'scene_camera.json'), 'give one --object, and no --truth')])
def test_what_a_scene_cannot_do_is_told(scene, more, reason, monkeypatch):
    monkeypatch.chdir(scene)
    done = pmcl('localize', scene, '--roi', *'001111', *more, status=2 if more[1:2] != (4,) else 1)
    assert reason in ' '.join(done.output.split())


def with_truth(scene, capture):
    """Write scene_gt.json; the poses (4, 4) of the object before each camera [m]."""
    truth, views = Truth.load(capture / 'truth.json'), read_source(capture).views
    poses = [np.linalg.inv(each.camera_to_reference) @ truth.pose for each in views]
    (scene / 'scene_gt.json').write_text(json.dumps({str(number): [{
        'obj_id': 3, 'cam_R_m2c': each[:3, :3].ravel().tolist(),
        'cam_t_m2c': (1000 * each[:3, 3]).tolist()}] for number, each in enumerate(poses)}))
    return poses


def test_a_scene_with_truth_is_evaluated(scene, capture, tmp_path):
    """Without camera poses, each picture alone."""
    poses, out = with_truth(scene, capture), tmp_path / 'out'
    pmcl('evaluate', scene.parent, '--trials', 1, '--processes', 1, '--out', out)
    rows = results(out)
    assert [each['capture'] for each in rows] == [
        f'000004/{number:06d}/obj_000003' for number in (0, 1)]
    for row, pose in zip(rows, poses, strict=True):
        found = np.array(row['pose'].split(), float).reshape(3, 4)
        assert float(row['translation_mm']) == pytest.approx(
            1000 * np.linalg.norm(found[:, 3] - pose[:3, 3]), abs=1e-6)
        off = found[:, 3] / found[2, 3] - pose[:3, 3] / pose[2, 3]
        assert abs(off).max() < 0.03  # rad
    assert (out / 'bop_default.csv').read_text().splitlines()[0].startswith('scene_id,im_id')
    done = pmcl('evaluate', capture.parent, '--views', 2, status=2)
    assert 'are of those' in done.output


def test_a_scene_with_camera_poses_is_localised_in_its_world(posed_scene, capture, expected):
    found = localized(posed_scene, capture, '--object-id', 3)
    assert not found['lost']
    np.testing.assert_allclose(found['position'], expected['position'], atol=5e-4)


def test_a_scene_with_camera_poses_is_evaluated_by_all_views(posed_scene, capture, tmp_path):
    (first, _), out = with_truth(posed_scene, capture), tmp_path / 'out'
    pmcl('evaluate', posed_scene.parent, '--trials', 1, '--processes', 1, '--out', out)
    row, = results(out)
    assert (row['capture'], row['lost']) == ('000004/000000/obj_000003', 'False')
    found = np.array(row['pose'].split(), float).reshape(3, 4)[:, 3]
    off = np.linalg.norm(found - first[:3, 3])  # in the frame of the first camera
    assert float(row['translation_mm']) == pytest.approx(1000 * off, abs=0.01)
    assert off < 0.01


def transforms_json(folder, views):
    """The same views in the format of nerfstudio: a camera looks along -z, and y is up."""
    of = views[0].pinhole
    frames = []
    folder.mkdir()
    for number, view in enumerate(views):
        cv2.imwrite(str(folder / f'{number}.png'), view.displayed()[..., ::-1])
        pose = view.camera_to_reference @ np.diag([1.0, -1, -1, 1])
        frames.append({'file_path': f'{number}.png', 'transform_matrix': pose.tolist()})
    (folder / 'transforms.json').write_text(json.dumps({
        'fl_x': of.fx, 'fl_y': of.fy, 'cx': of.cx + 0.5, 'cy': of.cy + 0.5, 'w': of.width,
        'h': of.height, 'frames': frames}))


@pytest.fixture
def other(request, capture, tmp_path):
    """The views in another form, and the options that it needs."""
    kind, folder, views = request.param, tmp_path / 'other', read_source(capture).views
    if kind == 'BOP':
        return request.getfixturevalue('posed_scene'), ()
    if kind == 'COLMAP':
        colmap_model(folder, views, 2.5)
        return folder, ('--scale', 2.5)
    if kind == 'bag':
        pmcl('bag', 'record', capture, folder)
    else:
        transforms_json(folder, views)
    return folder, ()


def place_in(line):
    """What `reported` gives, as numbers [m]."""
    return [float(each) for each in line.split('(')[1].split(')')[0].split(',')]


@pytest.mark.parametrize('other', ['COLMAP', 'BOP', 'bag'], indirect=True)
def test_a_report_of_other_sources_tells_the_pose_of_the_views(other, capture, shown, tmp_path):
    source, options = other
    known = (('--object-id', 3) if (source / 'scene_camera.json').is_file()
             else ('--object', capture / 'model.obj'))
    found = reported(source, capture, tmp_path / 'page.html', *known, *options)
    np.testing.assert_allclose(place_in(found), place_in(shown), atol=5e-4)
    page = (tmp_path / 'page.html').read_text()
    assert 'View 1, with the outline' in page
    assert 'id="advice"' in page


@pytest.mark.parametrize('other', ['COLMAP', 'BOP', 'transforms.json'], indirect=True)
def test_a_bag_of_other_sources_has_the_same_views(other, capture, tmp_path):
    source, options = other
    pmcl('bag', 'record', source, tmp_path / 'bag', *options)
    for one, view in zip(read_bag(tmp_path / 'bag').views, read_source(capture).views,
                         strict=True):
        np.testing.assert_array_equal(one.displayed(), view.displayed())
        np.testing.assert_allclose(one.camera_to_reference, view.camera_to_reference, atol=1e-6)
        np.testing.assert_allclose(one.pinhole.matrix, view.pinhole.matrix, atol=1e-6)
