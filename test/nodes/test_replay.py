"""The player publishes what was recorded, byte for byte, when somebody listens."""

import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from harness import PATIENCE, ROOT, Process, own_lines
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages import bags
from pmcl_ros.messages.bag_captures import light_field_messages
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.types import message_class
from pmcl_ros.messages.volume import edges_to_message, volume_to_message
from pmcl_ros.nodes.runtime.base import BIG, LATCHED

REPLAY = 'pmcl_ros.nodes.replay'
ALL = QoSProfile(depth=100)  # of a subscriber that misses nothing, however late it takes it


def write(bag, *messages, depth=1):
    """A bag of (topic, seconds, text); /a is latched."""
    bags.record(bag, [bags.Recorded(
        topic, 'std_msgs/msg/String', int(seconds * 1e9), serialize_message(String(data=text)),
        bags.LATCHED if topic == '/a' else bags.VOLATILE._replace(depth=depth))
        for topic, seconds, text in messages])
    return bag


@pytest.fixture
def bag(tmp_path):
    """Three messages in half a second, of lengths that the transport need not pad."""
    return write(tmp_path / 'bag', ('/a', 0, 'one'), ('/b', 0.1, 'two'), ('/b', 0.5, 'six'))


def listen(user, topic, qos):
    """As a node does that was there before the player; (time of publication [s], the bytes)."""
    messages = []

    def received(cdr, info):
        messages.append((info['source_timestamp'] * 1e-9, cdr))

    user.node.create_subscription(String, topic, received, qos, raw=True)
    return messages


@pytest.mark.parametrize(('rate', 'recorded'), [(0.5, 0.5), (1, 1), (100, 100)])
def test_messages_come_in_order_and_at_the_rate(tmp_path, user, rate, recorded):
    """From first to last it takes a second, by the player's clock: when they are taken here is
    no matter of the player's. `longest` would be exceeded if the rate of 100 were not heeded."""
    shortest, longest = 0.99, 60
    bag = write(tmp_path / 'bag', ('/a', 0, 'one'), ('/b', recorded / 2, 'two'),
                ('/b', recorded, 'six'))
    first, second = listen(user, 'a', LATCHED), listen(user, 'b', ALL)
    with Process(tmp_path, REPLAY, bag, '--rate', rate):
        user.wait(lambda: first and len(second) == 2, 'the messages')
    expected = [each.cdr for each in bags.read(bag)]
    assert [cdr for _, cdr in (*first, *second)] == expected
    assert shortest / 2 < second[0][0] - first[0][0]
    assert shortest < second[1][0] - first[0][0] < longest


@pytest.mark.parametrize('depth', [1, 5])
@pytest.mark.parametrize('size', [3, 1_000_003], ids=['small', 'of many packets'])
def test_nothing_is_overwritten_before_it_has_arrived(tmp_path, user, depth, size):
    """Not even what is published before the subscriber knows of the player."""
    texts = [f'{number:0{size}}' for number in range(33)]  # as long as one that is not padded
    bag = write(tmp_path / 'bag', *(('/b', 0, text) for text in texts), depth=depth)
    messages = listen(user, 'b', ALL)
    with Process(tmp_path, REPLAY, bag) as player:
        user.wait(lambda: not player.alive(), 'the end')
        user.wait(lambda: len(messages) == 33, 'the rest')
    same = [found == each.cdr for (_, found), each in zip(messages, bags.read(bag), strict=True)]
    assert all(same)


def test_who_keeps_one_and_takes_it_late_has_the_newest(tmp_path, user, bag):
    """As every node of the chain does: the player does not wait for what is not taken."""
    messages = listen(user, 'b', BIG)
    with Process(tmp_path, REPLAY, bag, '--topic', '/b') as player:
        assert player.popen.wait(PATIENCE) == 0, player.log
    user.wait(lambda: messages, 'the newest')
    *_, newest = bags.read(bag)
    assert [cdr for _, cdr in messages] == [newest.cdr]


def test_a_topic_can_be_chosen(tmp_path, user, bag):
    messages = listen(user, 'b', ALL)
    with Process(tmp_path, REPLAY, bag, '--topic', '/b') as player:
        user.wait(lambda: len(messages) == 2, 'the messages')
        user.wait(lambda: not player.alive(), 'the end')
    assert '/a' not in player.log


def memory(process):
    """What a process has in memory of its own [bytes]."""
    status = Path(f'/proc/{process.popen.pid}/status').read_text()
    return 1024 * int(re.search(r'RssAnon:\s+(\d+) kB', status)[1])


