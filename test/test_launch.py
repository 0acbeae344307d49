"""launch/pmcl.launch.py starts every node of the table and chains its events.

`launch` and `launch_ros` are not on PyPI, so the file runs here on recorders of its calls; on a
full ROS test/launch runs it for real. That file is checked here too.
"""

import importlib.util
import runpy
import sys
import unittest
from types import ModuleType, SimpleNamespace

import ament_index_python.packages
import pytest
from harness import ROOT, Process

from pmcl_ros.runtime.start import MODULES as ENTRY_POINTS

pytest.importorskip('lifecycle_msgs')

FILE = ROOT / 'launch' / 'pmcl.launch.py'
LAUNCH_TEST = ROOT / 'test' / 'launch' / 'test_launched_pose.py'
MODULES = {
    'launch': ['LaunchDescription'],
    'launch.actions': ['DeclareLaunchArgument', 'EmitEvent', 'IncludeLaunchDescription',
                       'OpaqueFunction', 'RegisterEventHandler'],
    'launch.event_handlers': ['OnProcessStart'],
    'launch.events': ['matches_action'],
    'launch.launch_description_sources': ['PythonLaunchDescriptionSource'],
    'launch.substitutions': ['LaunchConfiguration', 'PathJoinSubstitution'],
    'launch_testing': [],
    'launch_testing.actions': ['ReadyToTest'],
    'launch_ros': [],
    'launch_ros.actions': ['LifecycleNode', 'Node'],
    'launch_ros.event_handlers': ['OnStateTransition'],
    'launch_ros.events': [],
    'launch_ros.events.lifecycle': ['ChangeState'],
    'launch_ros.substitutions': ['FindPackageShare'],
}


class Call(SimpleNamespace):
    """One constructor's call: its name, and its arguments as attributes."""

    def perform(self, context):
        return context[self.given[0]]


def recorder(name):
    return lambda *given, **named: Call(call=name, given=given, **named)


@pytest.fixture
def recorders(monkeypatch):
    """In the place of the modules of a full ROS."""
    if importlib.util.find_spec('launch_ros'):
        pytest.skip('full ROS: run `ros2 launch pmcl_ros pmcl.launch.py`, `pytest test/launch`')
    for name, functions in MODULES.items():
        module = ModuleType(name)
        for each in functions:
            setattr(module, each, recorder(each))
        monkeypatch.setitem(sys.modules, name, module)


@pytest.fixture
def launch(recorders):
    """The names that the launch file defines."""
    return runpy.run_path(str(FILE))


@pytest.fixture
def launch_test(recorders):
    """The names that the launch test defines."""
    return runpy.run_path(str(LAUNCH_TEST))


GIVEN = {'without': '', 'autostart': 'false', 'grasps': '', 'sweep': '', 'views': '',
         'lytro': 'false', 'board': 'false', 'respawn': 'false'}


def started(launch, **given):
    """The actions that are started, and what each emitted or chained event does, in words."""
    actions = launch['start'](GIVEN | {'autostart': 'true'} | given)
    nodes = [each for each in actions if each.call == 'LifecycleNode']

    def words(emit):
        event, = (emit.event,)
        return event.lifecycle_node_matcher.given[0].name, event.transition_id

    chained = {}
    for each in actions:
        if each.call == 'RegisterEventHandler':
            handler, = each.given
            when = handler.target_lifecycle_node.name, handler.start_state, handler.goal_state
            assert handler.handle_once
            chained[when] = [words(emit) for emit in handler.entities]
    first = [words(each) for each in actions if each.call == 'EmitEvent']
    return [each.name for each in nodes], first, chained


def test_arguments(launch):
    description = launch['generate_launch_description']()
    names = [each.given[0] for each in description.given[0]
             if each.call == 'DeclareLaunchArgument']
    assert names == ['params_file', 'namespace', 'autostart', 'without', 'grasps', 'sweep',
                     'views', 'lytro', 'board', 'pose', 'respawn']


