"""grasp_node as a process: poses in, grasps out; none for what is lost, unsure, or of no time."""

import subprocess
import sys
import threading
import time
from functools import cached_property

import numpy as np
import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovariance, PoseWithCovarianceStamped
from harness import (
    ACTIVATE,
    CLEANUP,
    CONFIGURE,
    DEACTIVATE,
    ROOT,
    UNCONFIGURED,
    Process,
    own_lines,
)
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter
from std_msgs.msg import Float32MultiArray
from visualization_msgs.msg import Marker, MarkerArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import inverse, rotate_covariance, transform
from pmcl_ros.grasps.grasp import GraspFile
from pmcl_ros.grasps.ranking import Ranker
from pmcl_ros.grasps.settings import GraspSettings
from pmcl_ros.messages.header import header_from, header_to_message
from pmcl_ros.messages.pose import pose_from, pose_to_message, poses_from
from pmcl_ros.nodes.grasp_node import GraspNode
from pmcl_ros.nodes.runtime.base import BIG, MANY, SMALL
from pmcl_ros.nodes.runtime.health import Health

FILE = ROOT / 'config' / 'objects' / 'wine_glass.grasps.yaml'
SETTINGS = GraspSettings(grasps=str(FILE), arm='topic')
SECOND = 1_000_000_000
STAMP = 1_700_000_000 * SECOND + 7
GLASS = transform((0.75, 0.1, 0.8), (0.0, 0.05, 0.4))  # in the base
ARM = transform((0.4, 0.05, 1.0), (0.0, 0.5, 0.1))
CAMERA = ARM @ transform(SETTINGS.mount_position, SETTINGS.mount_rpy)
SPREAD = np.diag([4e-6, 4e-6, 2.5e-5, 1e-4, 1e-4, 1e-4])


def stamped(pose, stamp=STAMP, frame='base_link'):
    return PoseStamped(header=header_to_message(Header(stamp, frame)),
                       pose=pose_to_message(pose))


def with_covariance(pose, covariance=SPREAD, stamp=STAMP, frame='lytro_optical_frame'):
    return PoseWithCovarianceStamped(
        header=header_to_message(Header(stamp, frame)),
        pose=PoseWithCovariance(pose=pose_to_message(pose), covariance=covariance.ravel()))


def report(stamp, search, text='lost: no wine_glass in capture', values=None):
    """What pmcl_node says of a search of the capture `stamp`, a second later."""
    level = DiagnosticStatus.WARN if 'lost' in text else DiagnosticStatus.OK
    values = {'capture': stamp, 'search': search} | (values or {})
    status = DiagnosticStatus(
        level=level, name='pmcl_node', message=f'{text} {stamp}',
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()])
    return DiagnosticArray(header=header_to_message(Header(stamp + SECOND, '')), status=[status])


class Planner:
    """What a robot's side says and hears."""

    def __init__(self, user, prefix=''):
        self.user = user
        self.pose = user.publisher(PoseStamped, f'{prefix}pose', SMALL)
        self.both = user.publisher(PoseWithCovarianceStamped, f'{prefix}pose_with_covariance',
                                   SMALL)
        self.heard = {topic: user.listen(kind, topic, SMALL) for topic, kind in (
            ('grasps', PoseArray), ('pre_grasps', PoseArray), ('grasp', PoseStamped),
            ('grasps/details', Float32MultiArray), ('pre_grasp', PoseStamped),
            ('grasp_markers', MarkerArray))}

    @cached_property
    def arm(self):
        return self.user.publisher(PoseStamped, 'arm_pose', BIG)  # acknowledged at once

    def grasps(self, stamp=STAMP):
        """The next `grasps`, all topics heard; what came before is forgotten."""
        wanted = ['grasps', 'pre_grasps', 'grasps/details', 'grasp_markers']
        self.user.wait(lambda: all(self.heard[each] for each in wanted), 'grasps')
        grasps = self.heard['grasps'][-1]
        assert header_from(grasps.header) == Header(stamp, 'base_link')
        if grasps.poses:
            self.user.wait(lambda: self.heard['grasp'] and self.heard['pre_grasp'], 'the best')
        found = {topic: messages.pop() for topic, messages in self.heard.items() if messages}
        for messages in self.heard.values():
            messages.clear()
        return found


