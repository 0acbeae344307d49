"""docs/reference.md and config/pmcl.yaml are what the code says, and that what the nodes do."""

import re
from importlib.util import find_spec

import pytest
import rclpy
import yaml
from harness import ROOT
from rclpy.context import Context
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from std_srvs.srv import Trigger

from pmcl_ros.nodes.graph import ALL, OPTIONAL, PRESETS, SERVICES, TOPICS
from pmcl_ros.nodes.reference import main
from pmcl_ros.nodes.runtime.parameters import ros_type

MADE = {'docs/reference.md': [], 'config/pmcl.yaml': ['--parameters']}


@pytest.mark.parametrize(('file', 'arguments'), MADE.items())
def test_the_files_are_what_make_docs_writes(capsys, file, arguments):
    assert main(arguments) == 0
    assert (ROOT / file).read_text() == capsys.readouterr().out, f'{file} is old: make docs'


# As YAML on one line: NODE: {ros__parameters: {...}}
WRITTEN = re.compile(r'^ +(\w+): (\{ros__parameters: \{.*?\}\})', re.MULTILINE)


def test_parameters_in_how_tos_are_of_their_types():
    """ROS takes no 1 where it expects 1.0."""
    classes = {each.name: each.load().settings_class for each in ALL}
    written = {(node, name, str(value)): value for page in (ROOT / 'docs' / 'howto').glob('*.md')
               for node, text in WRITTEN.findall(page.read_text())
               for name, value in yaml.safe_load(text)['ros__parameters'].items()}
    assert ('board_node', 'ring', '8x11') in written
    for (node, name, _), value in written.items():
        assert Parameter(name, value=value).type_ == ros_type(classes[node].model_fields[name])


# Parameters with which a node listens to all that it can.
ASKED = {'grasp_node': {'grasps': f'{ROOT}/config/objects/wine_glass.grasps.yaml', 'arm': 'topic'},
         'pmcl_node': {'tracking': 'camera', 'track_camera': 'topic'},
         'sweep_driver': {'poses': 'topic'},
         'board_node': {'corners': '10x7'},  # rings need OpenCV 4.7
         'fixed_cameras': {'camera_poses': f'{ROOT}/test/data/two_cameras.yaml'}}


INSTALLED = [each for each in OPTIONAL if find_spec(each.type.partition('/')[0])]

# Topics to which a node subscribes in other circumstances.
# dlv: mode faithful, or while nobody publishes dlv/edges; dlv/contour_map: evidence map, or auto
# without tracking; posed_views: in place of all these. Their poses tell what source excludes.
CONDITIONAL = {'pmcl_node': ('dlv', 'dlv/contour_map', *(
    each for each in PRESETS['posed_views'] if each != 'posed_views/poses'))}


@pytest.fixture(params=ALL, ids=lambda entry: entry.name)
def node(request, parameters):
    """Each node, active."""
    name = request.param.name
    values = parameters.get(name, {}) | ASKED.get(name, {})
    context = Context()
    rclpy.init(context=context)
    node = request.param.load()(context=context, parameter_overrides=[
        Parameter(each, value=value) for each, value in values.items()])
    assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
    yield node
    node.close()
    rclpy.shutdown(context=context)


def ends(node, endpoints):
    """{topic: (type, depth, latched)} of what is not every node's."""
    found = {}
    for each in endpoints:
        if each.topic_name in ('/parameter_events', '/rosout', '/clock'):
            continue
        qos, kind = each.qos_profile, each.msg_type
        assert qos.reliability == ReliabilityPolicy.RELIABLE, each.topic_name
        found[each.topic_name] = (
            f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}', qos.depth,
            qos.durability == DurabilityPolicy.TRANSIENT_LOCAL)
    return found


def listed(topics):
    return {f'/{each.name.lstrip("/")}': (each.type, *each.quality) for each in topics}


def test_topics_and_services_are_those_of_the_nodes(node):
    name = node.get_name()
    assert ends(node, node.publishers) == listed(
        each for each in (*TOPICS, *INSTALLED) if {name, 'all nodes'} & {*each.publishers})
    assert ends(node, node.subscriptions) == listed(
        each._replace(quality=each.quality_for(name)) for each in TOPICS
        if name in each.subscribers and each.name not in CONDITIONAL.get(name, ()))
    triggers = [each.srv_name for each in node.services if each.srv_type is Trigger]
    assert triggers == [service for service, _ in SERVICES.get(name, ())]


def test_presets_are_of_topics():
    names = [each.name for each in TOPICS]
    assert len(set(names)) == len(names)
    for topics in PRESETS.values():
        assert set(topics) <= {*names}
    # what each stage's node takes is in the preset before it
    for presets, name in ((('raw',), 'subaperture_node'), (('views', 'posed_views'), 'dlv_node'),
                          (('dlv', 'posed_views'), 'pmcl_node')):
        recorded = {topic for preset in presets for topic in PRESETS[preset]}
        assert {each.name for each in TOPICS if name in each.subscribers} <= recorded
