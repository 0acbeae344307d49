"""The chain comes up and goes down as a whole, and says which node is in the way."""

import os
import signal
from pathlib import Path

import cv2
import pytest
import viewer_layouts
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from harness import ACTIVE, CONFIGURE, PATIENCE, ROOT, UNCONFIGURED, Process
from sensor_msgs.msg import Image
from std_msgs.msg import String
from std_srvs.srv import Trigger

from pmcl_ros.nodes.graph import TOPICS
from pmcl_ros.nodes.runtime.base import BIG, LATCHED, SMALL

NODES = ['lytro_driver', 'subaperture_node', 'dlv_node', 'pmcl_node']
BRINGUP = 'pmcl_ros.nodes.bringup'


@pytest.fixture
def write(tmp_path, parameters):
    """A function changes -> a parameter file, for nodes in any namespace."""
    def write(changes=None):
        file = tmp_path / 'parameters.yaml'
        file.write_text(yaml.safe_dump({
            f'/**/{node}': {'ros__parameters': values | (changes or {}).get(node, {})}
            for node, values in parameters.items()}))
        return file
    return write


def ends(process, status):
    assert process.popen.wait(PATIENCE) == status, process.log


def children(pid):
    """Numbers of the processes that a process has started."""
    return [int(each) for task in Path(f'/proc/{pid}/task').iterdir()
            for each in (task / 'children').read_text().split()]


@pytest.mark.parametrize('how', [[], ['--processes']], ids=['one process', 'four'])
def test_all_nodes_become_active_and_a_signal_ends_them(tmp_path, user, write, how):
    with Process(tmp_path, BRINGUP, '--params-file', write(), *how) as chain:
        user.wait(lambda: 'active: ' in chain.log or not chain.alive(), 'the chain')
        assert 'active: pmcl_node, dlv_node, subaperture_node, lytro_driver' in chain.log
        assert [user.state(node) for node in NODES] == [ACTIVE] * 4
        images = user.listen(Image, 'image_raw', BIG)
        texts = user.listen(String, 'metadata', LATCHED)
        table = {f'/{each.name}': each for each in TOPICS}
        shown = dict([*viewer_layouts.rviz(), *viewer_layouts.foxglove()])
        for topic, kind in shown.items():
            assert topic == '/diagnostics' or table[topic].type == kind
        del shown['/grasp_markers']  # grasp_node is not started; its test listens to them
        # A node may be found before its topics are.
        user.wait(lambda: shown.items() <= {
            topic: kinds[0] for topic, kinds in user.node.get_topic_names_and_types()}.items(),
            'all topics that are shown')
        capture = user.call(Trigger, '/lytro_driver/capture', Trigger.Request())
        assert capture.success, capture.message
        user.wait(lambda: images and texts, 'a picture')
        nodes = children(chain.popen.pid)
        assert len(nodes) == (4 if how else 0)
        chain.popen.send_signal(signal.SIGTERM)
        ends(chain, 0)
        assert not any(Path(f'/proc/{each}').exists() for each in nodes)
        assert 'Traceback' not in chain.log
    # Names of nodes come by a topic, so that of a node that has ended can come late, and stay.
    user.wait(lambda: not any(user.node.count_publishers(topic) for topic in shown),
              'the nodes to go')


@pytest.mark.parametrize('how', [
    [], ['--processes', '--without', 'pmcl_node', '--without', 'subaperture_node']],
    ids=['one process', 'two'])
def test_the_node_that_fails_is_named(tmp_path, write, how):
    file = write({'dlv_node': {'near': 2.0}})
    with Process(tmp_path, BRINGUP, '--params-file', file, *how, status=1) as chain:
        ends(chain, 1)
    assert 'pmcl_bringup: dlv_node could not configure' in chain.log
    assert 'near 2.0 m must be smaller than far' in chain.log


def test_a_node_process_that_ends_ends_the_chain(tmp_path, user, write):
    with Process(tmp_path, BRINGUP, '--params-file', write(), '--processes', '--without',
                 'pmcl_node', '--without', 'subaperture_node', '--without', 'lytro_driver',
                 status=1) as chain:
        user.wait(lambda: 'active: dlv_node' in chain.log or not chain.alive(), 'the chain')
        pid = chain.popen.pid
        child, = Path(f'/proc/{pid}/task/{pid}/children').read_text().split()
        os.kill(int(child), signal.SIGKILL)
        ends(chain, 1)
    assert 'pmcl_bringup: dlv_node has ended' in chain.log


def runs(pid):
    """Whether there is such a process, and it has not ended unnoticed."""
    stat = Path(f'/proc/{pid}/stat')
    return stat.exists() and stat.read_text().rpartition(')')[2].split()[0] != 'Z'


def test_nodes_do_not_outlive_a_bring_up_that_is_killed(tmp_path, user, write):
    with Process(tmp_path, BRINGUP, '--params-file', write(), '--processes', '--without',
                 'pmcl_node', '--without', 'dlv_node', status=-signal.SIGKILL) as chain:
        user.wait(lambda: 'active: ' in chain.log or not chain.alive(), 'the chain')
        pid = chain.popen.pid
        children = Path(f'/proc/{pid}/task/{pid}/children').read_text().split()
        assert len(children) == 2
        chain.popen.kill()
        ends(chain, -signal.SIGKILL)
        user.wait(lambda: not any(map(runs, children)), 'the nodes to end')
    assert 'Traceback' not in chain.log


