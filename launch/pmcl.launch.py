"""Starts the chain as one process for each node and, unless told otherwise, takes it to active.

Arguments: params_file, namespace, autostart (true or false), without (names of nodes, by commas),
grasps (a grasp file: grasp_node is started too), sweep (a plan: sweep_driver is started in place
of lytro_driver and subaperture_node).
"""

from itertools import pairwise

from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.substitutions import FindPackageShare
from lifecycle_msgs.msg import Transition

from launch import LaunchDescription
from pmcl_ros.nodes.table import GRASPS, NODES, SWEEP, SWEPT

CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE


def change(node, transition):
    """Ask `node` for a transition."""
    return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node),
                                       transition_id=transition))


def after(node, start_state, goal_state, action):
    """Do `action` once, when `node` has been seen to make a transition."""
    return RegisterEventHandler(OnStateTransition(
        target_lifecycle_node=node, start_state=start_state, goal_state=goal_state,
        entities=[action], handle_once=True))


def start(context):
    """The nodes and the events that take them to active, one after the other."""
    without = LaunchConfiguration('without').perform(context).split(',')
    sweep = LaunchConfiguration('sweep').perform(context)
    without += SWEPT if sweep else ()
    nodes = [LifecycleNode(package='pmcl_ros', executable=entry.name, name=entry.name,
                           namespace=LaunchConfiguration('namespace'), output='screen',
                           parameters=[LaunchConfiguration('params_file')])
             for entry in reversed(NODES) if entry.name not in without]  # consumers first
    if sweep:
        nodes.append(LifecycleNode(
            package='pmcl_ros', executable=SWEEP.name, name=SWEEP.name,
            namespace=LaunchConfiguration('namespace'), output='screen',
            parameters=[LaunchConfiguration('params_file'), {'plan': sweep}]))
    grasps = LaunchConfiguration('grasps').perform(context)
    if grasps:
        nodes.insert(0, LifecycleNode(
            package='pmcl_ros', executable=GRASPS.name, name=GRASPS.name,
            namespace=LaunchConfiguration('namespace'), output='screen',
            parameters=[LaunchConfiguration('params_file'), {'grasps': grasps}]))
    if LaunchConfiguration('autostart').perform(context).lower() != 'true' or not nodes:
        return nodes
    first, last = nodes[0], nodes[-1]
    return [
        *(after(one, 'configuring', 'inactive', change(next_one, CONFIGURE))
          for one, next_one in pairwise(nodes)),
        after(last, 'configuring', 'inactive', change(first, ACTIVATE)),
        *(after(one, 'activating', 'active', change(next_one, ACTIVATE))
          for one, next_one in pairwise(nodes)),
        *nodes,
        change(first, CONFIGURE),
    ]


def generate_launch_description():
    """What `ros2 launch` calls."""
    share = FindPackageShare('pmcl_ros')
    return LaunchDescription([
        DeclareLaunchArgument('params_file', description='parameters of the nodes, YAML',
                              default_value=PathJoinSubstitution([share, 'config', 'pmcl.yaml'])),
        DeclareLaunchArgument('namespace', default_value='', description='of all nodes'),
        DeclareLaunchArgument('autostart', default_value='true', choices=['true', 'false'],
                              description='configure and activate the nodes'),
        DeclareLaunchArgument('without', default_value='',
                              description='names of nodes not to start, by commas'),
        DeclareLaunchArgument('grasps', default_value='',
                              description='a grasp file, YAML: start grasp_node with it'),
        DeclareLaunchArgument('sweep', default_value='',
                              description='a plan, YAML: start sweep_driver with it, in place of '
                              'lytro_driver and subaperture_node'),
        OpaqueFunction(function=start),
    ])