@pytest.fixture
def node(tmp_path, user):
    """A function settings -> (process, planner) of an active node."""
    processes = []

    def node(**changes):
        params = {'grasps': str(FILE), 'arm': 'topic'} | changes
        process = Process(tmp_path, 'pmcl_ros.nodes.grasp_node', params=params)
        processes.append(process)
        assert all(user.change('grasp_node', CONFIGURE, ACTIVATE)), process.log
        return process, Planner(user)

    yield node
    for process in processes:
        with process:
            pass


def warned(user, process, reason):
    user.wait(lambda: reason in process.log or not process.alive(), f'{reason!r} to be told')
    assert 'Traceback' not in process.log


def values(states):
    """The last values on /diagnostics of the node."""
    last = [each.status[0] for each in states if each.status[0].name == 'grasp_node'][-1:]
    return {each.key: each.value for one in last for each in one.values}


def test_poses_become_ranked_grasps_and_lost_objects_none(node, user):
    process, planner = node()
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    told = user.publisher(DiagnosticArray, '/diagnostics', SMALL)
    planner.arm.publish(stamped(ARM))
    user.delivered(planner.arm)

    # the same as the core makes of it, in the base, of the gripper's parent link
    planner.both.publish(with_covariance(inverse(CAMERA) @ GLASS))
    found = planner.grasps()
    model, gripper, grasps = GraspFile.read(FILE)
    expected = Ranker(model, gripper, grasps, SETTINGS).rank(
        GLASS, rotate_covariance(SPREAD, CAMERA[:3, :3])).candidates
    poses = poses_from(found['grasps'].poses, 'grasps')
    assert len(poses) == len(expected) > 10
    parent = np.stack([each.pose for each in expected]) @ gripper.parent_pose
    details = np.reshape(found['grasps/details'].data, (-1, 4))
    np.testing.assert_allclose(details, [[each.score, each.probability, each.grasp.width,
                                          each.grasp.opening] for each in expected], atol=1e-5)
    rows, columns = found['grasps/details'].layout.dim
    assert (rows.label, rows.size) == (f'grasps;stamp={STAMP}', len(poses))
    assert columns.label == 'score,probability,width,opening'
    np.testing.assert_allclose(poses[0], parent[0], atol=1e-6)
    for each in poses:  # equals may have changed places
        assert np.abs(parent - each).max(axis=(1, 2)).min() < 1e-6
    assert found['grasp'].pose == found['grasps'].poses[0]
    # a pose in the base frame, as of posed views, needs no arm: the same grasps
    planner.both.publish(with_covariance(GLASS, rotate_covariance(SPREAD, CAMERA[:3, :3]),
                                         STAMP + 2 * SECOND, 'base_link'))
    again = poses_from(planner.grasps(STAMP + 2 * SECOND)['grasps'].poses, 'grasps')
    np.testing.assert_allclose(again[0], poses[0], atol=1e-6)
    assert len(again) == len(poses)
    # the fingers are where they touch the glass: the axis passes between them
    fingers = poses[0] @ transform(gripper.parent_to_grasp)
    seen = inverse(fingers) @ GLASS
    assert abs(seen[1, 3]) < 1e-6
    before = poses_from(found['pre_grasps'].poses, 'pre_grasps')
    np.testing.assert_allclose(poses[:, :3, 3] - before[:, :3, 3], 0.1 * poses[:, :3, 0],
                               atol=1e-9)
    assert found['pre_grasp'].pose == found['pre_grasps'].poses[0]
    clear, first, *_, arrow = found['grasp_markers'].markers
    assert (clear.action, first.type, arrow.type) == (Marker.DELETEALL, Marker.LINE_LIST,
                                                      Marker.ARROW)
    drawn = pose_from(PoseStamped(header=first.header, pose=first.pose))[1]
    np.testing.assert_allclose(drawn, fingers, atol=1e-6)
    assert len(first.points) == 3 * 24
    assert min(abs(each.y) for each in first.points) == pytest.approx(details[0, 3] / 2)
    assert (first.color.r, first.color.g) == pytest.approx(
        (1 - details[0, 1], details[0, 1]), abs=1e-6)
    way = np.array([[each.x, each.y, each.z] for each in arrow.points])
    np.testing.assert_allclose(way, [fingers[:3, 3] - 0.1 * fingers[:3, 0], fingers[:3, 3]],
                               atol=1e-6)
    user.wait(lambda: any(each.status[0].name == 'grasp_node'
                          and each.status[0].level == DiagnosticStatus.OK
                          and 'best side' in each.status[0].message for each in states), 'health')
    assert {'object', 'best grasp', 'probability'} <= values(states).keys()

    # lost: none, and it says so
    now, lost = Header(STAMP + SECOND, 'base_link'), DiagnosticStatus(
        level=DiagnosticStatus.WARN, name='pmcl_node', message='lost: no glass in capture 8')
    told.publish(DiagnosticArray(header=header_to_message(now), status=[lost]))
    gone = planner.grasps(now.stamp_ns)
    assert not gone['grasps'].poses
    assert 'grasp' not in gone
    assert [each.action for each in gone['grasp_markers'].markers] == [Marker.DELETEALL]
    warned(user, process, 'no grasp: lost: no glass in capture 8')
    user.wait(lambda: any(each.status[0].name == 'grasp_node'
                          and each.status[0].level == DiagnosticStatus.WARN
                          for each in states), 'the warning')
    assert values(states)['object'] == 'wine_glass'
    assert not {'best grasp', 'probability'} & values(states).keys()

    # unsure: none, and it says so
    planner.both.publish(with_covariance(inverse(CAMERA) @ GLASS, 400 * SPREAD))
    assert not planner.grasps()['grasps'].poses
    warned(user, process, 'not surely clear of the object')

    # no covariance: one is assumed
    planner.pose.publish(stamped(inverse(CAMERA) @ GLASS, STAMP + 1, 'lytro_optical_frame'))
    assert planner.grasps(STAMP + 1)['grasps'].poses
    warned(user, process, 'poses come without pose_with_covariance: 0.005 m and 0.05 rad')


