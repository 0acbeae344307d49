"""Values go by reference within a process, as messages elsewhere, and each comes once."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from threading import Timer

import numpy as np
import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from harness import PATIENCE, REPEAT, Process
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32MultiArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.light_field import light_field_to_messages
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.messages.volume import volume_from, volume_to_message
from pmcl_ros.nodes.runtime.base import BIG, SMALL, StageNode
from pmcl_ros.nodes.transport.intra_process_bus import IntraProcessBus
from pmcl_ros.nodes.transport.values import ValuePublisher, subscribe_value
from pmcl_ros.runtime.errors import PmclError
from pmcl_ros.runtime.settings import Settings


class Giver(StageNode):
    """Publishes volumes."""

    name, settings_class = 'giver', Settings

    def set_up(self, _):
        self.dlv = ValuePublisher(self, Float32MultiArray, 'dlv', BIG, volume_to_message,
                                  each_a_capture=True)

    def start(self):
        pass


class Taker(StageNode):
    """Keeps the volumes that come."""

    name, settings_class = 'taker', Settings

    def set_up(self, _):
        self.volumes = []

    def start(self):
        subscribe_value(self, Float32MultiArray, 'dlv', volume_from, self.keep, BIG)

    def keep(self, volume):
        self.volumes.append(volume)
        if volume.header.stamp_ns == 13:
            raise PmclError('unlucky')

    @property
    def stamps(self):
        return [each.header.stamp_ns for each in self.volumes]


@pytest.fixture
def start(user):
    """A function (class, options of the node) -> the node, active, spun while the user waits."""
    context, nodes = Context(), []
    rclpy.init(context=context)

    def start(node_class, **options):
        node = node_class(context=context, **options)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        user.others.append(executor)
        nodes.append((node, executor))
        node.trigger_configure()
        node.trigger_activate()
        return node

    yield start
    user.others.clear()
    for node, executor in nodes:
        executor.shutdown()
        node.close()
    rclpy.shutdown(context=context)


@pytest.fixture
def stamped(small_volume):
    """A function stamp -> a volume of that capture."""
    return lambda stamp: replace(small_volume, header=Header(stamp))


@pytest.fixture
def pair(start):
    """A giver and a taker that share what nodes of one process do."""
    bus = IntraProcessBus()
    return start(Giver, bus=bus), start(Taker, bus=bus)


def test_in_one_process_it_is_the_very_same_memory(user, pair, small_volume, capfd):
    giver, taker = pair
    assert giver.dlv.wanted()
    giver.dlv.publish(small_volume)
    user.wait(lambda: taker.volumes, 'the volume')
    volume, = taker.volumes
    assert volume is small_volume
    assert np.shares_memory(volume.likelihood, small_volume.likelihood)
    assert giver.health.counts == {'dlv handed over': 1}  # and no message
    assert 'dlv comes by reference' in capfd.readouterr().err


def test_elsewhere_an_equal_one_comes_as_a_message(user, start, small_volume, capfd):
    giver, taker = start(Giver), start(Taker)
    user.wait(giver.dlv.wanted, 'the taker')
    giver.dlv.publish(small_volume)
    user.wait(lambda: taker.volumes, 'the volume')
    volume, = taker.volumes
    assert (volume.header, volume.pinhole) == (small_volume.header, small_volume.pinhole)
    np.testing.assert_array_equal(volume.likelihood, small_volume.likelihood)
    np.testing.assert_array_equal(volume.depths, small_volume.depths)
    assert not np.shares_memory(volume.likelihood, small_volume.likelihood)
    assert volume.likelihood.flags.writeable == small_volume.likelihood.flags.writeable
    assert giver.health.counts == {'dlv sent': 1}
    assert 'dlv comes as messages' in capfd.readouterr().err


def test_the_newest_wins_and_nothing_comes_twice(user, pair, stamped):
    giver, taker = pair
    for stamp in (1, 2, 3):  # the taker does nothing meanwhile
        giver.dlv.publish(stamped(stamp))
    user.wait(lambda: taker.volumes, 'a volume')
    giver.dlv.publish(stamped(4))
    user.wait(lambda: 4 in taker.stamps, 'the last')
    assert taker.stamps == [3, 4]


def test_what_is_overwritten_before_it_is_taken_is_told(user, pair, start, stamped, capfd):
    giver, taker = pair
    for stamp in (1, 2, 3):
        giver.dlv.publish(stamped(stamp))
    user.wait(lambda: taker.volumes, 'a volume')
    assert taker.health.dropped == 2
    assert 'dropped 2 of dlv: newer came before they were taken' in capfd.readouterr().err
    giver, taker = start(Giver, namespace='/far'), start(Taker, namespace='/far')
    user.wait(giver.dlv.wanted, 'the taker')
    for stamps in ((1,), (2, 3, 4, 5), (6,)):
        for stamp in stamps:
            giver.dlv.publish(stamped(stamp))
            assert giver.dlv.arrived(Duration(seconds=PATIENCE))
        user.wait(lambda stamps=stamps: stamps[-1] in taker.stamps, 'the last')
    assert taker.stamps == [1, 5, 6]
    assert (giver.health.dropped, taker.health.dropped) == (0, 3)
    assert 'dropped 3 of dlv' in capfd.readouterr().err


LISTENER = """
import sys, rclpy
from std_msgs.msg import Float32MultiArray
from pmcl_ros.messages.volume import volume_from
rclpy.init()
node = rclpy.create_node('listener')
node.create_subscription(Float32MultiArray, 'dlv', lambda message: print(
    volume_from(message).header.stamp_ns, flush=True), 10)