def test_without_autostart_nodes_wait_for_their_manager(tmp_path, user, write):
    with Process(tmp_path, BRINGUP, '--params-file', write(), '--no-autostart', '--without',
                 'subaperture_node', '--without', 'pmcl_node', '--without',
                 'lytro_driver') as chain:
        assert user.state('dlv_node') == UNCONFIGURED
        assert user.change('dlv_node', CONFIGURE)
        assert chain.alive()


def test_a_file_that_is_not_for_the_namespace_is_told(tmp_path, user):
    """Else it looks as if the file lacked what is in it."""
    mine = tmp_path / 'mine.yaml'
    mine.write_text('pmcl_node: {ros__parameters: {object: glass.yaml}}')
    with Process(tmp_path, BRINGUP, '--params-file', mine, '--without', 'subaperture_node',
                 '--without', 'lytro_driver', '--ros-args', '-r', '__ns:=/left',
                 status=1) as chain:
        user.wait(lambda: not chain.alive(), 'the end')
    assert (f"{mine} has parameters for 'pmcl_node', not for /left/pmcl_node: for nodes in any "
            'namespace it is /**/pmcl_node') in chain.log


def test_nodes_live_in_a_namespace(tmp_path, user, write):
    with Process(tmp_path, BRINGUP, '--params-file', write(), '--without', 'subaperture_node',
                 '--without', 'pmcl_node', '--ros-args', '-r', '__ns:=/left') as chain:
        user.wait(lambda: 'active: ' in chain.log or not chain.alive(), 'the chain')
        assert user.state('left/dlv_node') == ACTIVE
        user.listen(Image, '/left/image_raw', BIG)
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
        user.wait(lambda: {each.status[0].name for each in states}
                  == {'left/lytro_driver', 'left/dlv_node'}, 'the state of both, by their names')


def test_the_pose_is_where_a_grasp_pipeline_wants_it(tmp_path, user, write):
    """And where grasp_node finds it too."""
    grasps = ROOT / 'config' / 'objects' / 'wine_glass.grasps.yaml'
    with Process(tmp_path, BRINGUP, '--params-file', write(), '--without', 'lytro_driver',
                 '--without', 'subaperture_node', '--without', 'dlv_node', '--grasps', grasps,
                 '--pose', '/robot/target') as chain:
        user.wait(lambda: 'active: ' in chain.log or not chain.alive(), 'the chain')
        assert 'active: grasp_node, pmcl_node' in chain.log
        user.listen(PoseStamped, '/robot/target', SMALL)
        user.wait(lambda: {'user', 'grasp_node'} <= {
            each.node_name for each in user.node.get_subscriptions_info_by_topic('/robot/target')},
            'both that take it')
        assert not user.node.get_publishers_info_by_topic('/pose')


@pytest.mark.parametrize('how', [[], ['--processes']], ids=['one process', 'two'])
def test_what_a_file_gives_to_all_nodes_is_told_of_none(tmp_path, user, write, how):
    mount = tmp_path / 'mount.yaml'
    mount.write_text('/**: {ros__parameters: {mount_parent: wrist, mount_rpy: [0.1, 0.2, 0.3]}}')
    with Process(tmp_path, BRINGUP, '--params-file', write(), '--views', 'rest', '--without',
                 'dlv_node', *how, '--ros-args', '--params-file', mount, '-p', 'labels:=9'
                 ) as chain:
        user.wait(lambda: 'active: ' in chain.log or not chain.alive(), 'the chain')
        assert "mount_parent='wrist'" in chain.log
        assert "'labels' is none of pmcl_node, it is one of dlv_node: without" in chain.log
    assert "'mount_" not in chain.log


@pytest.mark.skipif(not hasattr(getattr(cv2, 'aruco', None), 'CharucoDetector'),
                    reason='OpenCV before 4.7')
def test_a_board_tells_where_the_camera_is(tmp_path, user, write):
    """Whatever the file says of an arm."""
    mount = tmp_path / 'mount.yaml'
    mount.write_text('/**: {ros__parameters: {mount_position: [0.1, 0.2, 0.3], poses: tf, '
                     'fixed_frame: table}}')
    with Process(tmp_path, BRINGUP, '--params-file', write(), '--views', 'rest', '--board',
                 '--without', 'dlv_node', '--ros-args', '--params-file', mount) as chain:
        user.wait(lambda: 'active: ' in chain.log or not chain.alive(), 'the chain')
        assert 'active: pmcl_node, sweep_driver, board_node' in chain.log
        assert 'poses topic: poses in board come from camera_pose' in chain.log
        assert 'its frame is board' in chain.log
        assert 'mount_position=(0.0, 0.0, 0.0)' in chain.log
        assert 'common=0.0' in chain.log  # errors of two pictures have no arm in common


def test_a_parameter_file_for_a_misspelt_node_is_refused(tmp_path):
    file = tmp_path / 'parameters.yaml'
    file.write_text('dlv_nod: {ros__parameters: {labels: 5}}')
    chain = Process(tmp_path, BRINGUP, '--params-file', file)
    ends(chain, 1)
    assert "there is no node 'dlv_nod'; did you mean 'dlv_node'?" in chain.log


@pytest.mark.parametrize(('arguments', 'reason'), [
    (['--params-file', '/nowhere.yaml'], 'there is no /nowhere.yaml'),
    (['--without', 'nobody'], 'invalid choice'),
    (['--board'], 'give --views too, of a moved camera'),
    (['--board', '--views', 'fixed'], 'give --views too, of a moved camera'),
])
def test_what_makes_no_sense_is_refused(tmp_path, arguments, reason):
    chain = Process(tmp_path, BRINGUP, *arguments)
    ends(chain, 2)
    assert reason in chain.log
