"""A camera that goes around an object gives poses in the base frame, better ones as views come."""

import re
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
import rclpy
import trimesh
import yaml
from command_line import Runner
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from harness import ACTIVATE, CONFIGURE, ROOT, Process
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32MultiArray
from std_srvs.srv import Trigger
from test_sweep_driver import BASE, SECOND, START, Robot, info_of, pose_of, record
from visualization_msgs.msg import MarkerArray

from pmcl_ros.cli import main
from pmcl_ros.dlv.plane_sweep import build_volume_of_views
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.se3 import rotation_angle
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.readers.pictures import read_picture
from pmcl_ros.lightfield.readers.read import read_source
from pmcl_ros.lightfield.sweep.frame import Lens, SweepFrame
from pmcl_ros.lightfield.sweep.settings import ViewSettings
from pmcl_ros.lightfield.sweep.view_collection import ViewCollection
from pmcl_ros.messages import bags
from pmcl_ros.messages.image import picture_from
from pmcl_ros.messages.pose import (
    estimate_to_transform,
    pose_from,
    pose_with_covariance_from,
    transform_from,
)
from pmcl_ros.messages.posed_views import posed_views_from, posed_views_to_messages
from pmcl_ros.messages.volume import volume_from
from pmcl_ros.nodes.pmcl_node import PmclNode
from pmcl_ros.nodes.runtime.base import BIG, LATCHED, SMALL
from pmcl_ros.pipeline import Pipeline
from pmcl_ros.pmcl.multi_view.next_view import position_sigma
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings

CAMERA = '{width: 240, height: 180, fx: 225, cx: 121, cy: 89}'
TOPICS = ((CameraInfo, 'posed_views/camera_info', SMALL), (PoseArray, 'posed_views/poses', SMALL),
          (Image, 'posed_views/sigma', SMALL), (Image, 'posed_views', BIG))


@pytest.fixture(scope='module')
def scene(tmp_path_factory):
    """A folder with four views of an opaque object, over 45 degrees."""
    folder = tmp_path_factory.mktemp('scene')
    (folder / 'camera.yaml').write_text(CAMERA)
    result = Runner().invoke(main, [
        'scenes', 'render', '--camera', str(folder / 'camera.yaml'), '--cameras', 'arc:4:45',
        '--samples', '1', '--kind', 'opaque', '--seed', '4', '--count', '1', '-o',
        str(folder / 'out')])
    assert result.exit_code == 0, result.output
    return folder / 'out' / '000004'


@pytest.fixture(scope='module')
def frames(scene):
    """What a wrist camera takes of it, a second apart, with poses in the base frame."""
    views = read_source(scene / 'views.yaml').views
    return [SweepFrame(f'{k}', START + k * SECOND, read_picture(scene / f'{k:03d}.png'),
                       Lens(view.pinhole), BASE @ view.camera_to_reference)
            for k, view in enumerate(views)]


@pytest.fixture(scope='module')
def truth(scene):
    return BASE @ Truth.load(scene / 'truth.json').pose


@pytest.fixture(scope='module')
def search(scene):
    """The parameters of pmcl_node; the region is in the base frame."""
    centre = BASE[:3, :3] @ Truth.load(scene / 'truth.json').roi_center + BASE[:3, 3]
    return {'object': str(scene / 'model.obj'), 'roi_center': centre.tolist(),
            'roi_size': [0.12, 0.12, 0.12], 'proposals': 60}


def off(pose, truth):
    return pose_error(pose, truth, Symmetry(np.array([0.0, 0, 1])))


def sent_by(frames, views):
    """Posed views of the first so many frames, as they go over the wire."""
    collection = ViewCollection(ViewSettings(), 'base_link')
    for each in frames[:views]:
        assert collection.add(each)
    return posed_views_to_messages(collection.assemble().source)


