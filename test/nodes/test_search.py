"""pmcl_node answers while it searches, and ends a search when it is told to."""

import re
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from harness import (
    ACTIVATE,
    CLEANUP,
    CONFIGURE,
    DEACTIVATE,
    INACTIVE,
    UNCONFIGURED,
    Process,
)
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Float32MultiArray
from std_srvs.srv import Trigger

from pmcl_ros.evidence.edges import edges_from_likelihood
from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.volume import edges_to_message, volume_to_message
from pmcl_ros.nodes.runtime.base import BIG, SMALL
from pmcl_ros.pmcl.prior.region import with_region
from pmcl_ros.pmcl.settings import PmclSettings

LONG = {'mode': 'faithful', 'faithful_iterations': 100_000, 'faithful_particles': 2,
        'faithful_threshold': 10.0}
SHORT = {'mode': 'faithful', 'faithful_iterations': 1, 'faithful_particles': 2}


@pytest.fixture
def search(tmp_path, user, parameters, small_volume):
    """A function settings -> (active node, a function that publishes a volume with a stamp)."""
    processes = []

    def search(settings):
        process = Process(tmp_path, 'pmcl_ros.nodes.pmcl_node',
                          params=parameters['pmcl_node'] | settings)
        processes.append(process)
        assert all(user.change('pmcl_node', CONFIGURE, ACTIVATE)), process.log
        publisher = user.publisher(Float32MultiArray, 'dlv', BIG)

        def publish(stamp):
            volume = replace(small_volume, header=Header(stamp))
            publisher.publish(volume_to_message(volume))
        return process, publish

    yield search
    for process in processes:
        with process:
            pass


def value(states, key):
    return states and {each.key: each.value for each in states[-1].status[0].values}.get(key)


def frames_in(states):
    return value(states, 'frames in')


def test_lifecycle_is_answered_during_a_search_and_deactivate_ends_it(search, user):
    process, publish = search(LONG)
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    poses = user.listen(PoseStamped, 'pose', SMALL)
    publish(1)
    user.wait(lambda: frames_in(states) == '1', 'a search')
    assert user.change('pmcl_node', DEACTIVATE)
    assert user.state('pmcl_node') == INACTIVE
    assert user.change('pmcl_node', CLEANUP)
    assert user.state('pmcl_node') == UNCONFIGURED
    assert all(user.change('pmcl_node', CONFIGURE, ACTIVATE))
    assert poses == []
    assert 'Traceback' not in process.log


def test_a_search_is_ended_by_an_interrupt(search, user):
    process, publish = search(LONG)
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    publish(1)
    user.wait(lambda: frames_in(states) == '1', 'a search')
    with process:
        pass  # interrupted, and its status is checked
    assert 'Traceback' not in process.log


def test_the_newest_waiting_volume_is_searched_and_the_other_is_told(search, user):
    process, publish = search(LONG)
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    for stamp in (1, 2, 3):
        publish(stamp)
        user.wait(lambda stamp=stamp: frames_in(states) == str(stamp), 'the volume')
    # On a busy machine the first is not taken up before the second comes, and is dropped too.
    told = re.findall(r'dropped capture (\d): a newer one came before it was searched',
                      process.log)
    assert told in (['2'], ['1'], ['1', '2'])
    assert process.log.count('dropped') == len(told)
    assert user.change('pmcl_node', DEACTIVATE)


def test_localize_searches_again_and_reset_forgets(search, user):
    process, publish = search(SHORT)

    def call(name):
        return user.call(Trigger, f'/pmcl_node/{name}', Trigger.Request())

    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)

    def results():
        told = [each.status[0].message for each in states]
        return sum('in capture 5' in one and one != before
                   for before, one in zip(['', *told], told, strict=False))

    answer = call('localize')
    assert not answer.success
    assert 'no evidence has come' in answer.message
    publish(5)
    user.wait(lambda: results() >= 1, 'a result')
    answer = call('localize')
    assert answer.success, answer.message
    assert 'capture 5 again' in answer.message
    user.wait(lambda: states and {each.key: each.value for each in states[-1].status[0].values}[
        'frames in'] == '1', 'diagnostics')
    answer = call('reset')
    assert answer.success
    assert not call('localize').success
    assert 'Traceback' not in process.log