def test_a_loss_counts_once_and_not_for_newer_captures(node, user):
    _, planner = node(arm='fixed')
    told = user.publisher(DiagnosticArray, '/diagnostics', SMALL)
    at = [STAMP + k * SECOND for k in range(7)]

    def found(stamp):
        planner.both.publish(with_covariance(GLASS, stamp=stamp, frame='base_link'))
        assert planner.grasps(stamp)['grasps'].poses

    def lost(stamp):
        assert not planner.grasps(stamp)['grasps'].poses

    found(at[1])
    told.publish(report(at[1], 1, 'found wine_glass in capture'))
    found(at[3])
    told.publish(report(at[2], 2))  # overtaken by the pose of 3
    told.publish(report(at[3], 3, 'found wine_glass in capture'))
    told.publish(report(at[4], 4))
    told.publish(report(at[4], 4))  # each second
    lost(at[4])
    # searched again, found, and again, lost with the words of the first time
    found(at[4])
    told.publish(report(at[4], 5, 'found wine_glass in capture'))
    told.publish(report(at[4], 6))
    lost(at[4])
    # a capture whose pose has been reported is newer than one before it: the clock was set back
    found(at[5])
    told.publish(report(at[5], 7, 'found wine_glass in capture'))
    told.publish(report(at[0], 8))
    lost(at[0])


