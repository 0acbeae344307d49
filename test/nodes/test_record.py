"""What the recorder keeps of the nodes' topics is what came, and the next node takes it again."""

import os
import re
import signal
from array import array
from importlib.util import find_spec
from itertools import count

import numpy as np
import pytest
import yaml
from generated_interfaces import importable
from geometry_msgs.msg import PoseStamped, TransformStamped
from harness import PATIENCE, ROOT, Process
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image
from std_msgs.msg import Float32MultiArray, String
from std_srvs.srv import Trigger

from pmcl_ros.messages import bags
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.nodes.graph import PRESETS
from pmcl_ros.nodes.runtime.base import BIG, LATCHED, SMALL

RECORD, REPLAY, BRINGUP = (f'pmcl_ros.nodes.{each}' for each in ('record', 'replay', 'bringup'))
WINE_GLASS = ROOT / 'bags' / 'wine_glass'
COARSE = {'labels': 40, 'edge_labels': 12, 'stride': 2}


def recording(tmp_path, bag, *arguments, **options):
    return Process(tmp_path, RECORD, '-o', bag, *arguments, **options)


def megabytes(recorder):
    return float(re.findall(r', ([\d.]+) MB', f', 0 MB\n{recorder.log}')[-1])


def ended(process, status=0):
    process.popen.send_signal(signal.SIGINT)
    assert process.popen.wait(PATIENCE) == status, process.log


def test_bags_recorded_at_one_stage_replay_into_the_next(tmp_path, user, bag_parameters):
    """The pose is the same to the bit, whichever stage's messages it is made from."""
    file, bag = tmp_path / 'parameters.yaml', tmp_path / 'all'
    values = bag_parameters | {'dlv_node': COARSE, 'pmcl_node': bag_parameters['pmcl_node'] | {
        'roi_size': [0.06, 0.06, 0.06], 'particles': 64}}  # soon found
    file.write_text(yaml.safe_dump(
        {node: {'ros__parameters': each} for node, each in values.items()}))
    nodes = BRINGUP, '--params-file', file, '--without', 'lytro_driver'
    with (recording(tmp_path, bag, '--preset', 'all') as recorder,
          Process(tmp_path, *nodes) as chain):
        user.wait(lambda: ('active: ' in chain.log and 'listening to ' in recorder.log)
                  or not (chain.alive() and recorder.alive()), 'the nodes, and the recorder')
        poses = user.listen(PoseStamped, 'pose', SMALL)
        # The map may come after the pose, which edges gave.
        maps = user.listen(Float32MultiArray, 'dlv/contour_map', BIG)
        # the node and the recorder
        with Process(tmp_path, REPLAY, WINE_GLASS, '--subscribers', 2):
            user.wait(lambda: poses and maps, 'a pose and a map')
        # Both may be here before the recorder has them and all that they were made from: 52 MB of
        # views, and the map beside 86 MB in all.
        size = 4e-6 * len(maps[0].data)
        assert size > 1.1
        user.wait(lambda: megabytes(recorder) > 85 + size, 'all of it to be recorded')
        ended(recorder)
        for number, stage in enumerate(('raw', 'views', 'dlv'), 2):
            user.call(Trigger, '/pmcl_node/reset', Trigger.Request())  # its random numbers too
            with Process(tmp_path, REPLAY, bag, '--preset', stage):
                user.wait(lambda count=number: len(poses) == count, f'a pose from {stage}')
        stamp = pose_from(poses[0])[0].stamp_ns
        line = f'[pmcl_node]: found wine_glass in capture {stamp}, in '
        # The last pose may be here before its line is.
        user.wait(lambda: chain.log.count(line) == 4, 'a line for each pose')
        log = chain.log
    # a line for each capture, of each node that had work with it
    assert log.count(f'[subaperture_node]: published capture {stamp}, in ') == 2
    assert log.count(f'[dlv_node]: published capture {stamp}, in ') == 3
    assert log.count(line) == 4
    recorded = {each.topic: each for each in bags.read(bag)}
    for each in bags.read(WINE_GLASS):
        found = recorded[each.topic]
        assert (found.type, found.qos) == (each.type, each.qos)
        assert found.cdr.startswith(each.cdr)
        assert len(found.cdr) - len(each.cdr) < 4  # DDS fills up to words
    told = {f'/{topic}' for topic in (*PRESETS['views'], *PRESETS['dlv'])}
    assert told - {'/camera_pose'} <= {*recorded}  # which no arm tells here
    first, *others = map(pose_from, poses)
    for header, pose in others:
        assert header == first[0]
        np.testing.assert_array_equal(pose, first[1])