def test_a_bag_is_played_again_and_again_in_the_same_memory(tmp_path, user):
    size, count, rounds = 2_000_000, 20, 4
    bag = write(tmp_path / 'bag', *(('/b', 0.01 * each, f'{each:0{size}}')
                                    for each in range(count)))
    messages = []
    user.node.create_subscription(String, 'b', lambda cdr: messages.append(len(cdr)), ALL,
                                  raw=True)
    with Process(tmp_path, REPLAY, bag, '--loop') as player:
        user.wait(lambda: len(messages) >= count, 'the first round')
        before = memory(player)
        user.wait(lambda: len(messages) >= rounds * count, 'more')
        assert memory(player) - before < count * size / 2
        player.popen.send_signal(signal.SIGINT)
        assert player.popen.wait(PATIENCE) == 0
    assert 'played 20 of 20 messages, 0.2 s into the bag' in player.log
    # progress is told now and then, whatever there is to play
    assert len(player.log.splitlines()) < len(messages)


def test_a_stage_of_a_bag_can_be_chosen_in_any_namespace(tmp_path, user):
    bag = write(tmp_path / 'bag', ('/left/dlv', 0, 'one'), ('/left/pose', 0, 'two'),
                ('/left/other', 0, 'three'))
    messages = listen(user, '/left/dlv', ALL)
    with Process(tmp_path, REPLAY, bag, '--preset', 'dlv') as player:
        user.wait(lambda: messages, 'the messages')
        user.wait(lambda: not player.alive(), 'the end')
    assert 'played 1 of 1 messages' in player.log


STAMPS = [1_700_000_000_000_000_001 + 10 ** 7 * number for number in range(3)]


def captures(stage, light_field, volume, edges):
    """Three captures, 10 ms apart, as `views` (some before what belongs to them), or as `dlv`."""
    for stamp in STAMPS:
        header = Header(stamp)
        if stage == 'views':
            *others, views = light_field_messages(replace(light_field, header=header))
            yield from (others[0], views, *others[1:])
        else:
            for topic, message in (
                    ('/dlv', volume_to_message(replace(volume, header=header))),
                    ('/dlv/edges', edges_to_message(replace(edges, header=header)))):
                yield bags.Recorded(topic, 'std_msgs/msg/Float32MultiArray', stamp,
                                    serialize_message(message))


@pytest.mark.parametrize(('stage', 'topics'), [
    ('views', ('views/camera_info', 'views/pupil', 'center/camera_info', 'center/image')),
    ('dlv', ('dlv/edges',))])
def test_in_step_a_capture_is_held_back_until_the_one_before_is_answered(
        tmp_path, user, small_light_field, small_volume, small_edges, stage, topics):
    bag = tmp_path / 'bag'
    bags.record(bag, captures(stage, small_light_field, small_volume, small_edges))
    types = {each.name: message_class(each.type) for each in bags.topics(bag)}
    came = {topic: [] for topic in (stage, *topics)}
    for topic, messages in came.items():
        user.node.create_subscription(types[f'/{topic}'], topic, messages.append, ALL)
    answers = user.node.create_publisher(MarkerArray, 'objects', LATCHED)

    def answer(stamp):
        header = header_to_message(Header(stamp))
        answers.publish(MarkerArray(markers=[Marker(header=header, text='lost')]))

    def look(seconds=0.3):
        until = time.monotonic() + seconds
        user.wait(lambda: time.monotonic() > until, 'some time to pass')
        return {len(messages) for messages in came.values()}

    answer(STAMPS[0])  # of a replay before
    with Process(tmp_path, REPLAY, bag, '--in-step', '--rate', 1000) as player:
        for number, stamp in enumerate(STAMPS, 1):
            user.wait(lambda number=number: all(len(each) == number for each in came.values()),
                      f'all of capture {number}')
            answer(STAMPS[number - 2])  # of another
            assert look() == {number}
            assert player.alive()
            answer(stamp)
        user.wait(lambda: not player.alive(), 'the end')
    assert all(len(messages) == 3 for messages in came.values())