def test_a_pose_gives_grasps_once_whether_its_covariance_comes_before_or_after_it(node, user):
    _, planner = node(arm='fixed')
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    pose, both = (user.publisher(kind, topic, BIG) for kind, topic in (
        (PoseStamped, 'pose'), (PoseWithCovarianceStamped, 'pose_with_covariance')))
    model, gripper, grasps = GraspFile.read(FILE)
    ranker = Ranker(model, gripper, grasps, SETTINGS)

    def details(stamp):
        return np.reshape(planner.grasps(stamp)['grasps/details'].data, (-1, 4))[:, :2]

    def expected(covariance):
        return [[each.score, each.probability]
                for each in ranker.rank(GLASS, covariance).candidates]

    for k in range(5):
        one, other = (pose, stamped(GLASS, STAMP + k)), (
            both, with_covariance(GLASS, stamp=STAMP + k, frame='base_link'))
        for publisher, message in (one, other) if k % 2 else (other, one):
            publisher.publish(message)  # both at once: the node waits half a second for the other
        np.testing.assert_allclose(details(STAMP + k), expected(SPREAD), atol=1e-5)
        user.delivered(pose)
        user.delivered(both)
    # The next one waits as long as those would have; its covariance never comes.
    pose.publish(stamped(GLASS, STAMP + 9))
    np.testing.assert_allclose(details(STAMP + 9), expected(
        np.diag(np.repeat(np.square(SETTINGS.assumed_sigma), 3))), atol=1e-5)
    user.wait(lambda: values(states).get('frames in') == '6', 'the last to be counted')
    assert values(states)['dropped'] == '0'


def test_the_losses_of_other_nodes_are_not_its_own_and_no_gripper_is_drawn_once_it_is_inactive(
        tmp_path, user):
    with Process(tmp_path, 'pmcl_ros.nodes.grasp_node', '--ros-args', '-r', '__ns:=/robot', '-p',
                 f'grasps:={FILE}', '-p', 'arm:=fixed') as process:
        assert all(user.change('robot/grasp_node', CONFIGURE, ACTIVATE)), process.log
        poses = user.publisher(PoseWithCovarianceStamped, '/robot/pose_with_covariance', SMALL)
        told = user.publisher(DiagnosticArray, '/diagnostics', SMALL)
        grasps, markers = (user.listen(kind, f'/robot/{topic}', SMALL) for kind, topic in (
            (PoseArray, 'grasps'), (MarkerArray, 'grasp_markers')))
        poses.publish(with_covariance(GLASS, frame='base_link'))
        user.wait(lambda: grasps and markers, 'grasps')
        for k, name in enumerate(('pmcl_node', 'robot/dlv_node', 'robot/pmcl_node'), 1):
            lost = report(STAMP + k, k)
            lost.status[0].name = name
            told.publish(lost)
        user.wait(lambda: len(grasps) == 2, 'the loss')
        poses.publish(with_covariance(GLASS, stamp=STAMP + 9, frame='base_link'))
        user.wait(lambda: len(grasps) == len(markers) == 3, 'grasps')
        assert user.change('robot/grasp_node', DEACTIVATE)
        user.wait(lambda: len(markers) == 4, 'the end of the grippers')
    assert [header_from(each.header).stamp_ns - STAMP for each in grasps] == [0, 3, 9]
    assert [bool(each.poses) for each in grasps] == [True, False, True]
    assert [len(each.markers) > 1 for each in markers] == [True, False, True, False]


def test_a_loss_takes_the_poses_that_wait_for_their_covariance(node, user):
    _, planner = node(arm='fixed')
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    told = user.publisher(DiagnosticArray, '/diagnostics', SMALL)
    planner.pose.publish(stamped(GLASS))
    user.delivered(planner.pose)
    told.publish(report(STAMP + 1, 2))
    # On a busy machine grasps of the pose may come before the loss, but not after it.
    user.wait(lambda: int(values(states).get('frames in', 0))
              + int(values(states).get('dropped', 0)) == 1, 'the pose to be counted')
    user.wait(lambda: any(header_from(each.header).stamp_ns == STAMP + 1
                          for each in planner.heard['grasps']), 'the loss')
    assert not planner.heard['grasps'][-1].poses