def test_a_signal_leaves_a_bag_of_all_that_came(tmp_path, user):
    """In the middle of a stream, whatever chunk it hits. runtime/test_running.py has others."""
    def image(second):
        message = Image(height=600, width=500, step=1000, encoding='bayer_bggr16',
                        data=array('B', bytes(600_000)))
        message.header.stamp.sec = second
        return message

    metadata = user.node.create_publisher(String, 'metadata', LATCHED)
    metadata.publish(String(data='{}'))
    images = user.node.create_publisher(Image, 'image_raw', BIG)
    seconds = count()
    with recording(tmp_path, tmp_path / 'bag', '--preset', 'raw') as recorder:
        # A latched message comes whenever its publisher has been discovered.
        user.wait(lambda: 'recorded 1 messages' in recorder.log, 'the metadata')

        def written():
            images.publish(image(next(seconds)))
            told = re.findall(r'recorded (\d+) messages', recorder.log)
            return told and int(told[-1]) >= 5

        user.wait(written, 'messages')
        recorder.popen.send_signal(signal.SIGTERM)
        user.wait(lambda: written() and not recorder.alive(), 'the end')
    text, *found = sorted(bags.read(tmp_path / 'bag'), key=lambda each: each.topic, reverse=True)
    assert (text.topic, text.qos) == ('/metadata', bags.LATCHED)
    assert deserialize_message(text.cdr, String).data == '{}'
    came = [deserialize_message(each.cdr, Image) for each in found]
    stamps = [each.header.stamp.sec for each in came]
    assert stamps == sorted(set(stamps))
    assert all(each == image(stamp) for each, stamp in zip(came, stamps, strict=True))
    assert f'recorded {1 + len(found)} messages' in recorder.log
    assert {each.name: each.messages for each in bags.topics(tmp_path / 'bag')} == {
        '/metadata': 1, '/image_raw': len(found)}


def test_a_camera_that_offers_no_more_is_recorded_at_best_effort(tmp_path, user):
    images = user.node.create_publisher(Image, 'image', qos_profile_sensor_data)
    with recording(tmp_path, tmp_path / 'bag', '--topic', 'image') as recorder:

        def written():
            images.publish(Image(height=1, width=1, step=1, encoding='mono8'))
            return 'recorded ' in recorder.log

        user.wait(written, 'a message')
        ended(recorder)
    assert recorder.log.count('a publisher of image is not reliable') == 1
    assert {each.topic for each in bags.read(tmp_path / 'bag')} == {'/image'}


def test_transforms_are_recorded_those_that_stay_of_everybody(tmp_path, user, monkeypatch):
    """Each robot publishes its own /tf_static once, before the recording begins."""
    made = tmp_path / 'tf2_msgs'
    monkeypatch.setenv('PYTHONPATH', f'{made}{os.pathsep}{os.environ.get("PYTHONPATH", "")}')
    with importable(made, 'tf2_msgs',
                    {'msg/TFMessage.msg': 'geometry_msgs/TransformStamped[] transforms\n'}):
        from tf2_msgs.msg import TFMessage

        def message(child):
            return TFMessage(transforms=[TransformStamped(child_frame_id=child)])

        moving = user.node.create_publisher(TFMessage, '/tf', SMALL)
        still = [user.node.create_publisher(TFMessage, '/tf_static', LATCHED) for _ in range(2)]
        for publisher, child in zip(still, ('arm', 'camera'), strict=True):
            publisher.publish(message(child))
        # checked: the fork server does not import what was made meanwhile
        with recording(tmp_path, tmp_path / 'bag', '--topic', '/tf', '--topic', '/tf_static',
                       checked=False) as recorder:
            everybody = (*still, moving)
            user.wait(lambda: not recorder.alive() or all(
                each.get_subscription_count() for each in everybody), 'the recorder')
            moving.publish(message('wrist'))
            for each in everybody:
                user.delivered(each)
            ended(recorder)
    found = [(each.topic, each.qos.durability,
              bags.message_of(each, 'tf2_msgs/msg/TFMessage').transforms[0].child_frame_id)
             for each in bags.read(tmp_path / 'bag')]
    assert sorted(found) == [('/tf', bags.VOLATILE.durability, 'wrist'),
                             ('/tf_static', bags.LATCHED.durability, 'arm'),
                             ('/tf_static', bags.LATCHED.durability, 'camera')]


@pytest.mark.skipif(find_spec('tf2_msgs') is not None, reason='tf2_msgs is installed')
def test_transforms_without_their_package_are_refused_in_one_line(tmp_path):
    recorder = recording(tmp_path, tmp_path / 'bag', '--topic', '/tf')
    assert recorder.popen.wait(PATIENCE) == 1
    assert 'tf2_msgs/msg/TFMessage is not installed: install ros-jazzy-tf2-msgs' in recorder.log
    assert 'Traceback' not in recorder.log
    assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize(('arguments', 'status', 'reason'), [
    (['-o', 'NEW', '--preset', 'raw', '--duration', 0.3], 1,
     'nothing came on /metadata, /image_raw: are the nodes active'),
    (['-o', 'NEW', '--topic', 'image', '--duration', 0.3, '--ros-args', '-r', '__ns:=/left', '-r',
      'image:=/wrist/image_raw'], 1, 'nothing came on /wrist/image_raw: are the nodes active'),
    (['-o', 'OLD', '--preset', 'raw'], 1, 'is already there; remove it'),
    (['-o', 'NEW'], 2, 'one of the arguments --preset --topic is required'),
    (['-o', 'NEW', '--preset', 'raw', '--duration', 'nan'], 2, '--duration must be positive'),
])
def test_what_cannot_be_recorded_is_told(tmp_path, arguments, status, reason):
    (tmp_path / 'old').mkdir()
    places = {'NEW': tmp_path / 'new', 'OLD': tmp_path / 'old'}
    recorder = Process(tmp_path, RECORD, *(places.get(each, each) for each in arguments))
    assert recorder.popen.wait(PATIENCE) == status
    assert reason in recorder.log
    assert not (tmp_path / 'new').exists()