def test_a_lost_object_is_told_and_no_pose_is_published(search, user, small_volume):
    process, publish = search({'particles': 16, 'proposals': 4})
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    poses = user.listen(PoseStamped, 'pose', SMALL)
    publish(8)  # noise

    def told():
        return [each.status[0].level for each in states
                if each.status[0].message == 'lost: no wine_glass in capture 8']

    user.wait(told, 'the result')
    assert told()[0] == DiagnosticStatus.WARN
    values = {each.key: each.value for each in states[-1].status[0].values}
    first, second = float(values['weight']), float(values['weight of the runner-up'])
    assert 0 <= second <= first <= first + second <= 1 + 1e-9
    read = edges_from_likelihood(small_volume)
    assert (float(values['support']) < read.least_support
            or float(values['evidence']) < read.profile.least)
    user.wait(lambda: 'lost: no wine_glass in capture 8' in process.log, 'the log')
    # Another loss of the same capture has the same words and another number.
    assert (value(states, 'capture'), value(states, 'search')) == ('8', '1')
    assert user.call(Trigger, '/pmcl_node/localize', Trigger.Request()).success
    user.wait(lambda: value(states, 'search') == '2', 'the second search')
    assert value(states, 'capture') == '8'
    assert told() == [DiagnosticStatus.WARN] * len(told())
    assert user.change('pmcl_node', DEACTIVATE)
    assert poses == []


def test_edges_that_do_not_come_are_not_waited_for_forever(search, user):
    process, publish = search({'particles': 16, 'proposals': 4})
    publish(8)
    user.publisher(Float32MultiArray, 'dlv/edges', BIG)  # the node knows: it waits longer
    user.wait(lambda: 'its dlv/edges does not come' in process.log, 'the search')
    assert user.change('pmcl_node', DEACTIVATE)


def test_dlv_is_listened_to_only_while_nobody_publishes_edges(search, user, small_edges):
    process, publish = search({'particles': 16, 'proposals': 4})  # the node listens to dlv

    def listeners():
        return user.node.count_subscribers('dlv')

    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    publisher = user.publisher(Float32MultiArray, 'dlv/edges', BIG)
    user.wait(lambda: not listeners(), 'the end of the subscription')
    publisher.publish(edges_to_message(replace(small_edges, header=Header(4))))
    user.wait(lambda: states and 'capture 4' in states[-1].status[0].message, 'the result')
    assert 'from dlv alone' not in process.log
    user.node.destroy_publisher(publisher)
    user.wait(listeners, 'the subscription')
    publish(5)
    user.wait(lambda: 'capture 5' in states[-1].status[0].message, 'the result')
    assert 'localizes from dlv alone: nobody publishes dlv/edges' in process.log
    assert frames_in(states) == '2'
    assert 'dropped' not in process.log
    assert user.change('pmcl_node', DEACTIVATE)


def test_edges_are_searched_and_broken_ones_refused(search, user, small_edges):
    process, _ = search({'particles': 16, 'proposals': 4})
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    publisher = user.publisher(Float32MultiArray, 'dlv/edges', BIG)
    broken = edges_to_message(small_edges)
    broken.data[-1] = float('nan')
    publisher.publish(broken)
    user.wait(lambda: 'dlv/edges: edge volume holds NaN' in process.log, 'the error')
    publisher.publish(edges_to_message(replace(small_edges, header=Header(3))))
    user.wait(lambda: states and 'capture 3' in states[-1].status[0].message, 'the result')
    assert 'from dlv alone' not in process.log
    assert user.change('pmcl_node', DEACTIVATE)


def test_a_capture_without_evidence_is_counted_when_the_next_comes(search, user, small_edges):
    process, _ = search({'particles': 16, 'proposals': 4})
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    edges = user.publisher(Float32MultiArray, 'dlv/edges', BIG)
    cameras = user.publisher(CameraInfo, 'center/camera_info', SMALL)
    for stamp in (6, 7):
        cameras.publish(pinhole_to_message(Header(stamp), small_edges.pinhole))
    user.delivered(cameras)
    later = len(states) + 3
    user.wait(lambda: len(states) >= later, 'the node to take both')
    edges.publish(edges_to_message(replace(small_edges, header=Header(7))))
    user.wait(lambda: value(states, 'captures without evidence') == '1', 'the count')
    assert 'no evidence came of capture 6:' in process.log
    assert user.change('pmcl_node', DEACTIVATE)


def test_the_region_follows_from_the_camera_of_the_first_capture(search, user, small_volume):
    process, publish = search(SHORT | {'roi_depths': [0.4, 0.7]})
    poses = user.listen(PoseStamped, 'pose', SMALL)
    publish(4)
    user.wait(lambda: poses, 'a pose')
    expected = with_region(PmclSettings(roi_depths=(0.4, 0.7)),
                           [(small_volume.pinhole, np.eye(4))], 0.1)
    center, size = (np.array(each) for each in (expected.roi_center, expected.roi_size))
    assert f'roi_center {expected.roi_center}, roi_size {expected.roi_size}' in process.log
    place = poses[0].pose.position
    assert (np.abs([place.x, place.y, place.z] - center) <= size / 2 + 1e-6).all()
    publish(5)
    user.wait(lambda: len(poses) == 2, 'another pose')
    assert process.log.count('region of interest') == 1
    assert 'Traceback' not in process.log
