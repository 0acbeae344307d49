"""The example sends goals to a real action server, a pre-grasp and a grasp at a time."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from importlib import import_module

import numpy as np
import pytest
from generated_interfaces import importable
from grasped_captures import SURE, TURN, GraspedCaptures
from harness import ROOT, own_lines
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future

SCRIPT = ROOT / 'examples' / 'pick_by_action.py'
GRASPS = [TURN + np.outer([0, 0, height, 0], [0, 0, 0, 1]) for height in (0, 0.1, 0.2)]
# The fields of Jazzy's moveit_msgs that the example needs.
MOVEIT = {
    'msg/MoveItErrorCodes.msg': 'int32 val\nint32 SUCCESS=1\nint32 PLANNING_FAILED=-1\n',
    'msg/BoundingVolume.msg':
        'shape_msgs/SolidPrimitive[] primitives\ngeometry_msgs/Pose[] primitive_poses\n',
    'msg/PositionConstraint.msg': """\
std_msgs/Header header
string link_name
geometry_msgs/Vector3 target_point_offset
BoundingVolume constraint_region
float64 weight
""",
    'msg/OrientationConstraint.msg': """\
std_msgs/Header header
geometry_msgs/Quaternion orientation
string link_name
float64 absolute_x_axis_tolerance
float64 absolute_y_axis_tolerance
float64 absolute_z_axis_tolerance
uint8 parameterization
float64 weight
""",
    'msg/Constraints.msg': """\
string name
PositionConstraint[] position_constraints
OrientationConstraint[] orientation_constraints
""",
    'msg/RobotState.msg': 'bool is_diff\n',
    'msg/PlanningScene.msg': 'RobotState robot_state\nbool is_diff\n',
    'msg/PlanningOptions.msg': 'PlanningScene planning_scene_diff\nbool plan_only\n',
    'msg/MotionPlanRequest.msg': """\
RobotState start_state
Constraints[] goal_constraints
string group_name
int32 num_planning_attempts
float64 allowed_planning_time
float64 max_velocity_scaling_factor
float64 max_acceleration_scaling_factor
""",
    'action/MoveGroup.action': """\
MotionPlanRequest request
PlanningOptions planning_options
---
MoveItErrorCodes error_code
---
string state
""",
}
REACH = {'action/Reach.action': 'geometry_msgs/PoseStamped target\nfloat32 speed\n---\n---\n'}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Where packages are that both sides import."""
    return tmp_path_factory.mktemp('packages')


@contextmanager
def example(folder, tmp_path, *arguments):
    """The process; `said()` is its log."""
    path = os.pathsep.join([str(folder), os.environ.get('PYTHONPATH', '')])
    log = tmp_path / 'log'
    with log.open('w') as errors, subprocess.Popen(
            [sys.executable, str(SCRIPT), *arguments], stdout=subprocess.PIPE, stderr=errors,
            text=True, env=os.environ | {'PYTHONPATH': path}) as process:
        process.said = log.read_text
        yield process


@pytest.fixture(scope='module')
def move_group(folder):
    with importable(folder, 'moveit_msgs', MOVEIT):
        yield import_module('moveit_msgs.action').MoveGroup


@pytest.fixture(scope='module')
def reach(folder):
    with importable(folder, 'reach_msgs', REACH):
        yield import_module('reach_msgs.action').Reach


