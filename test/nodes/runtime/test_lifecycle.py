"""Every node survives what managers and users do to it, as a process of its own."""

import pytest
from harness import (
    ACTIVATE,
    ACTIVE,
    CLEANUP,
    CONFIGURE,
    DEACTIVATE,
    INACTIVE,
    UNCONFIGURED,
    Process,
)

NODES = ['lytro_driver', 'subaperture_node', 'dlv_node', 'pmcl_node']
# a parameter, what it must not be, what is said then
WRONG = {
    'lytro_driver': ('path', '/nowhere', "parameter 'path': there is no /nowhere"),
    'subaperture_node': ('calibration', '', "parameter 'calibration' is empty"),
    'dlv_node': ('near', 5.0, 'near 5.0 m must be smaller than far'),
    'pmcl_node': ('roi_size', [0.1, -0.1, 0.1], 'roi_size.1: Input should be greater than 0'),
}


@pytest.fixture(scope='module', params=NODES)
def process(request, tmp_path_factory, parameters):
    """Each test finds the node unconfigured and leaves it so."""
    name = request.param
    with Process(tmp_path_factory.mktemp(name), f'pmcl_ros.nodes.{name}',
                 params=parameters[name]) as process:
        yield process


def test_an_impossible_transition_is_refused_and_said(process, user):
    name = process.name
    assert not user.change(name, ACTIVATE)
    assert 'no transition 3 from unconfigured; possible:' in process.log
    assert user.change(name, CONFIGURE)
    assert not user.change(name, CONFIGURE)
    assert user.state(name) == INACTIVE
    assert user.change(name, ACTIVATE)
    assert not user.change(name, ACTIVATE)
    assert not user.change(name, CLEANUP)
    assert user.state(name) == ACTIVE
    assert user.change(name, DEACTIVATE)
    assert not user.change(name, DEACTIVATE)
    assert user.change(name, CLEANUP)
    assert user.state(name) == UNCONFIGURED
    assert 'Traceback' not in process.log


def test_a_bad_parameter_fails_clearly_and_a_good_one_then_works(process, user, parameters):
    name = process.name
    parameter, value, reason = WRONG[name]
    good = parameters[name].get(parameter, 0.3)
    assert user.set(name, **{parameter: value}) == []
    assert not user.change(name, CONFIGURE)
    assert user.state(name) == UNCONFIGURED
    assert 'cannot configure: ' in process.log
    assert reason in process.log
    assert 'Traceback' not in process.log
    assert user.set(name, **{parameter: good}) == []
    assert user.change(name, CONFIGURE, CLEANUP) == [True, True]


def test_configuring_again_and_again_leaves_nothing_behind(process, user):
    name = process.name
    before = sorted(['/parameter_events', '/rosout', f'/{name}/transition_event'])
    user.wait(lambda: user.publishers_of(name) == before, 'what every node publishes')
    assert all(user.change(name, CONFIGURE, ACTIVATE))
    # the last that is made: who knows of it knows of the others
    user.wait(lambda: '/diagnostics' in user.publishers_of(name), 'publishers')
    active = user.publishers_of(name)
    assert len(active) > len(before)
    assert all(user.change(name, DEACTIVATE, CLEANUP))
    for _ in range(5):
        assert all(user.change(name, CONFIGURE, ACTIVATE, DEACTIVATE, CLEANUP))
    user.wait(lambda: user.publishers_of(name) == before, 'publishers to go')
    assert all(user.change(name, CONFIGURE, ACTIVATE))
    user.wait(lambda: user.publishers_of(name) == active, 'publishers to come')
    assert all(user.change(name, DEACTIVATE, CLEANUP))


def test_diagnostics_come_while_active(process, user):
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
    name = process.name
    assert all(user.change(name, CONFIGURE, ACTIVATE))
    messages = user.listen(DiagnosticArray, '/diagnostics', 10)
    user.wait(lambda: len(messages) >= 2, 'diagnostics')
    status = messages[-1].status[0]
    assert (status.name, status.level) == (name, DiagnosticStatus.OK)
    keys = [each.key for each in status.values]
    assert keys[:8] == ['frames in', 'frames out', 'dropped', 'errors', 'last error',
                        'last latency [ms]', 'back end', 'rate [Hz]']
    if name == 'dlv_node':
        assert status.values[6].value in ('numba', 'gl')
    assert all(user.change(name, DEACTIVATE, CLEANUP))


@pytest.mark.parametrize('name', ['dlv_node'])
def test_an_integer_for_a_double_is_explained(tmp_path, user, name):
    with Process(tmp_path, f'pmcl_ros.nodes.{name}', params={'near': 1}) as process:
        assert not user.change(name, CONFIGURE)
        assert "parameter 'near'" in process.log
        assert 'write 1.0, not 1' in process.log
        assert user.set(name, near=0.4) == []
        assert user.change(name, CONFIGURE)


def test_a_misspelt_parameter_is_told_and_the_node_lives_on(tmp_path, user):
    with Process(tmp_path, 'pmcl_ros.nodes.dlv_node', params={'lables': 16}) as process:
        assert not user.change('dlv_node', CONFIGURE)
        assert ("cannot configure: dlv_node: unknown parameter 'lables'; did you mean 'labels'?"
                in process.log)
        assert user.state('dlv_node') == UNCONFIGURED
