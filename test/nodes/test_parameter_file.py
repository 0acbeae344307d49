"""A parameter file is for the nodes that its author meant, or that is told."""

import pytest
from harness import ROOT

from pmcl_ros.errors import SettingsError
from pmcl_ros.nodes.parameter_file import check_parameter_file


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
    ('dlv_node: {labels: 5}', 'has no parameters: expected NODE: {ros__parameters: '),
    ('- 1', 'holds list, expected a mapping'),
])
def test_what_ros_would_pass_over_in_silence_is_refused(write, text, reason):
    with pytest.raises(SettingsError, match=reason):
        check_parameter_file(write(text))
