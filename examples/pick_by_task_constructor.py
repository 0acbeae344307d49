"""Waits until the object's pose is sure, and plans its grasps by MoveIt's Task Constructor.

Run it beside pmcl_node, grasp_node and MoveIt's move_group, with the robot's description and its
planning pipelines as parameters: `python3 pick_by_task_constructor.py --group arm --hand gripper
--touch l_gripper_finger_link r_gripper_finger_link`. The object is in the planning scene by
pmcl_node's topic collision_object; deactivate pmcl_node before --execute. Each grasp is an
alternative of the task: approach, grasp, close, lift. All are planned, and the solution of least
cost is shown in RViz; --execute carries it out.

It needs the Python modules of the Task Constructor (ros-jazzy-moveit-task-constructor-core). The
stages were written by its public Python interface and have not been run with MoveIt;
`alternatives`, of plain data, needs none of it.
"""

import sys

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, Vector3, Vector3Stamped
from pick_when_sure import PickWhenSure, argument_parser
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Header

LEAST = 0.5  # of the ways to the grasp and up from it: so much must be free


def alternatives(ranked):
    """Of (pre-grasp, grasp) PoseStamped a dictionary each: the grasp, and the way to it [m].

    direction: a unit vector in the frame of the grasp's pose.
    """
    found = []
    for number, (before, there) in enumerate(ranked, 1):
        way = np.subtract(*([each.pose.position.x, each.pose.position.y, each.pose.position.z]
                            for each in (there, before)))
        distance = float(np.linalg.norm(way))
        found.append({'name': f'grasp {number}', 'pose': there, 'distance': distance,
                      'direction': (way / distance).tolist()})
    return found


class PickTask:
    """Makes the task. core, stages: modules of moveit.task_constructor; node: rclcpp's."""

    def __init__(self, core, stages, node, options):
        self.core, self.stages, self.node, self.options = core, stages, node, options
        self.straight = core.CartesianPath()
        self.joints = core.JointInterpolationPlanner()

    def task(self, grasps):
        """A task that tries the dictionaries of `alternatives`."""
        task = self.core.Task()
        task.name = f'pick {self.options.object}'
        task.loadRobotModel(self.node)
        task.add(self.stages.CurrentState('current state'))
        task.add(self.fingers('open hand', self.options.open))
        planner = self.core.PipelinePlanner(self.node)
        task.add(self.stages.Connect('to the pre-grasp', [(self.options.group, planner)]))
        choice = self.core.Alternatives('grasps')
        for each in grasps:
            choice.insert(self.grasp(each, task['open hand']))
        task.add(choice)
        return task

    def grasp(self, grasp, start):
        """The stages of one alternative. start: the stage whose planning scene it begins with."""
        options, frame = self.options, grasp['pose'].header.frame_id
        target = self.stages.GeneratePose('pose')
        target.pose = grasp['pose']
        target.setMonitoredStage(start)
        reach = self.stages.ComputeIK('reach', target)
        reach.group = options.group
        reach.ik_frame = PoseStamped(header=Header(frame_id=options.link))
        reach.max_ik_solutions = 8
        reach.properties.configureInitFrom(
            self.core.Stage.PropertyInitializerSource.INTERFACE, ['target_pose'])
        touch = self.stages.ModifyPlanningScene('let the hand touch it')
        touch.allowCollisions(options.object, options.touch)
        if options.support:
            touch.allowCollisions(options.object, [options.support])
        hold = self.stages.ModifyPlanningScene('attach it')
        hold.attachObject(options.object, options.link)
        whole = self.core.SerialContainer(grasp['name'])
        for stage in (self.way('approach', frame, grasp['direction'], grasp['distance']),
                      reach, touch, self.fingers('close hand', options.close), hold,
                      self.way('lift', frame, [0.0, 0.0, 1.0], options.lift)):
            whole.insert(stage)
        return whole

    def way(self, name, frame, direction, distance):
        """A straight way of the link."""
        stage = self.stages.MoveRelative(name, self.straight)
        stage.group = self.options.group
        stage.ik_frame = PoseStamped(header=Header(frame_id=self.options.link))
        stage.min_distance, stage.max_distance = LEAST * distance, distance
        x, y, z = direction
        stage.setDirection(Vector3Stamped(header=Header(frame_id=frame),
                                          vector=Vector3(x=x, y=y, z=z)))
        return stage

    def fingers(self, name, pose):
        """The hand in a pose that the SRDF names."""
        stage = self.stages.MoveTo(name, self.joints)
        stage.group = self.options.hand
        stage.setGoal(pose)
        return stage


def main():
    """Entry point."""
    parser = argument_parser(__doc__)
    parser.add_argument('--object', default='wine_glass', help='its id in the planning scene')
    parser.add_argument('--group', default='arm', help="the arm's group of joints")
    parser.add_argument('--link', default='wrist_roll_link', help='parent_link of the grasps')
    parser.add_argument('--hand', default='gripper', help="the hand's group of joints")
    parser.add_argument('--open', default='open', help='name of its open pose in the SRDF')
    parser.add_argument('--close', default='close', help='name of its closed pose')
    parser.add_argument('--touch', nargs='+', default=['gripper_link'],
                        help='links that may touch the object')
    parser.add_argument('--support', default='', help='what it stands on, in the planning scene')
    parser.add_argument('--lift', type=float, default=0.1, help='up at the end [m]')
    parser.add_argument('--execute', action='store_true', help='move the robot')
    options = parser.parse_args(rclpy.utilities.remove_ros_args(sys.argv)[1:])
    try:
        import rclcpp  # the C++ library's node, which MoveIt's modules take
        from moveit.task_constructor import core, stages
    except ImportError as error:
        sys.stderr.write(f'pick_by_task_constructor: {error}: it needs the Python modules of '
                         'ros-jazzy-moveit-task-constructor-core\n')
        return 2
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    rclcpp.init()
    try:
        waiting = PickWhenSure(options.sigma)
        make = PickTask(core, stages, rclcpp.Node('pick_by_task_constructor'), options)
        task = make.task(alternatives(waiting.wait()))
        if not task.plan():
            sys.stderr.write('pick_by_task_constructor: no grasp can be planned; RViz shows the '
                             'stage that fails\n')
            return 1
        task.publish(task.solutions[0])
        if options.execute:
            task.execute(task.solutions[0])
    except KeyboardInterrupt:
        return 130
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
