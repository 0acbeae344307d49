"""A node tells what it waits for: which topic, who publishes there and why that is not heard."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseArray, PoseStamped
from harness import ACTIVATE, CONFIGURE, DEACTIVATE, ROOT, Process
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32MultiArray, String

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.light_field import light_field_to_messages
from pmcl_ros.nodes.runtime.base import BIG, LATCHED, SMALL

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
NOBODY = ': does its publisher run, in this namespace and ROS_DOMAIN_ID, are topics to be remapped'
VOLATILE = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.VOLATILE)
LOSSY = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture
def node(tmp_path, user, parameters):
    """A function (name, remappings) -> its process, active, and what comes on /diagnostics."""
    started = []
    parameters = parameters | {'grasp_node': {
        'grasps': f'{ROOT}/config/objects/wine_glass.grasps.yaml', 'arm': 'fixed'}}

    def node(name, *remapped, **changes):
        process = Process(tmp_path, f'pmcl_ros.nodes.{name}', '--ros-args',
                          *(part for each in remapped for part in ('-r', each)), '--',
                          params=parameters[name] | changes)
        started.append(process)
        assert all(user.change(name, CONFIGURE, ACTIVATE)), process.log
        return process, user.listen(DiagnosticArray, '/diagnostics', SMALL)

    yield node
    for each in started:
        with each:
            pass


def last(told):
    return (told[-1].status[0].level, told[-1].status[0].message) if told else (b'', '')


def comes(user, told, level, text):
    """Wait until it has been told, however soon something else is."""
    user.wait(lambda: any((each.status[0].level, each.status[0].message) == (level, text)
                          for each in list(told)), text)


@pytest.mark.parametrize(('name', 'remapped', 'changes', 'awaited'), [
    ('subaperture_node', 'image_raw:=camera/image', {}, '/camera/image (publishers: 0)'),
    ('dlv_node', 'views:=vews', {}, '/vews (publishers: 0) or /posed_views (publishers: 0)'),
    ('pmcl_node', 'dlv/edges:=/left/edges', {}, '/left/edges (publishers: 0)'),
    ('pmcl_node', 'dlv:=volume', {'mode': 'faithful'}, '/volume (publishers: 0)'),
    ('pmcl_node', 'posed_views:=views', {'source': 'posed_views'}, '/views (publishers: 0)'),
    ('grasp_node', 'pose:=target', {},
     '/pose_with_covariance (publishers: 0) or /target (publishers: 0)')])
def test_a_topic_that_nobody_publishes_is_told(node, user, name, remapped, changes, awaited):
    process, told = node(name, remapped, **changes)
    comes(user, told, WARN, f'awaits {awaited}')
    assert process.log.count(f'awaits {awaited}{NOBODY}') == 1
    if name == 'subaperture_node':
        assert user.change(name, DEACTIVATE)
        told.clear()
        assert user.change(name, ACTIVATE)
        comes(user, told, WARN, f'awaits {awaited}')
        assert process.log.count(f'awaits {awaited}{NOBODY}') == 2  # once each time


def test_a_publisher_that_is_silent_is_no_fault(node, user, small_edges):
    """Pictures are taken when somebody wants one; who was there may go."""
    edges = user.node.create_publisher(Float32MultiArray, 'dlv/edges', BIG)  # it is known at once
    process, told = node('pmcl_node', tracking='none')
    comes(user, told, OK, 'awaits /dlv/edges (publishers: 1)')
    assert user.node.destroy_publisher(edges)
    comes(user, told, OK, 'awaits /dlv/edges (publishers: 0)')
    assert 'awaits' not in process.log
    edges = user.publisher(Float32MultiArray, 'dlv/edges', BIG)
    edges.publish(Float32MultiArray())
    user.wait(lambda: last(told)[0] == DiagnosticStatus.ERROR, 'the refusal')
    assert last(told)[1].startswith('dlv/edges: ')


def test_posed_views_that_a_search_in_light_fields_excludes_are_told_once(node, user):
    """As of a bag that is replayed: the node that waits is said how to take them."""
    process, told = node('pmcl_node')
    poses = user.publisher(PoseArray, 'posed_views/poses', SMALL)
    for stamp in (7, 8):
        poses.publish(PoseArray(header=header_to_message(Header(stamp, 'base'))))
    excluded = KeyValue(key='posed views that source excludes', value='2')
    user.wait(lambda: told and excluded in told[-1].status[0].values, 'the count')
    assert process.log.count('posed views have come, which source light_field excludes: set '
                             'source to posed_views') == 1


def test_what_is_awaited_gives_way_to_what_comes(node, user, small_light_field):
    """A part that nobody publishes is named alone; the log tells a lack once, whatever follows."""
    process, told = node('dlv_node', 'views/pupil:=pupil')
    info, pupil, mosaic = light_field_to_messages(small_light_field)
    views = user.publisher(Image, 'views', BIG)
    tell = user.publisher(CameraInfo, 'views/camera_info', BIG)
    user.listen(Float32MultiArray, 'dlv/edges', BIG)
    comes(user, told, WARN, 'awaits /pupil (publishers: 0)')
    tell.publish(info)
    views.publish(mosaic)
    user.delivered(views)
    told.clear()
    comes(user, told, WARN, 'awaits /pupil (publishers: 0)')
    user.publisher(Image, 'pupil', BIG).publish(pupil)
    user.wait(lambda: last(told)[1].startswith('published capture'), 'evidence')
    assert last(told)[0] == DiagnosticStatus.OK
    assert process.log.count('awaits') == 1


@pytest.mark.parametrize(('kind', 'qos', 'why'), [
    (String, VOLATILE, 'Volatile publisher and transient local subscription'),
    (String, LOSSY, 'Best effort publisher and reliable subscription, '
     'Volatile publisher and transient local subscription'),
    (Image, LATCHED, 'sensor_msgs/msg/Image is not std_msgs/msg/String')],
    ids=['volatile', 'best effort', 'of another type'])
def test_a_publisher_that_is_not_heard_is_told_with_the_reason(node, user, kind, qos, why):
    """As `ros2 topic pub` has it: not latched."""
    user.node.create_publisher(kind, 'metadata', qos)
    user.node.create_publisher(Image, 'image_raw', BIG)  # both are known at once
    process, told = node('subaperture_node')
    user.wait(lambda: last(told)[0] == WARN, 'a warning')
    awaited = f'awaits /metadata (publishers: 1, not heard: {why})'
    assert last(told)[1] == awaited
    assert process.log.count(f'{awaited}{NOBODY}') == 1


def test_one_of_two_ways_is_enough(node, user):
    """A pose without its covariance; grasps, or none, are told from then on."""
    _, told = node('grasp_node')
    pose = user.publisher(PoseStamped, 'pose', SMALL)
    comes(user, told, OK, 'awaits /pose (publishers: 1)')
    pose.publish(PoseStamped(header=header_to_message(Header(7, 'camera'))))
    user.delivered(pose)
    user.wait(lambda: last(told)[1].startswith("ranking: the pose is in frame 'camera'"),
              'a refusal')