def test_nodes_are_configured_then_activated_one_after_the_other(launch):
    nodes, first, chained = started(launch)
    configure, activate = launch['CONFIGURE'], launch['ACTIVATE']
    assert nodes == ['pmcl_node', 'dlv_node', 'subaperture_node', 'lytro_driver']
    order, event = [], first
    while event:
        (name, transition), = event
        order.append((name, transition))
        states = (('configuring', 'inactive') if transition == configure
                  else ('activating', 'active'))
        event = chained.pop((name, *states), None)
    assert order == [*((name, configure) for name in nodes), *((name, activate) for name in nodes)]
    assert not chained


def test_nodes_can_be_left_out_and_left_alone(launch):
    nodes, first, chained = started(launch, without='lytro_driver,dlv_node', autostart='false')
    assert nodes == ['pmcl_node', 'subaperture_node']
    assert not first
    assert not chained


def test_a_node_that_is_not_there_cannot_be_left_out(launch):
    with pytest.raises(RuntimeError, match="no node 'lytro_drivr'; known: lytro_driver"):
        started(launch, without='dlv_node, lytro_drivr')


def test_a_grasp_file_starts_the_grasp_node_first(launch):
    nodes, first, _ = started(launch, grasps='glass.yaml')
    assert nodes == ['grasp_node', 'pmcl_node', 'dlv_node', 'subaperture_node', 'lytro_driver']
    assert first == [('grasp_node', launch['CONFIGURE'])]
    actions = launch['start'](GIVEN | {'grasps': 'glass.yaml'})
    assert actions[0].parameters[1] == {'grasps': 'glass.yaml'}


def test_a_plan_starts_the_sweep_driver_in_place_of_the_lytro(launch):
    nodes, first, _ = started(launch, sweep='plan.yaml', without='dlv_node')
    assert nodes == ['pmcl_node', 'sweep_driver']
    assert first == [('pmcl_node', launch['CONFIGURE'])]
    actions = launch['start'](GIVEN | {'sweep': 'plan.yaml'})
    assert actions[-1].parameters[1] == {'plan': 'plan.yaml', 'collect': 'grid'}
    assert actions[0].name == 'pmcl_node'
    assert actions[0].parameters[1] == {'source': 'light_field'}


def test_posed_views_start_the_sweep_driver_and_are_what_is_searched(launch):
    given = GIVEN | {'views': 'rest'}
    nodes = {each.name: each for each in launch['start'](given)}
    assert list(nodes) == ['pmcl_node', 'dlv_node', 'sweep_driver']
    assert nodes['sweep_driver'].parameters[1] == {'collect': 'rest'}
    assert nodes['pmcl_node'].parameters[1] == {'source': 'posed_views'}
    with pytest.raises(RuntimeError, match='give one of them'):
        launch['start'](given | {'sweep': 'plan.yaml'})


def test_fixed_cameras_take_the_place_of_the_sweep_driver(launch):
    given = GIVEN | {'without': 'dlv_node', 'views': 'fixed'}
    nodes = {each.name: each for each in launch['start'](given)}
    assert list(nodes) == ['pmcl_node', 'fixed_cameras']
    assert nodes['pmcl_node'].parameters[1] == {'source': 'posed_views'}
    with pytest.raises(RuntimeError, match='of a moved camera'):
        launch['start'](given | {'lytro': 'true'})


def test_a_board_tells_where_the_camera_is(launch):
    given = GIVEN | {'views': 'service', 'board': 'true', 'without': 'dlv_node'}
    nodes = {each.name: each for each in launch['start'](given)}
    assert list(nodes) == ['pmcl_node', 'sweep_driver', 'board_node']
    assert nodes['sweep_driver'].parameters[1] == {
        'collect': 'service', 'poses': 'topic', 'fixed_frame': 'board',
        'mount_position': [0.0] * 3, 'mount_rpy': [0.0] * 3, 'common': 0.0}
    assert nodes['board_node'].parameters[1] == {'fixed_frame': 'board'}
    for other in ({'views': ''}, {'views': 'fixed'}, {'lytro': 'true'}):
        with pytest.raises(RuntimeError, match='board tells where an ordinary camera is'):
            launch['start'](given | other)