def look_until_sure(*options):
    script = [sys.executable, str(ROOT / 'examples' / 'look_until_sure.py'), '--settle', '0']
    return subprocess.Popen([*script, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            text=True)


def nearest(frames, goal):
    """The frame whose camera is nearest to where it was sent."""
    place = pose_from(goal)[1][:3, 3]
    return min(frames, key=lambda each: np.linalg.norm(each.position - place))


def test_each_picture_that_is_asked_for_makes_the_pose_surer(
        tmp_path, user, frames, truth, search):
    parameters = tmp_path / 'parameters.yaml'
    parameters.write_text(yaml.safe_dump({
        'sweep_driver': {'ros__parameters': {'poses': 'topic', 'gap': 2.0, 'most_views': 4,
                                             'movement': 5.0, 'patience': 60.0,
                                             'collect': 'grid'}},
        'pmcl_node': {'ros__parameters': search | {'source': 'light_field'}}}))
    with Process(tmp_path, 'pmcl_ros.nodes.bringup', '--params-file', parameters,
                 '--views', 'service') as chain:
        poses = user.listen(PoseWithCovarianceStamped, 'pose_with_covariance', SMALL)
        pictures, sigmas, nexts, candidates = (user.listen(kind, topic, SMALL) for kind, topic in (
            (Image, 'overlay'), (Image, 'pose/sigma_by_views'), (PoseStamped, 'next_view'),
            (Image, 'next_view/candidates')))
        volumes = user.listen(Float32MultiArray, 'dlv', BIG)
        user.wait(lambda: 'active: ' in chain.log or not chain.alive(), 'the chain')
        early = user.call(Trigger, '/pmcl_node/next_view', Trigger.Request())
        assert not early.success
        assert 'no pose has been found' in early.message
        robot = Robot(user)
        robot.info.publish(info_of(frames[0]))
        user.delivered(robot.info)
        robot.shoot(frames[0])  # nobody asked
        for number, frame in enumerate(frames, 1):
            assert robot.ask('take').success
            robot.shoot(frame)
            # Of views that come while it makes a volume dlv_node keeps the last.
            user.wait(lambda number=number: len(poses) == len(volumes) == number - 1,
                      f'pose and volume {number - 1}')
        user.wait(lambda: len(pictures) == len(sigmas) == 3, 'pictures')
        assert 'searched with views added (1) from the last pose' in chain.log
        answer = user.call(Trigger, '/pmcl_node/next_view', Trigger.Request())
        user.wait(lambda: nexts and candidates, 'the next view')
        assert robot.ask('start').success
        again = [replace(each, stamp_ns=each.stamp_ns + 60 * SECOND) for each in frames]
        for each in again[:2]:
            assert robot.ask('take').success
            robot.shoot(each)
        user.wait(lambda: len(poses) == 4, 'a pose by the first two')
        with look_until_sure('--looks', '1', '--sigma', '1e-6') as unsure:
            goals = []
            user.node.create_subscription(PoseStamped, 'camera_goal', goals.append, LATCHED)
            user.wait(lambda: goals, 'where to look')
            while unsure.poll() is None:  # until it has asked for the picture
                robot.shoot(nearest(again[2:], goals[0]))
                until = time.monotonic() + 1
                user.wait(lambda until=until: unsure.poll() is not None
                          or time.monotonic() > until, 'its end')
            assert 'not sure to 0.001 mm after 1 looks' in unsure.stderr.read()
        with look_until_sure('--sigma', '0.1') as sure:
            user.wait(lambda: sure.poll() is not None, 'its end')
            said = sure.stdout.read()
    assert (unsure.returncode, sure.returncode) == (1, 0)
    x, y, z = map(float, re.findall(r'-?\d+\.\d{4}', said))
    assert np.linalg.norm(truth[:3, 3] - [x, y, z]) < 0.02
    assert 'sweep: 4 posed views in base_link' in chain.log
    found = [pose_with_covariance_from(each) for each in poses[:3]]
    assert [header for header, *_ in found] == [
        Header(each.stamp_ns, 'base_link') for each in frames[1:]]
    told = [position_sigma(covariance) for *_, covariance in found]
    assert told == sorted(told, reverse=True)
    error = off(found[-1][1], truth)
    assert error.translation < 4 * told[-1] < 0.02
    assert np.degrees(error.rotation) < 3
    # four views of 240x180 px in two rows, three times enlarged
    assert picture_from(pictures[2]).shape == (1080, 1440, 3)
    assert picture_from(pictures[0]).shape == (540, 1440, 3)
    drawn = [picture_from(each) for each in (*sigmas[:3], candidates[0])]
    assert all(each.std() > 10 for each in drawn)
    assert (drawn[2] != drawn[0]).any()
    # The volume is of one of the views, and says where that is.
    volume = volume_from(volumes[2])
    assert volume.header.stamp_ns == frames[-1].stamp_ns
    assert volume.header.frame_id.startswith('base_link/view_')
    number = int(volume.header.frame_id[-1])
    np.testing.assert_allclose(volume.camera.camera_to_reference, frames[number].pose, atol=1e-6)
    assert answer.success, answer.message
    assert 'mm now' in answer.message
    _, camera = pose_from(nexts[0])
    ahead = truth[:3, 3] - camera[:3, 3]
    assert camera[:3, 2] @ ahead / np.linalg.norm(ahead) > 0.999


def test_a_bag_of_a_moving_arm_gives_the_views_where_it_rested(tmp_path, user, frames):
    record(tmp_path / 'bag', frames)
    settings = {'poses': 'topic', 'collect': 'rest', 'exposure': 0.1, 'most_views': 4,
                'patience': 60.0}
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver', params=settings) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        # A history of one keeps the last only of what comes before it is taken.
        came = [user.listen(kind, topic, SMALL) for kind, topic, _ in TOPICS]
        with Process(tmp_path, 'pmcl_ros.nodes.replay', tmp_path / 'bag', '--rate', '2'):
            user.wait(lambda: all(len(each) == 3 for each in came), 'two, three and four views')
        refused = user.call(Trigger, '/sweep_driver/take', Trigger.Request())
        assert 'collect is rest' in refused.message
        again = user.call(Trigger, '/sweep_driver/finish', Trigger.Request())
        user.wait(lambda: all(len(each) == 4 for each in came), 'the same again')
    assert again.message.startswith('4 posed views in base_link; left out: frame 2: moved by')
    for views, messages in zip((2, 3, 4, 4), zip(*came, strict=True), strict=True):
        expected = sent_by(frames, views)
        assert messages[0] == expected.camera_info
        assert messages[2:] == (expected.sigma, expected.views)
        found, wanted = posed_views_from(*messages), posed_views_from(*expected)
        np.testing.assert_allclose([each.camera_to_reference for each in found.views],
                                   [each.camera_to_reference for each in wanted.views],
                                   atol=1e-12)


def test_a_picture_that_was_asked_for_comes_or_the_log_says_why_not(tmp_path, user, frames):
    settings = {'poses': 'topic', 'collect': 'service', 'gap': 2.0, 'movement': 5.0,
                'least_views': 1, 'most_views': 2, 'auto_finish': False, 'patience': 60.0}
    small = replace(frames[0], image=frames[0].image[::2, ::2],
                    lens=Lens(frames[0].lens.pinhole.resized(120, 90)))
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver', params=settings) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        views = user.listen(Image, 'posed_views', BIG)
        robot = Robot(user)
        robot.info.publish(info_of(frames[0]))
        user.delivered(robot.info)
        at = iter(range(START, START + 100 * SECOND, SECOND))

        def shoot(frame, frame_id='wrist_camera'):
            robot.shoot(replace(frame, stamp_ns=next(at)), frame_id)

        assert robot.ask('take').success
        shoot(small)  # its camera_info is still on its way
        user.wait(lambda: 'left out: frame 1 has 120x90 px, its ' in node.log, 'its refusal')
        shoot(frames[0])
        user.wait(lambda: len(views) == 1, 'the first view')
        assert robot.ask('take').success
        shoot(frames[0])
        user.wait(lambda: '~/take: no further view, as frame 3: frame 2 is there' in node.log,
                  'the reason')
        assert robot.ask('take').success
        shoot(frames[1], 'other_camera')
        user.wait(lambda: "frame 4 is of 'other_camera'" in node.log, 'its refusal')
        shoot(frames[1])
        user.wait(lambda: len(views) == 2, 'the second view')
        assert robot.ask('take').success
        shoot(frames[2])
        user.wait(lambda: 'no further view, as frame 6: 2 views are there already' in node.log,
                  'the reason')
        shoot(frames[3])  # nobody asked any more
        assert robot.ask('finish').message.startswith('2 posed views')
        assert 'frame 7' not in node.log
    assert 'Traceback' not in node.log


def missing_of(diagnostics):
    values = {each.key: each.value for each in diagnostics.status[0].values}
    return values['planned poses without a view']


def test_a_plan_says_from_where_views_are_wanted(tmp_path, user, frames):
    planned = [frames[2], frames[0]]
    (tmp_path / 'plan.yaml').write_text(yaml.safe_dump({
        'frame': 'base_link', 'poses': [each.pose.ravel().tolist() for each in planned]}))
    settings = {'poses': 'topic', 'collect': 'plan', 'plan': str(tmp_path / 'plan.yaml'),
                'gap': 20.0, 'movement': 5.0, 'patience': 60.0}
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver', params=settings) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        came = [user.listen(kind, topic, qos) for kind, topic, qos in TOPICS]
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
        robot = Robot(user)
        robot.info.publish(info_of(frames[0]))
        user.delivered(robot.info)
        user.wait(lambda: states, 'what is missing')
        for number, each in enumerate(frames[:3]):
            robot.shoot(replace(each, stamp_ns=START + number * SECOND))
        user.wait(lambda: all(came), 'the views')
        user.wait(lambda: missing_of(states[-1]) == 'none', 'a view of each pose')
    assert missing_of(states[0]) == '1, 2'
    found = posed_views_from(*(each[0] for each in came))
    np.testing.assert_allclose([each.camera_to_reference for each in found.views],
                               [frames[0].pose, frames[2].pose], atol=1e-6)
    assert '2 posed views in base_link; left out: frame 2: it is at no planned pose' in node.log


@pytest.mark.parametrize('why', ['another size', 'the same place'])
def test_a_picture_of_no_use_takes_nothing_from_the_one_before_it(tmp_path, user, frames, why):
    settings = {'poses': 'topic', 'collect': 'rest', 'gap': 20.0, 'movement': 5.0,
                'least_views': 1, 'patience': 60.0}
    useless = replace(frames[0], stamp_ns=START + SECOND)
    if why == 'another size':
        useless = replace(useless, image=useless.image[::2, ::2],
                          lens=Lens(useless.lens.pinhole.resized(120, 90)))
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver', params=settings) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        views = user.listen(Image, 'posed_views', BIG)
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
        robot = Robot(user)
        robot.info.publish(info_of(frames[0]))
        user.delivered(robot.info)
        robot.pose.publish(pose_of(START - SECOND, frames[0].pose))
        user.delivered(robot.pose)
        for each in (frames[0], useless):
            robot.shoot(each, posed=False)
        # the poses of both images are known at once
        robot.pose.publish(pose_of(START + 2 * SECOND, frames[0].pose))
        user.wait(lambda: len(views) == 1, 'the view')
        if why == 'another size':
            user.wait(lambda: 'left out: frame 2 has 120x90 px, its ' in node.log, 'its refusal')
        # Nothing more may ever be published: /diagnostics says why.
        robot.shoot(replace(frames[0], stamp_ns=START + 3 * SECOND))
        user.wait(lambda: states and any(
            each.key == 'left out last' and each.value.startswith('frame 3: frame 1 is there')
            for each in states[-1].status[0].values), 'the reason')


def check_volume(volume, views, truth, mesh):
    """As the library makes it, of one of the views, with its peak where the object is."""
    expected = build_volume_of_views(views, DlvSettings())
    assert (volume.header, volume.pinhole) == (expected.header, expected.pinhole)
    np.testing.assert_array_equal(volume.depths, expected.depths)
    np.testing.assert_allclose(volume.likelihood, expected.likelihood,
                               atol=1e-5 * expected.likelihood.max())
    assert volume.likelihood.shape == (180, 240, 75)
    assert volume.camera.frame_id == 'base_link'
    camera = volume.camera.camera_to_reference
    number = int(volume.header.frame_id.removeprefix('base_link/view_'))
    np.testing.assert_allclose(camera, views.views[number].camera_to_reference, atol=1e-9)
    into = np.linalg.inv(camera) @ truth
    points = mesh.vertices @ into[:3, :3].T + into[:3, 3]
    columns, rows = np.rint(volume.pinhole.project(points)).astype(int).T
    peak = volume.depths[volume.likelihood[rows, columns].sum(axis=0).argmax()]
    assert points[:, 2].min() < peak < points[:, 2].max()


def test_a_bag_of_posed_views_is_searched_in_step(tmp_path, user, scene, frames, truth, search):
    lines = []
    for views in (2, 4):
        for (kind, topic, _), message in zip(TOPICS, sent_by(frames, views), strict=True):
            name = f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
            lines.append(bags.Recorded(f'/{topic}', name, START + views,
                                       serialize_message(message)))
    bags.record(tmp_path / 'bag', lines)
    with (Process(tmp_path, 'pmcl_ros.nodes.pmcl_node',
                  params=search | {'source': 'posed_views'}) as node,
          Process(tmp_path, 'pmcl_ros.nodes.dlv_node') as dlv_node):
        assert all(user.change('pmcl_node', CONFIGURE, ACTIVATE)), node.log
        assert all(user.change('dlv_node', CONFIGURE, ACTIVATE)), dlv_node.log
        poses = user.listen(PoseStamped, 'pose', SMALL)
        volumes = user.listen(Float32MultiArray, 'dlv', BIG)
        with Process(tmp_path, 'pmcl_ros.nodes.replay', tmp_path / 'bag', '--in-step'):
            user.wait(lambda: len(poses) == 2, 'both poses')
            user.wait(lambda: volumes and volume_from(volumes[-1]).header.stamp_ns
                      == frames[3].stamp_ns, 'the volume of four views')
    check_volume(volume_from(volumes[-1]), posed_views_from(*sent_by(frames, 4)), truth,
                 trimesh.load_mesh(scene / 'model.obj', process=False))
    assert [pose_from(each)[0].stamp_ns for each in poses] == [
        frames[1].stamp_ns, frames[3].stamp_ns]
    assert 'found model in 4 views' in node.log
    assert off(pose_from(poses[1])[1], truth).translation < 0.01
    # The first views by the pipeline, without ROS.
    settings = PmclSettings(**search)
    with Pipeline.for_object(ObjectModel.load(scene / 'model.obj'), settings,
                             posed=True) as pipeline:
        run = pipeline.run(lambda: posed_views_from(*sent_by(frames, 2)),
                           np.random.default_rng(settings.seed))
    assert off(pose_from(poses[0])[1], run.estimate.pose).translation < 1e-6


def test_fixed_cameras_follow_an_object(tmp_path, user, frames, truth, search):
    """Four cameras that take their pictures at the same time, again and again."""
    settings = search | {'source': 'posed_views', 'tracking': 'constant_velocity'}
    with Process(tmp_path, 'pmcl_ros.nodes.pmcl_node', params=settings) as node:
        assert all(user.change('pmcl_node', CONFIGURE, ACTIVATE)), node.log
        poses = user.listen(PoseStamped, 'pose', SMALL)
        publishers = [user.publisher(kind, topic, qos) for kind, topic, qos in TOPICS]
        for number in range(2):
            at = [replace(each, stamp_ns=START + number * SECOND // 10) for each in frames]
            for publisher, message in zip(publishers, sent_by(at, 4), strict=True):
                publisher.publish(message)
            user.wait(lambda number=number: len(poses) == number + 1, 'a pose')
    assert 'found in capture' in node.log
    found = [pose_from(each)[1] for each in poses]
    for each in found:
        assert off(each, truth).translation < 0.01
    assert 0 < off(found[1], found[0]).translation < 0.003


def test_several_objects_have_poses_of_their_own(tmp_path, user, frames, truth, search):
    """The one that is there, and a carton that is not."""
    trimesh.creation.box((0.05, 0.07, 0.15)).export(tmp_path / 'carton.stl')
    both = search | {'source': 'posed_views', 'objects': [
        search['object'], str(tmp_path / 'carton.stl')]}
    with Process(tmp_path, 'pmcl_ros.nodes.pmcl_node', params=both) as node:
        assert all(user.change('pmcl_node', CONFIGURE, ACTIVATE)), node.log
        poses, others = (user.listen(PoseStamped, f'objects/{name}/pose', SMALL)
                         for name in ('model', 'carton'))
        listed = user.listen(MarkerArray, 'objects', LATCHED)
        pictures, nexts = user.listen(Image, 'overlay', SMALL), user.listen(
            PoseStamped, 'next_view', SMALL)
        publishers = [user.publisher(kind, topic, qos) for kind, topic, qos in TOPICS]
        for publisher, message in zip(publishers, sent_by(frames, 4), strict=True):
            publisher.publish(message)
        user.wait(lambda: poses and listed and pictures, 'a pose')
        assert user.call(Trigger, '/pmcl_node/next_view', Trigger.Request()).success
        user.wait(lambda: nexts, 'the next view')
    header, pose = pose_from(poses[0])
    assert header == Header(frames[-1].stamp_ns, 'base_link')
    assert off(pose, truth).translation < 0.01
    assert [(each.ns, each.text) for each in listed[0].markers] == [
        ('model', 'found'), ('carton', 'lost')]
    assert others == []
    assert picture_from(pictures[0]).std() > 10


class Sent:
    """In the place of a broadcaster, as tf2_msgs is not on PyPI: keeps what it would send."""

    def __init__(self):
        self.transforms = []

    def broadcast(self, estimate):
        self.transforms.append(estimate_to_transform(estimate, 'glass'))

    def forget(self):
        """What was sent, was sent."""


def test_the_object_s_frame_does_not_turn_with_the_cameras(user, frames, truth, search):
    """The same views in another order; the object is on a table at the height of the base."""
    down = np.eye(4)
    down[2, 3] = -truth[2, 3]
    views = [replace(each, pose=down @ each.pose) for each in frames]
    middle = search['roi_center'] + down[:3, 3]
    context = Context()
    rclpy.init(context=context)
    node = PmclNode(context=context, parameter_overrides=[
        Parameter(name, value=value) for name, value in (search | {
            'roi_center': middle.tolist(), 'source': 'posed_views'}).items()])
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    user.others.append(executor)
    try:
        assert node.trigger_configure() == Result.SUCCESS
        tf = Sent()
        node.objects.frames.append(tf)
        assert node.trigger_activate() == Result.SUCCESS
        poses = user.listen(PoseStamped, 'pose', SMALL)
        spreads = user.listen(PoseWithCovarianceStamped, 'pose_with_covariance', SMALL)
        publishers = [user.publisher(kind, topic, qos) for kind, topic, qos in TOPICS]

        def show(views, number):
            at = [replace(each, stamp_ns=START + (10 * number + k) * SECOND)
                  for k, each in enumerate(views)]
            for publisher, message in zip(publishers, sent_by(at, 4), strict=True):
                publisher.publish(message)
            user.wait(lambda: len(poses) == len(spreads) == len(tf.transforms) == number,
                      f'pose {number}')

        show(views, 1)
        show(views[::-1], 2)
        assert user.call(Trigger, '/pmcl_node/reset', Trigger.Request()).success
        show(views[::-1], 3)
    finally:
        user.others.clear()
        executor.shutdown()
        node.close()
        rclpy.shutdown(context=context)
    first, second, third = (pose_from(each)[1] for each in poses)
    glass = Symmetry(np.array([0.0, 0, 1]))
    for each in (first, second, third):
        assert off(each, down @ truth).translation < 0.01
    assert np.degrees(rotation_angle(second[None], first)[0]) < 1.5
    assert rotation_angle(second[None], first)[0] == pytest.approx(
        glass.rotation_distance(second[None], first)[0], abs=1e-6)
    # As the first, its x points to the camera of the first view that sees it.
    assert np.degrees(rotation_angle(third[None], second)[0]) > 20
    for pose, spread, sent in zip(poses, spreads, tf.transforms, strict=True):
        assert spread.header == sent.header == pose.header
        assert spread.pose.pose == pose.pose
        assert sent.transform.rotation == pose.pose.orientation
        np.testing.assert_array_equal(transform_from(sent)[2], pose_from(pose)[1])


def test_what_a_node_of_posed_views_cannot_do_is_refused(tmp_path, user, search):
    with Process(tmp_path, 'pmcl_ros.nodes.pmcl_node',
                 params=search | {'source': 'posed_views', 'tracking': 'camera'}) as node:
        assert not user.change('pmcl_node', CONFIGURE)
        assert 'posed views have poses of their cameras; set it to constant_pose' in node.log
        assert user.set('pmcl_node', tracking='none', mode='faithful') == []
        assert not user.change('pmcl_node', CONFIGURE)
        assert 'source posed_views needs mode default, it is faithful' in node.log
        no_plan = str(tmp_path / 'plan.yaml')
        assert user.set('pmcl_node', mode='default', next_view_plan=no_plan) == []
        assert not user.change('pmcl_node', CONFIGURE)
        assert f"parameter 'next_view_plan': there is no {no_plan}" in node.log
        assert user.set('pmcl_node', source='light_field', next_view_plan='') == []
        assert all(user.change('pmcl_node', CONFIGURE, ACTIVATE)), node.log
        answer = user.call(Trigger, '/pmcl_node/next_view', Trigger.Request())
        assert not answer.success
        assert answer.message == 'a next view needs posed views: set source to posed_views'