def test_the_next_grasp_is_tried_until_one_is_reached(tmp_path, folder, user, move_group):
    goals = []
    # Of the first grasp the pre-grasp only, of the second none, of the third both.
    answers = iter(['reached', 'aborted', 'planning failed', 'reached', 'reached'])

    def execute(handle):
        goals.append(handle.request)
        answer = next(answers)
        result = move_group.Result()
        result.error_code.val = (result.error_code.SUCCESS if answer == 'reached'
                                 else result.error_code.PLANNING_FAILED)
        (handle.abort if answer == 'aborted' else handle.succeed)()
        return result

    server = ActionServer(user.node, move_group, 'move_action', execute)
    with example(folder, tmp_path, '--group', 'arm', '--link', 'wrist') as process:
        captures = GraspedCaptures(user)
        captures.send_until(lambda: goals, SURE, GRASPS)
        user.wait(lambda: process.poll() is not None, 'the example')
        assert own_lines(process.stdout.read()) == 'grasp 3 is reached\n'
    server.destroy()
    assert process.returncode == 0
    assert [each.rpartition('] [')[2].partition(': ')[2].strip()
            for each in process.said().splitlines() if 'grasp ' in each] == [
        'pre-grasp 1 of 3: reached', 'grasp 1 of 3: the goal ended with status 6',
        'pre-grasp 2 of 3: MoveIt error -1', 'pre-grasp 3 of 3: reached', 'grasp 3 of 3: reached']
    wanted = []
    for goal in goals:
        assert (goal.request.group_name, goal.request.start_state.is_diff) == ('arm', True)
        assert goal.planning_options.planning_scene_diff.is_diff
        assert not goal.planning_options.plan_only
        constraints, = goal.request.goal_constraints
        there, = constraints.position_constraints
        turned, = constraints.orientation_constraints
        assert {there.link_name, turned.link_name} == {'wrist'}
        assert {there.header.frame_id, turned.header.frame_id} == {'base_link'}
        place = there.constraint_region.primitive_poses[0].position
        wanted.append([place.x, place.y, place.z])
        assert turned.orientation.z == pytest.approx(np.sqrt(0.5))
    np.testing.assert_allclose(wanted, [[0.4, 0.1, 0.7], [0.5, 0.1, 0.7], [0.4, 0.1, 0.8],
                                        [0.4, 0.1, 0.9], [0.5, 0.1, 0.9]])


OTHER = '--type', 'reach_msgs/action/Reach', '--action', 'reach'


def test_any_action_with_a_pose_will_do_and_none_left_is_told(tmp_path, folder, user, reach):
    goals = []

    def refuse(goal):
        goals.append(goal.target)
        return GoalResponse.REJECT

    server = ActionServer(user.node, reach, 'reach', lambda _: None, goal_callback=refuse)
    with example(folder, tmp_path, *OTHER) as process:
        GraspedCaptures(user).send_until(lambda: goals, SURE, GRASPS)
        user.wait(lambda: process.poll() is not None, 'the example')
    server.destroy()
    assert process.returncode == 1
    assert process.said().splitlines()[-1] == 'pick_by_action: no grasp was reached'
    assert [each.pose.position.z for each in goals] == pytest.approx([0.7, 0.8, 0.9])


def test_the_last_capture_counts_while_nobody_offers_the_action(tmp_path, folder, user, reach):
    goals = []

    def refuse(goal):
        goals.append(goal.target)
        return GoalResponse.REJECT

    with example(folder, tmp_path, *OTHER) as process:
        captures = GraspedCaptures(user)
        captures.send_until(lambda: '3 grasps' in process.said(), SURE, GRASPS)
        captures.send_until(lambda: ' 0 grasps' in process.said(), SURE, [])  # it is lost
        server = ActionServer(user.node, reach, 'reach', lambda _: None, goal_callback=refuse)
        captures.send_until(lambda: goals, SURE, GRASPS[1:2])
        user.wait(lambda: process.poll() is not None, 'the example')
    server.destroy()
    assert [each.pose.position.z for each in goals] == pytest.approx([0.8])


def test_ctrl_c_cancels_the_goal(tmp_path, folder, user, reach):
    began, ended = [], Future()

    async def execute(handle):
        began.append(handle)
        await ended
        handle.canceled()
        return reach.Result()

    def cancel(_):
        ended.set_result(True)
        return CancelResponse.ACCEPT

    server = ActionServer(user.node, reach, 'reach', execute, cancel_callback=cancel)
    with example(folder, tmp_path, *OTHER) as process:
        GraspedCaptures(user).send_until(lambda: began, SURE, GRASPS)
        process.send_signal(signal.SIGINT)
        user.wait(lambda: process.poll() is not None, 'the example')
    server.destroy()
    assert ended.done()
    assert process.returncode == 130
    assert 'Traceback' not in process.said()


@pytest.mark.parametrize(('kind', 'what'), [
    ('no_such_msgs/action/Go', 'no_such_msgs'), ('Go', 'PACKAGE/action/KIND')])
def test_an_action_that_is_not_there_is_one_clear_line(tmp_path, kind, what):
    with example(tmp_path, tmp_path, '--type', kind) as process:
        pass
    assert process.returncode == 2
    line, = process.said().splitlines()
    assert line.startswith('pick_by_action: --type')
    assert what in line
