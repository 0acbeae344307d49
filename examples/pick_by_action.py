"""Waits until the object's pose is sure, and sends its grasps to an action until one is reached.

Run it beside pmcl_node, grasp_node and MoveIt's move_group:
`python3 pick_by_action.py --group arm --link wrist_roll_link`. For each grasp, the best first, the
action gets a goal for the pre-grasp and then one for the grasp; where one of them fails, the next
grasp is tried. It ends with status 1 when none is left. `--type PACKAGE/action/KIND --action NAME`
takes another action, whose goal has one PoseStamped; of others write a class like `PoseAction`. To
close the gripper, at the end of `pick`, is left to the pipeline. Ctrl-C cancels the goal.
"""

import signal
import sys
import time
from importlib import import_module

import rclpy
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import Pose
from pick_when_sure import PickWhenSure, argument_parser
from rclpy.action import ActionClient
from rclpy.signals import SignalHandlerOptions
from shape_msgs.msg import SolidPrimitive

MOVE_GROUP = 'moveit_msgs/action/MoveGroup'
NEAR, TURNED = 0.001, 0.01  # m, rad: tolerances of a goal for MoveIt


class PoseAction:
    """An action whose goal has one PoseStamped, as nav2_msgs/action/NavigateToPose."""

    def __init__(self, kind, options):
        self.kind, self.options = kind, options

    def goal(self, pose):
        """The goal for a PoseStamped of the link."""
        fields = [name for name, each in self.kind.Goal.get_fields_and_field_types().items()
                  if each == 'geometry_msgs/PoseStamped']
        if len(fields) != 1:
            raise LookupError(f'the goal of {self.options.type} has {len(fields)} PoseStamped, '
                              'expected one: write a class like PoseAction for it')
        return self.kind.Goal(**{fields[0]: pose})

    def problem(self, result):  # noqa: ARG002
        """Why a goal that was carried out has failed all the same; empty: it has not."""
        return ''


class MoveGroup(PoseAction):
    """MoveIt's: it plans a way for the group, and follows it."""

    def goal(self, pose):
        """The goal for a PoseStamped of the link, from the state in which the robot is."""
        from moveit_msgs.msg import (
            BoundingVolume,
            Constraints,
            OrientationConstraint,
            PositionConstraint,
        )
        ball = SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[NEAR])
        there = PositionConstraint(
            header=pose.header, link_name=self.options.link, weight=1.0,
            constraint_region=BoundingVolume(
                primitives=[ball], primitive_poses=[Pose(position=pose.pose.position)]))
        turned = OrientationConstraint(
            header=pose.header, link_name=self.options.link, weight=1.0,
            orientation=pose.pose.orientation, absolute_x_axis_tolerance=TURNED,
            absolute_y_axis_tolerance=TURNED, absolute_z_axis_tolerance=TURNED)
        goal = self.kind.Goal()
        goal.request.group_name = self.options.group
        goal.request.num_planning_attempts = 5
        goal.request.allowed_planning_time = 5.0  # s
        goal.request.max_velocity_scaling_factor = self.options.speed
        goal.request.max_acceleration_scaling_factor = self.options.speed
        goal.request.start_state.is_diff = True
        goal.request.goal_constraints = [Constraints(
            position_constraints=[there], orientation_constraints=[turned])]
        goal.planning_options.planning_scene_diff.is_diff = True
        goal.planning_options.planning_scene_diff.robot_state.is_diff = True
        return goal

    def problem(self, result):
        """MoveIt's own word, by its number."""
        code = result.error_code
        return '' if code.val == code.SUCCESS else f'MoveIt error {code.val}'


class PickByAction(PickWhenSure):
    """Sends goals, and waits for what becomes of them."""

    def __init__(self, options):
        super().__init__(options.sigma)
        self.options = options
        kind = action_type(options.type)
        self.adapter = (MoveGroup if options.type == MOVE_GROUP else PoseAction)(kind, options)
        self.client = ActionClient(self, kind, options.action)
        self.interrupted = False
        signal.signal(signal.SIGINT, self.interrupt)

    def pick(self):
        """The number of the grasp that was reached, from 1; None where none was."""
        self.until(self.client.server_is_ready, f'nobody offers {self.options.action}')
        ranked = self.wait()
        for number, poses in enumerate(ranked, 1):
            for name, pose in zip(('pre-grasp', 'grasp'), poses, strict=True):
                problem = self.send(self.adapter.goal(pose))
                self.get_logger().info(f'{name} {number} of {len(ranked)}: {problem or "reached"}')
                if problem:
                    break
            else:
                return number
        return None

    def send(self, goal):
        """Why a goal failed; empty: it was reached. TimeoutError after --timeout."""
        sent = self.client.send_goal_async(goal)
        try:
            if not self.answer(sent).accepted:
                return 'the goal is refused'
            answer = self.answer(sent.result().get_result_async())
        except BaseException:  # Ctrl-C too: the robot is not to move on
            if self.answer(sent).accepted:
                self.answer(sent.result().cancel_goal_async())
            raise
        if answer.status != GoalStatus.STATUS_SUCCEEDED:
            return f'the goal ended with status {answer.status}'
        return self.adapter.problem(answer.result)

    def answer(self, future):
        """What a future brings."""
        self.until(future.done, f'{self.options.action} does not answer')
        return future.result()

    def until(self, condition, problem):
        """Return once it holds; TimeoutError after --timeout."""
        deadline = time.monotonic() + self.options.timeout
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError(f'{problem} within {self.options.timeout:g} s')
            self.spin()

    def spin(self):
        """Handle what comes, for a moment; then Ctrl-C, which so does not break into rclpy."""
        super().spin()
        if self.interrupted:
            self.interrupted = False
            raise KeyboardInterrupt

    def interrupt(self, *_):
        """Handler of the signal."""
        self.interrupted = True


def action_type(name):
    """The class of PACKAGE/action/KIND; LookupError where it is not installed."""
    try:
        package, _, kind = name.split('/')
        return getattr(import_module(f'{package}.action'), kind)
    except (ImportError, AttributeError, ValueError) as error:
        raise LookupError(f'--type {name}: there is no such action here ({error}): install its '
                          'package, or give another, PACKAGE/action/KIND') from None


def main():
    """Entry point."""
    parser = argument_parser(__doc__)
    parser.add_argument('--type', default=MOVE_GROUP, help='of the action')
    parser.add_argument('--action', default='move_action', help='its name')
    parser.add_argument('--group', default='arm', help="MoveIt's group of joints that moves")
    parser.add_argument('--link', default='wrist_roll_link', help='parent_link of the grasps')
    parser.add_argument('--speed', type=float, default=0.2, help='share of the highest, 0 to 1')
    parser.add_argument('--timeout', type=float, default=60.0, help='for each answer [s]')
    options = parser.parse_args(rclpy.utilities.remove_ros_args(sys.argv)[1:])
    # Ctrl-C is not the end of ROS: a goal is cancelled before.
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    try:
        number = PickByAction(options).pick()
    except (LookupError, TimeoutError) as error:
        sys.stderr.write(f'pick_by_action: {error}\n')
        return 2
    except KeyboardInterrupt:
        return 130
    finally:
        rclpy.try_shutdown()
    if number is None:
        sys.stderr.write('pick_by_action: no grasp was reached\n')
        return 1
    sys.stdout.write(f'grasp {number} is reached\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