@pytest.mark.parametrize(('topics', 'file', 'name', 'other'), [
    ('objects/wine_glass/', 'wine_glass', 'wine_glass', 'wine_glass_2'),
    ('objects/wine_glass_2/', 'wine_glass', 'wine_glass_2', 'wine_glass'),
    ('', 'wine-glass', 'wine_glass', 'wine_glass_2')])
def test_of_several_the_loss_of_its_own_object_counts(
        tmp_path, user, topics, file, name, other):
    """Which copy, its pose topics tell; else it has the name that topics can have."""
    _, gripper, grasps = GraspFile.read(FILE)
    mesh = tmp_path / f'{file}.obj'
    mesh.write_bytes((ROOT / 'models' / 'wine_glass.obj').read_bytes())
    GraspFile.write(tmp_path / 'grasps.yaml', mesh, gripper, grasps[:1])
    remapped = [part for each in ('pose', 'pose_with_covariance')
                for part in ('-r', f'{each}:={topics}{each}')]
    parameters = ['-p', f'grasps:={tmp_path}/grasps.yaml', '-p', 'arm:=fixed']
    with Process(tmp_path, 'pmcl_ros.nodes.grasp_node', '--ros-args', *parameters,
                 *(remapped if topics else [])) as process:
        assert all(user.change('grasp_node', CONFIGURE, ACTIVATE)), process.log
        planner = Planner(user, topics)
        told = user.publisher(DiagnosticArray, '/diagnostics', SMALL)
        for k, lost in enumerate((other, name)):
            told.publish(report(STAMP + k, k, f'found jar; lost: {lost} in capture', {
                'jar': 'score 900', other: 'score 800', name: 'score 900', lost: 'lost'}))
        assert not planner.grasps(STAMP + 1)['grasps'].poses
        warned(user, process, f'lost: {name} in capture')
        assert process.log.count('no grasp: ') == 1


def test_poses_that_come_fast_give_grasps_all_the_same(node, user):
    """Faster than a covariance is waited for; what is passed over is counted."""
    process, planner = node()
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    planner.arm.publish(stamped(ARM))
    user.delivered(planner.arm)
    sent = 0
    while len(planner.heard['grasps']) < 3:
        sent += 1
        planner.pose.publish(stamped(inverse(CAMERA) @ GLASS, STAMP + sent,
                                     'lytro_optical_frame'))
        due = time.monotonic() + 0.1
        while time.monotonic() < due:
            user.spin()
        assert sent < 1000
    warned(user, process, 'poses come without pose_with_covariance')

    def counted():
        last = values(states)
        return bool(last) and int(last['frames in']) + int(last['dropped']) == sent

    user.wait(counted, 'every pose to be counted')