def test_posed_views_can_be_the_centre_views_of_a_lytro(launch):
    given = GIVEN | {'views': 'rest', 'lytro': 'true'}
    nodes = {each.name: each for each in launch['start'](given)}
    assert list(nodes) == ['pmcl_node', 'dlv_node', 'sweep_driver', 'subaperture_node',
                           'lytro_driver']
    assert nodes['sweep_driver'].remappings[1:] == [
        ('image', 'center/image'), ('camera_info', 'center/camera_info')]
    assert len(nodes['pmcl_node'].remappings) == 1
    with pytest.raises(RuntimeError, match='give views too'):
        launch['start'](given | {'views': ''})


def test_the_pose_is_remapped_for_who_publishes_and_who_takes_it(launch):
    actions = launch['start'](GIVEN | {'grasps': 'glass.yaml'})
    remapped = {each.name: [(name, to.given) for name, to in each.remappings] for each in actions}
    assert remapped['pmcl_node'] == remapped['grasp_node'] == [('pose', ('pose',))]


def test_nodes_are_taken_to_active_whenever_they_are_started(launch):
    actions = launch['start'](GIVEN | {'autostart': 'true', 'respawn': 'true'})
    nodes = [each for each in actions if each.call == 'LifecycleNode']
    assert [each.respawn for each in nodes] == [True] * 4
    handlers = [each.given[0] for each in actions if each.call == 'RegisterEventHandler']
    for node in nodes:
        started, = (each for each in handlers
                    if each.call == 'OnProcessStart' and each.target_action is node)
        configured, = (each for each in handlers if each.call == 'OnStateTransition'
                       and each.target_lifecycle_node is node)
        assert [each.event.transition_id for each in started.on_start] == [launch['CONFIGURE']]
        assert [each.event.transition_id for each in configured.entities] == [launch['ACTIVATE']]
        assert (configured.start_state, configured.goal_state) == ('configuring', 'inactive')
        assert not hasattr(configured, 'handle_once')


def test_the_launch_test_starts_the_launch_file_and_the_bag(launch, launch_test, monkeypatch):
    describe = launch_test['generate_test_description']
    assert [mark.name for mark in describe.pytestmark] == ['launch_test']

    def share_of(name):
        if name != built:
            raise ament_index_python.packages.PackageNotFoundError(name)

    monkeypatch.setitem(describe.__globals__, 'get_package_share_directory', share_of)
    built = ''
    with pytest.raises(unittest.SkipTest, match='colcon build --packages-select pmcl_ros'):
        describe()
    built = 'pmcl_ros'
    included, player, ready = describe().given[0]
    assert ready.call == 'ReadyToTest'
    source, = included.given
    (joined,), = source.given
    (share, *parts), = joined.given
    assert share.given == ('pmcl_ros',)
    assert ROOT.joinpath(*parts) == FILE
    nodes, first, _ = started(launch, **dict(included.launch_arguments))
    assert nodes == ['pmcl_node', 'dlv_node', 'subaperture_node']
    assert first  # they are taken to active
    assert (player.package, player.executable in ENTRY_POINTS) == ('pmcl_ros', True)


def test_the_launch_test_s_own_test_passes_with_the_nodes_of_pmcl_bringup(
        launch_test, recorders, tmp_path):
    """The same nodes with the same parameters, as one process."""
    player = launch_test['generate_test_description'].__globals__['BAG']
    suite = unittest.defaultTestLoader.loadTestsFromTestCase(launch_test['TestLaunchedPose'])
    assert suite.countTestCases() == 1
    with (Process(tmp_path, 'pmcl_ros.nodes.bringup', '--params-file',
                  ROOT / 'config' / 'pmcl.yaml', '--without', 'lytro_driver'),
          Process(tmp_path, 'pmcl_ros.nodes.replay', player, '--timeout', '300')):
        result = unittest.TextTestRunner().run(suite)
    assert result.wasSuccessful(), result
