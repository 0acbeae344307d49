"""Starts the chain as one process for each node and, unless told otherwise, takes it to active.

Arguments: params_file, namespace, autostart (true or false), without (names of nodes, by commas),
grasps (a grasp file: grasp_node is started too), sweep (a plan: sweep_driver is started in place
of lytro_driver and subaperture_node), views (rest, service or plan: sweep_driver is started
likewise, to collect posed views; fixed: fixed_cameras is), lytro (true, with views: of the centre
views of a Lytro, so that lytro_driver and subaperture_node are started too), board (true, with
views: board_node is started too, which tells the camera's poses by a printed board), pose (the
topic on which the pose is published, and on which grasp_node and a grasp pipeline find it),
respawn (true: a node that ends is started again and taken to active).
"""

from itertools import pairwise

from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessStart
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.substitutions import FindPackageShare
from lifecycle_msgs.msg import Transition

from launch import LaunchDescription
from pmcl_ros.nodes.graph import BOARD, BY_BOARD, GRASPS, NODES, OF_LYTRO, SWEEP, VIEWS, chain

CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE

# s: DDS forgets a process that was killed after 20. Before that launch_ros asks the dead one for
# its transition, once, and waits for ever.
FORGOTTEN = 25.0


def node_of(entry, respawn, *parameters, remappings=()):
    """The node of a table entry; all share the file, the namespace and the name of the pose."""
    return LifecycleNode(package='pmcl_ros', executable=entry.name, name=entry.name,
                         namespace=LaunchConfiguration('namespace'), output='screen',
                         parameters=[LaunchConfiguration('params_file'), *parameters],
                         remappings=[('pose', LaunchConfiguration('pose')), *remappings],
                         respawn=respawn, respawn_delay=FORGOTTEN)


def change(node, transition):
    """Ask `node` for a transition."""
    return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node),
                                       transition_id=transition))


def after(node, start_state, goal_state, action):
    """Do `action` once, when `node` has been seen to make a transition."""
    return RegisterEventHandler(OnStateTransition(
        target_lifecycle_node=node, start_state=start_state, goal_state=goal_state,
        entities=[action], handle_once=True))


def keep(node):
    """Take `node` to active whenever its process has been started, the first time too."""
    return [RegisterEventHandler(OnProcessStart(target_action=node,
                                                on_start=[change(node, CONFIGURE)])),
            RegisterEventHandler(OnStateTransition(
                target_lifecycle_node=node, start_state='configuring', goal_state='inactive',
                entities=[change(node, ACTIVATE)]))]


def start(context):
    """The nodes and the events that take them to active, one after the other."""
    without = [each.strip() for each in LaunchConfiguration('without').perform(context).split(',')]
    names = [entry.name for entry in NODES]
    if unknown := [each for each in without if each not in ('', *names)]:
        raise RuntimeError(f'without: there is no node {unknown[0]!r}; known: {", ".join(names)}')
    respawn = LaunchConfiguration('respawn').perform(context).lower() == 'true'
    sweep = LaunchConfiguration('sweep').perform(context)
    views = LaunchConfiguration('views').perform(context)
    if sweep and views:
        raise RuntimeError('sweep is for a light field, views for posed views: give one of them')
    lytro = LaunchConfiguration('lytro').perform(context).lower() == 'true'
    if lytro and views in ('', 'fixed'):
        raise RuntimeError('lytro says what the views are of: give views too, of a moved camera')
    board = LaunchConfiguration('board').perform(context).lower() == 'true'
    if board and (views in ('', 'fixed') or lytro):
        raise RuntimeError('board tells where an ordinary camera is: give views too, of a moved '
                           'camera, and no lytro')
    own = {'pmcl_node': [{'source': 'posed_views' if views else 'light_field'}],
           SWEEP.name: [{'plan': sweep, 'collect': 'grid'} if sweep else {
               'collect': views, **(BY_BOARD[SWEEP.name] if board else {})}],
           BOARD.name: [BY_BOARD[BOARD.name]]} if sweep or views else {}
    nodes = [node_of(entry, respawn, *own.get(entry.name, ()),
                     remappings=OF_LYTRO.items() if lytro and entry is SWEEP else ())
             for entry in reversed(chain(bool(sweep or views), lytro, views == 'fixed', board))
             if entry.name not in without]
    grasps = LaunchConfiguration('grasps').perform(context)
    if grasps:
        nodes.insert(0, node_of(GRASPS, respawn, {'grasps': grasps}))  # consumers first
    if LaunchConfiguration('autostart').perform(context).lower() != 'true' or not nodes:
        return nodes
    if respawn:
        return [*(handler for node in nodes for handler in keep(node)), *nodes]
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
        DeclareLaunchArgument('views', default_value='', choices=['', *VIEWS],
                              description='start sweep_driver likewise, to collect posed views; '
                              'fixed: fixed_cameras'),
        DeclareLaunchArgument('lytro', default_value='false', choices=['true', 'false'],
                              description='with views: of the centre views of a Lytro'),
        DeclareLaunchArgument('board', default_value='false', choices=['true', 'false'],
                              description='with views: board_node tells the poses of the camera'),
        DeclareLaunchArgument('pose', default_value='pose',
                              description='topic of the pose, as a grasp pipeline expects it'),
        DeclareLaunchArgument('respawn', default_value='false', choices=['true', 'false'],
                              description='start nodes that end again'),
        OpaqueFunction(function=start),
    ])