def test_in_step_needs_captures_and_somebody_who_answers(tmp_path, user, bag, small_light_field):
    with Process(tmp_path, REPLAY, bag, '--in-step', status=1) as player:
        user.wait(lambda: not player.alive(), 'the end')
    assert ('in step needs captures, on one of the topics image_raw, views, posed_views, dlv'
            in player.log)
    bags.record(tmp_path / 'views', light_field_messages(small_light_field))
    arguments = (tmp_path / 'views', '--topic', '/views', '--in-step', '--timeout')
    with Process(tmp_path, REPLAY, *arguments, 0.5, '--subscribers', 0, status=1) as player:
        user.wait(lambda: not player.alive(), 'the end')
    assert 'nobody publishes /objects after 0.5 s' in player.log
    user.node.create_subscription(Image, 'views', lambda _: None, ALL)
    user.node.create_publisher(MarkerArray, 'objects', LATCHED)
    with Process(tmp_path, REPLAY, *arguments, PATIENCE, '--patience', 1, status=1) as player:
        user.wait(lambda: not player.alive(), 'the end')
    stamp = small_light_field.header.stamp_ns
    assert f'nothing came on /objects of capture {stamp} within 1 s' in player.log


@pytest.mark.parametrize(('arguments', 'status', 'reason'), [
    (['BAG', '--timeout', 0.2], 1, 'fewer than 1 subscribers to /a, /b after 0.2 s'),
    (['BAG', '--preset', 'dlv'], 1, 'nothing to play in .*: it holds /a, /b'),
    (['BAG', '--topic', '/a', '--topic', '/c', '--topic', 'b'], 1,
     'has no topic /c, b: it holds /a, /b$'),
    (['BAG', '--rate', 0], 2, '--rate must be positive'),
    (['BAG', '--rate', 'nan'], 2, '--rate must be positive, not nan'),
    ([ROOT, '--rate', 1], 1, 'cannot read the bag'),
    (['nowhere'], 1, 'cannot read the bag nowhere: it is not there; check the path'),
])
def test_what_cannot_be_played_is_told(tmp_path, bag, arguments, status, reason):
    player = Process(tmp_path, REPLAY, *(bag if each == 'BAG' else each for each in arguments))
    assert player.popen.wait(PATIENCE) == status
    assert re.search(reason, player.log), player.log


# Runs a program; prints its exit status, its seconds of the processor, and its memory [kB]. Of a
# process that a large one starts, as this one may be, the system counts that one's memory.
MEASURED = """
import resource, subprocess, sys
with open(sys.argv[1], 'w') as log:
    status = subprocess.run(sys.argv[2:], stdout=log, stderr=log).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(status, used.ru_utime + used.ru_stime, used.ru_maxrss)
"""


@pytest.mark.parametrize(('what', 'reason'), [
    ('cut', 'it was cut short, or is damaged'), ('metadata', r'metadata\.yaml is not valid YAML'),
    ('flipped', 'the checksum of the chunk at byte .* is wrong')])
def test_a_damaged_bag_is_told_in_one_line_soon_and_in_little_memory(tmp_path, what, reason):
    bag = tmp_path / 'wine_glass'
    shutil.copytree(ROOT / 'bags' / 'wine_glass', bag)
    file = bag / 'wine_glass.mcap'
    data = bytearray(file.read_bytes())
    if what == 'cut':
        file.write_bytes(data[:len(data) // 2])
    elif what == 'metadata':
        (bag / 'metadata.yaml').write_text('[')
    else:
        data[len(data) // 2] ^= 1
        file.write_bytes(data)
    log = tmp_path / 'log'
    done = subprocess.run([sys.executable, '-c', MEASURED, log, sys.executable, '-m', REPLAY, bag,
                           '--subscribers', '0'], capture_output=True, text=True, check=True)
    status, seconds, kilobytes = (float(each) for each in done.stdout.split())
    line, = own_lines(log.read_text()).splitlines()
    assert status == 1
    assert re.match(f'pmcl_replay: .*{reason}', line), line
    assert seconds < 5  # of a machine that others use too
    assert kilobytes < 1e6


UNKNOWN = bags.VOLATILE._replace(
    depth=2 ** 31 - 1, history=bags.VOLATILE.history.UNKNOWN,
    reliability=bags.VOLATILE.reliability.UNKNOWN, durability=bags.VOLATILE.durability.UNKNOWN)


@pytest.mark.parametrize(('topic', 'reason'), [
    ('/a', 'fewer than 1 subscribers to /a after'), ('/a b', '/a b of .* cannot be played: ')])
def test_a_topic_of_unknown_quality_is_played_and_one_without_a_name_is_not(
        tmp_path, topic, reason):
    bags.record(tmp_path / 'bag', [bags.Recorded(
        topic, 'std_msgs/msg/String', 1, serialize_message(String(data='x')), UNKNOWN)])
    player = Process(tmp_path, REPLAY, tmp_path / 'bag', '--timeout', 0.1)
    assert player.popen.wait(PATIENCE) == 1
    line, = player.log.splitlines()
    assert re.match(f'pmcl_replay: .*{reason}', line), line