rclpy.spin(node)
"""


def test_what_nobody_got_is_told_by_the_publisher(tmp_path, user, start, stamped, capfd):
    giver, heard = start(Giver), tmp_path / 'heard'

    def publish(*stamps):
        for stamp in stamps:
            giver.dlv.publish(stamped(stamp))
        user.wait(lambda: str(stamps[-1]) in heard.read_text().split(), 'the last to be heard')
        assert giver.dlv.arrived(Duration(seconds=PATIENCE))

    with heard.open('w') as file, subprocess.Popen([sys.executable, '-c', LISTENER], stdout=file
                                                   ) as listener:
        try:
            user.wait(giver.dlv.wanted, 'the listener')
            listener.send_signal(signal.SIGSTOP)
            os.waitpid(listener.pid, os.WUNTRACED)
            Timer(3, listener.send_signal, [signal.SIGCONT]).start()
            publish(1, 2, 3)  # it answers only after the last
            publish(4)
        finally:
            listener.kill()
    giver.dlv.publish(stamped(5))  # from here on it is those who listen that count
    assert giver.health.dropped == 2
    told = capfd.readouterr().err
    assert [f'dropped capture {stamp}: the subscriber of dlv' in told
            for stamp in (1, 2, 3, 4)] == [True, True, False, False]


def test_somebody_else_gets_messages_and_the_taker_each_volume_once(user, pair, stamped):
    giver, taker = pair
    messages = user.listen(Float32MultiArray, 'dlv', BIG)
    for stamp in (1, 2):
        giver.dlv.publish(stamped(stamp))
        user.wait(lambda stamp=stamp: len(messages) == stamp and stamp in taker.stamps, stamp)
    assert giver.health.counts == {'dlv handed over': 2, 'dlv sent': 2}
    np.testing.assert_array_equal(volume_from(messages[1]).likelihood,
                                  taker.volumes[1].likelihood)
    # What others publish, comes: also after all that the giver has sent.
    publisher = user.node.create_publisher(Float32MultiArray, 'dlv', BIG)
    user.wait(lambda: publisher.get_subscription_count() == 2, 'the subscribers')
    user.wait(lambda: taker.count_publishers('dlv') == 2, 'the publisher to be found')
    for stamp in (8, 9):
        user.wait(lambda stamp=stamp: publisher.publish(volume_to_message(stamped(stamp)))
                  or stamp in taker.stamps, 'what another publishes')
    assert list(dict.fromkeys(taker.stamps)) == [1, 2, 8, 9]
    assert taker.stamps[:3] == [1, 2, 8]


def test_names_count_as_for_messages(user, start, stamped):
    bus = IntraProcessBus()
    giver = start(Giver, bus=bus, namespace='/left')
    right = start(Taker, bus=bus, namespace='/right')
    remapped = start(Taker, bus=bus, namespace='/left',
                     cli_args=['--ros-args', '-r', 'dlv:=other'])
    giver.dlv.publish(stamped(1))
    assert not giver.dlv.wanted()
    assert giver.health.counts == {}
    left = start(Taker, bus=bus, namespace='/elsewhere',
                 cli_args=['--ros-args', '-r', 'dlv:=/left/dlv'])
    giver.dlv.publish(stamped(2))
    user.wait(lambda: left.volumes, 'the volume')
    assert (left.stamps, right.stamps, remapped.stamps) == ([2], [], [])


def test_two_graphs_do_not_mix(user, start, stamped):
    one, two = IntraProcessBus(), IntraProcessBus()
    graphs = [(start(Giver, bus=each, namespace=name),
               start(Taker, bus=each, namespace=name))
              for each, name in ((one, '/a'), (two, '/b'))]
    for number, (giver, _) in enumerate(graphs):
        giver.dlv.publish(stamped(number))
    user.wait(lambda: all(taker.volumes for _, taker in graphs), 'the volumes')
    assert [taker.stamps for _, taker in graphs] == [[0], [1]]


def test_who_is_inactive_takes_nothing(user, pair, stamped):
    giver, taker = pair
    giver.dlv.publish(stamped(1))
    taker.trigger_deactivate()  # before it has taken that
    assert not giver.dlv.wanted()
    giver.dlv.publish(stamped(2))
    taker.trigger_activate()
    giver.dlv.publish(stamped(3))
    user.wait(lambda: taker.volumes, 'a volume')
    assert taker.stamps == [3]
    taker.trigger_shutdown()
    giver.dlv.publish(stamped(4))
    assert giver.health.counts == {'dlv handed over': 2}


def test_an_error_of_the_taker_is_its_own(user, pair, stamped, capfd):
    giver, taker = pair
    giver.dlv.publish(stamped(13))
    user.wait(lambda: taker.health.errors, 'the error')
    giver.dlv.publish(stamped(14))
    user.wait(lambda: 14 in taker.stamps, 'the next')
    assert (giver.health.errors, taker.health.last_error) == (0, 'dlv: unlucky')


def values(states, node):
    """The newest values that a node has told of itself."""
    return next(({each.key: each.value for each in message.status[0].values}
                 for message in reversed(states) if message.status[0].name == node), {})


@pytest.fixture
def chain(tmp_path, user, parameters, small_light_field):
    """A function arguments -> (process of dlv_node and pmcl_node, a function that publishes)."""
    names = {'dlv_node': parameters['dlv_node'] | {'views': 3},
             'pmcl_node': parameters['pmcl_node'] | {
                 'mode': 'faithful', 'faithful_iterations': 1, 'faithful_particles': 4}}
    file = tmp_path / 'parameters.yaml'
    file.write_text(yaml.safe_dump({name: {'ros__parameters': each}
                                    for name, each in names.items()}))

    def chain(*arguments):
        process = Process(tmp_path, 'pmcl_ros.nodes.bringup', '--params-file', file, '--without',
                          'lytro_driver', '--without', 'subaperture_node', *arguments)
        user.wait(lambda: 'active: pmcl_node' in process.log or not process.alive(), 'the chain')
        publishers = [user.publisher(CameraInfo, 'views/camera_info', SMALL),
                      user.publisher(Image, 'views/pupil', SMALL),
                      user.publisher(Image, 'views', BIG)]

        def publish(stamp):
            light_field = replace(small_light_field, header=Header(stamp))
            messages = light_field_to_messages(light_field)
            for publisher, message in zip(publishers, messages, strict=True):
                publisher.publish(message)
        return process, publish
    return chain


def test_both_ways_lead_to_the_same_pose(user, chain):
    poses, told = [], []
    for arguments in ([], ['--processes']):
        process, publish = chain(*arguments)
        with process:
            came = user.listen(PoseStamped, 'pose', SMALL)
            while not came:  # dlv_node may not have found pmcl_node yet
                publish(7)
                again = time.monotonic() + REPEAT
                user.wait(lambda: came or time.monotonic() > again, 'a pose')  # noqa: B023
            told.append([way for way in ('dlv comes by reference', 'dlv comes as messages')
                         if way in process.log])
            poses.append(pose_from(came[0]))
        user.wait(lambda: not user.node.count_publishers('pose'), 'the nodes to go')
    assert told == [['dlv comes by reference'], ['dlv comes as messages']]
    (header, pose), (other_header, other) = poses
    assert header == other_header == Header(7)
    np.testing.assert_array_equal(pose, other)


def test_in_one_process_volumes_are_sent_only_to_others(user, chain):
    process, publish = chain()
    with process:
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)

        def counts():
            told = values(states, 'dlv_node')
            return {key: told[key] for key in told if key.startswith('dlv')}

        publish(1)
        user.wait(lambda: values(states, 'pmcl_node').get('frames out') == '1', 'the pose')
        user.wait(lambda: values(states, 'dlv_node').get('frames out') == '1', 'diagnostics')
        assert counts() == {'dlv handed over': '1'}
        messages = user.listen(Float32MultiArray, 'dlv', BIG)
        publish(2)
        user.wait(lambda: messages and values(states, 'pmcl_node').get('frames out') == '2',
                  'the pose and the message')
        user.wait(lambda: values(states, 'dlv_node').get('frames out') == '2', 'diagnostics')
        assert counts() == {'dlv handed over': '2', 'dlv sent': '1'}
        assert volume_from(messages[0]).header.stamp_ns == 2
        assert values(states, 'pmcl_node')['frames in'] == '2'
        assert 'dlv comes as messages' not in process.log


def test_a_volume_stays_as_it_is_while_the_next_are_made(small_light_field):
    from pmcl_ros.dlv.build import build_volume
    from pmcl_ros.dlv.settings import DlvSettings
    from pmcl_ros.evidence.edges import build_edges
    settings = DlvSettings(labels=16, edge_labels=8, views=3)
    held = build_volume(small_light_field, settings)
    edges = build_edges(small_light_field, settings)
    before = held.likelihood.copy(), edges.tensor.copy()
    darker = replace(small_light_field, views=small_light_field.views[::-1] / 2)
    for _ in range(3):
        other = build_volume(darker, settings)
        assert not np.shares_memory(other.likelihood, held.likelihood)
        assert not np.shares_memory(build_edges(darker, settings).tensor, edges.tensor)
    np.testing.assert_array_equal(held.likelihood, before[0])
    np.testing.assert_array_equal(edges.tensor, before[1])