def test_no_pose_of_the_arm_is_missed_while_grasps_are_ranked(node, user):
    process, planner = node(turns=360)  # for a second
    arm = user.publisher(PoseStamped, 'arm_pose', MANY)
    arm.publish(stamped(ARM))
    user.delivered(arm)
    planner.both.publish(with_covariance(inverse(CAMERA) @ GLASS))
    user.delivered(planner.both)
    for k in range(150):  # at 250 Hz
        arm.publish(stamped(ARM, STAMP + SECOND + k * SECOND // 250))
    arm.publish(stamped(ARM, STAMP + SECOND, 'odom'))
    warned(user, process, "arm_pose is in frame 'odom'")  # those before it have been taken
    planner.both.publish(with_covariance(inverse(CAMERA) @ GLASS, stamp=STAMP + SECOND))
    user.wait(lambda: any(header_from(each.header).stamp_ns == STAMP + SECOND
                          for each in planner.heard['grasps']), 'the second grasps')
    assert all(each.poses for each in planner.heard['grasps'])
    assert 'the pose nearest to the capture' not in process.log


def test_a_loss_while_grasps_are_ranked_has_the_last_word(node, user):
    process, planner = node(arm='fixed', turns=360)
    told = user.publisher(DiagnosticArray, '/diagnostics', SMALL)
    planner.both.publish(with_covariance(GLASS, frame='base_link'))
    user.delivered(planner.both)
    told.publish(report(STAMP + 1, 1))
    # On a busy machine the grasps may come before the loss, but not after it.
    user.wait(lambda: f'dropped capture {STAMP}: the object was lost' in process.log
              or f'in capture {STAMP}, in' in process.log, 'the end of the ranking')
    user.wait(lambda: any(header_from(each.header).stamp_ns == STAMP + 1
                          for each in planner.heard['grasps']), 'the loss')
    assert not planner.heard['grasps'][-1].poses


def test_deactivate_waits_for_the_ranking_and_keeps_its_grasps_back(node, user):
    process, planner = node(arm='fixed', turns=360)
    planner.both.publish(with_covariance(GLASS, frame='base_link'))
    user.delivered(planner.both)
    assert all(user.change('grasp_node', DEACTIVATE, CLEANUP)), process.log
    user.wait(lambda: f'dropped capture {STAMP}: the node was deactivated' in process.log
              or f'in capture {STAMP}, in' in process.log, 'the end of the ranking')
    assert 'Traceback' not in process.log
    assert all(user.change('grasp_node', CONFIGURE, ACTIVATE, DEACTIVATE)), process.log


def test_what_cannot_be_placed_is_refused(node, user):
    process, planner = node()
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    seen = inverse(CAMERA) @ GLASS
    for publish, reason in (
            (lambda: None, 'arm_pose: no pose has come'),
            (lambda: planner.arm.publish(stamped(ARM, STAMP - 2 * SECOND)),
             '2.000 s older, at most 0.1 s are allowed (max_age)'),
            (lambda: planner.arm.publish(stamped(ARM, STAMP, 'odom')),
             "arm_pose is in frame 'odom', expected base_frame 'base_link'")):
        publish()
        user.delivered(planner.arm)
        planner.both.publish(with_covariance(seen))
        assert not planner.grasps()['grasps'].poses
        warned(user, process, reason)
    planner.arm.publish(stamped(ARM))
    user.delivered(planner.arm)
    planner.both.publish(with_covariance(seen))
    assert planner.grasps()['grasps'].poses
    user.wait(lambda: 'best grasp' in values(states), 'the best')
    planner.both.publish(with_covariance(seen, frame='another_camera'))
    assert not planner.grasps()['grasps'].poses
    warned(user, process, "in frame 'another_camera', expected camera_frame")
    user.wait(lambda: "'another_camera'" in values(states)['last error'], 'the error')
    assert not {'best grasp', 'probability'} & values(states).keys()
    planner.both.publish(with_covariance(seen))
    assert planner.grasps()['grasps'].poses


class Asked(Health):
    """Health of which another thread asks whenever a part of it is set, as a timer may."""

    def __setattr__(self, name, value):
        super().__setattr__(name, value)
        if name in ('level', 'message', 'extra') and hasattr(self, 'answers'):
            asked = threading.Thread(target=lambda: self.answers.append(
                self.to_message(STAMP, 'grasp_node').status[0]))
            asked.start()
            asked.join(0.05)  # it ends later where it has to wait for the rest


def test_no_report_has_the_best_grasp_of_one_capture_and_the_words_of_another(user):
    context = Context()
    rclpy.init(context=context)
    node = GraspNode(context=context, parameter_overrides=[
        Parameter('grasps', value=str(FILE)), Parameter('arm', value='fixed')])
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    user.others.append(executor)
    try:
        assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
        node.health = Asked()
        node.health.answers = answers = []
        planner = Planner(user)
        user.meet('grasp_node')
        for k, (covariance, frame) in enumerate(
                [(SPREAD, 'base_link'), (400 * SPREAD, 'base_link'), (SPREAD, 'base_link'),
                 (SPREAD, 'another_camera'), (SPREAD, 'base_link')]):
            planner.both.publish(with_covariance(GLASS, covariance, STAMP + k, frame))
            planner.grasps(STAMP + k)
    finally:
        user.others.clear()
        executor.shutdown()
        node.close()
        rclpy.shutdown(context=context)
    assert {each.level for each in answers} == {
        DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR}
    for each in answers:
        assert ('best grasp' in {value.key for value in each.values}) == (
            each.level == DiagnosticStatus.OK), each


def test_a_consumer_gets_what_moveit_wants(tmp_path, node, user):
    process, planner = node(arm='fixed', mount_position=CAMERA[:3, 3].tolist(),
                            mount_rpy=[-1.0, 0.5, -1.5])
    mount = transform(CAMERA[:3, 3], (-1.0, 0.5, -1.5))
    script = [sys.executable, str(ROOT / 'examples' / 'fetch_pick.py')]
    with subprocess.Popen(script, stdout=subprocess.PIPE, text=True) as pick:
        user.wait(lambda: 'fetch_pick' in user.node.get_node_names(), 'the example')
        user.wait(lambda: user.node.count_subscribers('grasps/details') > 1, 'its subscriptions')
        stamp = STAMP
        while pick.poll() is None:  # DDS may tell the node of it later than this side
            stamp += SECOND
            planner.both.publish(with_covariance(inverse(mount) @ GLASS, stamp=stamp))
            found = planner.grasps(stamp)
            assert found['grasps'].poses
            until = time.monotonic() + 1
            user.wait(lambda until=until: pick.poll() is not None or time.monotonic() > until,
                      'the example')
        printed = next(yaml.safe_load_all(own_lines(pick.stdout.read())))['grasps']
    assert pick.returncode == 0
    assert len(printed) == len(found['grasps'].poses)
    best, expected = printed[0], found['grasps'].poses[0]
    assert best['grasp_pose']['pose']['position'] == {
        each: getattr(expected.position, each) for each in 'xyz'}
    assert best['grasp_pose']['header']['frame_id'] == 'base_link'
    assert best['pre_grasp_posture']['points'][0]['positions'] == pytest.approx([0.05, 0.05])
    assert best['grasp_quality'] == pytest.approx(found['grasps/details'].data[0])
    assert process.alive()


@pytest.mark.parametrize(('changes', 'reason'), [
    ({}, "parameter 'grasps' is empty"),
    ({'grasps': 'package://pmcl_ros/config/objects/no.yaml'}, 'no.yaml is in none of'),
    ({'grasps': str(FILE), 'arm': 'tf'}, 'tf2_ros cannot be imported'),
])
def test_what_cannot_be_used_is_told_and_can_be_mended(tmp_path, user, changes, reason):
    if changes.get('arm') == 'tf':
        try:
            import tf2_ros  # noqa: F401
        except ImportError:
            pass
        else:
            pytest.skip('tf2_ros is there')
    with Process(tmp_path, 'pmcl_ros.nodes.grasp_node', params=changes or {'turns': 24}) as node:
        assert not user.change('grasp_node', CONFIGURE)
        assert reason in node.log
        assert user.state('grasp_node') == UNCONFIGURED
        assert user.set('grasp_node', grasps=str(FILE), arm='auto') == []
        assert all(user.change('grasp_node', CONFIGURE, ACTIVATE, DEACTIVATE, CLEANUP, CONFIGURE))


def test_bring_up_starts_it_with_a_grasp_file(tmp_path, user):
    chain = ['lytro_driver', 'subaperture_node', 'dlv_node', 'pmcl_node']
    without = [part for each in chain for part in ('--without', each)]
    with Process(tmp_path, 'pmcl_ros.nodes.bringup', *without, '--grasps', FILE) as bringup:
        user.wait(lambda: 'active: grasp_node' in bringup.log or not bringup.alive(), 'it')
        assert 'active: grasp_node' in bringup.log
        assert '6 grasps of wine_glass' in bringup.log
