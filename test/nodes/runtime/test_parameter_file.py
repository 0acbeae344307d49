"""A parameter file is for the nodes that its author meant, or that is told."""

import pytest
import rclpy
from harness import ROOT
from rclpy.context import Context
from rclpy.node import Node

from pmcl_ros.nodes.runtime.parameter_file import (
    check_parameter_file,
    given_elsewhere,
    parameter_file,
)
from pmcl_ros.runtime.errors import SettingsError


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / 'parameters.yaml'
        path.write_text(text)
        return path
    return write


def test_the_shipped_file_is_for_our_nodes():
    assert check_parameter_file(ROOT / 'config' / 'pmcl.yaml') == []


@pytest.mark.parametrize(('text', 'others'), [
    ('/**: {ros__parameters: {use_sim_time: true}}', []),
    ('/left/dlv_node: {ros__parameters: {}}', []),
    ('/**/dlv_node: {ros__parameters: {use_sim_time: true, qos_overrides./dlv.publisher.depth: 2,'
     ' qos_overrides: {/dlv/depth: {publisher: {depth: 3}}}}}', []),
    ('/**: {ros__parameters: {labels: 5, move_group_has_it: 1}}', []),  # each node judges
    ('/left: {pmcl_node: {ros__parameters: {seed: 3}}}', []),
    ('dlv_node: {ros__parameters: {}}\nmove_group: {ros__parameters: {}}', ['move_group']),
    ('/arm: {/controller: {ros__parameters: {}}}', ['arm/controller']),
])
def test_who_else_has_parameters_in_it_is_told(write, text, others):
    assert check_parameter_file(write(text)) == others


@pytest.mark.parametrize(('text', 'reason'), [
    ('/**/dlv_nod: {ros__parameters: {labels: 5}}',
     r"'\*\*/dlv_nod', but there is no node 'dlv_nod'; did you mean 'dlv_node'\?"),
    ('/left: {lytro-driver: {ros__parameters: {}}}', "did you mean 'lytro_driver'"),
    ('pmcl_node: {ros__parameters: {roi_center: [0, 0.1, 1]}}',
     r"gives 'pmcl_node' roi_center: \[0, 0.1, 1\]: ROS wants numbers of one kind"),
    ('dlv_node: {ros__parameters: {labls: 5}}',
     "gives 'dlv_node' an unknown parameter 'labls'; did you mean 'labels'"),
    ('/arm: {pmcl_node: {ros__parameters: {labels: 5}}}',
     "gives 'arm/pmcl_node' an unknown parameter 'labels'; dlv_node has it"),
    ('dlv_node: {labels: 5}', 'has no parameters: expected NODE: {ros__parameters: '),
    ('dlv_node: {ros__parameters: [labels]}',
     r"gives 'dlv_node' ros__parameters: \['labels'\]: expected a mapping {NAME: VALUE}"),
    ('dlv_node: {ros__parameters: 5}', "gives 'dlv_node' ros__parameters: 5: expected a mapping"),
    ('- 1', 'holds list, expected a mapping'),
])
def test_what_ros_would_pass_over_in_silence_is_refused(write, text, reason):
    with pytest.raises(SettingsError, match=reason):
        check_parameter_file(write(text))


@pytest.mark.parametrize('namespace', ['', '/arm', '/left/arm'])
def test_values_for_one_node_reach_it_in_every_namespace_and_no_other(namespace):
    context = Context()
    with parameter_file({'grasp_node': {'grasps': 'a.yaml'}, 'sweep_driver': {'plan': None}}
                        ) as arguments:
        rclpy.init(args=arguments, context=context)
        nodes = [Node(name, context=context, namespace=namespace, allow_undeclared_parameters=True,
                      automatically_declare_parameters_from_overrides=True)
                 for name in ('grasp_node', 'sweep_driver')]
        found = [each.get_parameter_or('grasps').value for each in nodes]
        rclpy.shutdown(context=context)
    assert found == ['a.yaml', None]


@pytest.mark.parametrize('section', ['/**', 'pmcl_node', '/**/pmcl_node', '/arm/pmcl_node'])
def test_they_go_over_what_files_say_whatever_their_sections_are_called(write, section):
    file = write(f'"{section}": {{ros__parameters: {{source: light_field}}}}')
    given = [part for each in (ROOT / 'config' / 'pmcl.yaml', file)
             for part in ('--ros-args', '--params-file', str(each), '--')]
    context = Context()
    with parameter_file({'pmcl_node': {'source': 'posed_views'}}) as arguments:
        rclpy.init(args=[*given, *arguments], context=context)
        nodes = [Node('pmcl_node', context=context, namespace=namespace,
                      automatically_declare_parameters_from_overrides=True)
                 for namespace in ('', '/arm')]
        found = [each.get_parameter('source').value for each in nodes]
        rclpy.shutdown(context=context)
    assert found == ['posed_views'] * 2


def test_no_values_are_no_arguments():
    with parameter_file({'grasp_node': {'grasps': None}}) as arguments:
        assert arguments == []


@pytest.mark.parametrize('namespace', ['', '/arm', '/left/arm'])
@pytest.mark.parametrize('section', [
    'dlv_node', '/dlv_node', '/arm/dlv_node', 'left/arm/dlv_node', '/*/dlv_node', '/**/dlv_node',
    '/left/**/dlv_node', '/**', '/**/arm/dlv_node'])
def test_a_section_for_a_node_elsewhere_is_told_where_ros_passes_over_it(
        write, section, namespace):
    file, context = write(f'"{section}": {{ros__parameters: {{labels: 5}}}}'), Context()
    arguments = ['--ros-args', '--params-file', str(file)]
    rclpy.init(args=arguments, context=context)
    node = Node('dlv_node', context=context, namespace=namespace, allow_undeclared_parameters=True,
                automatically_declare_parameters_from_overrides=True)
    reached = node.has_parameter('labels')
    told = given_elsewhere(arguments, node.get_fully_qualified_name())
    rclpy.shutdown(context=context)
    assert told == ([] if reached else [(str(file), section.lstrip('/'))])


def test_a_file_for_several_robots_is_for_none_elsewhere(write):
    file = write('/left: {dlv_node: {ros__parameters: {labels: 5}}}\n'
                 '/right: {dlv_node: {ros__parameters: {labels: 7}}}')
    arguments = ['--params-file', str(file)]
    assert given_elsewhere(arguments, '/right/dlv_node') == []
    assert given_elsewhere(arguments, '/right/pmcl_node') == []
    assert given_elsewhere(arguments, '/dlv_node') == [(str(file), 'left/dlv_node')]
