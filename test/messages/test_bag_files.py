"""Recorded files are MCAP as rosbag2 and Foxglove take it, by the format's own library."""

import random
import re
import tracemalloc

import numpy as np
import pytest
import yaml

from pmcl_ros.messages import bags
from pmcl_ros.messages.bags import BagWriter, Recorded, read, record
from pmcl_ros.messages.mcap_records import HEAD, MAGIC, Op
from pmcl_ros.nodes.graph import TOPICS
from pmcl_ros.runtime.errors import BagError

reader = pytest.importorskip('mcap.reader')

CDR = b'\0\1\0\0\4\0\0\0abc\0'  # a String
# metadata.yaml of rosbag2 0.26 (Jazzy), BagMetadata and TopicMetadata, version 9
FIELDS = {'version', 'storage_identifier', 'duration', 'starting_time', 'message_count',
          'topics_with_message_count', 'compression_format', 'compression_mode',
          'relative_file_paths', 'files', 'custom_data', 'ros_distro'}
TOPIC_FIELDS = {'name', 'type', 'serialization_format', 'offered_qos_profiles',
                'type_description_hash'}
QOS_FIELDS = {'history', 'depth', 'reliability', 'durability', 'deadline', 'lifespan',
              'liveliness', 'liveliness_lease_duration', 'avoid_ros_namespace_conventions'}


@pytest.fixture
def messages():
    """Many chunks of two topics and, within each, in no order of time."""
    noise, times = np.random.default_rng(3), [*range(40)]
    random.Random(3).shuffle(times)
    return [Recorded('/a' if time % 3 else '/b', 'std_msgs/msg/String', 10**9 + time,
                     CDR + noise.bytes(300_000), bags.LATCHED if time % 3 else bags.VOLATILE)
            for time in times]


def lengths_of_chunks(data):
    """Of chunks by where they begin, and of the indices of messages behind each."""
    found, place = {}, len(MAGIC)
    while (head := HEAD.unpack_from(data, place))[0] != Op.DATA_END:
        length = HEAD.size + head[1]
        if head[0] == Op.CHUNK:
            found[place] = length, 0
        elif head[0] == Op.MESSAGE_INDEX:
            *_, last = found
            found[last] = found[last][0], found[last][1] + length
        place += length
    return found


@pytest.mark.parametrize('compress', [True, False])
def test_the_file_is_what_its_format_wants(tmp_path, messages, compress):
    record(tmp_path / 'bag', messages, compress)
    with (tmp_path / 'bag' / 'bag.mcap').open('rb') as file:
        mcap = reader.make_reader(file, validate_crcs=True)
        assert mcap.get_header().profile == 'ros2'
        summary = mcap.get_summary()
        schema, = summary.schemas.values()
        assert (schema.name, schema.encoding) == ('std_msgs/msg/String', 'ros2msg')
        assert b'string data' in schema.data
        assert {each.topic: each.message_encoding for each in summary.channels.values()} == {
            '/a': 'cdr', '/b': 'cdr'}
        for channel in summary.channels.values():
            profile, = yaml.safe_load(channel.metadata['offered_qos_profiles'])
            assert profile.keys() == QOS_FIELDS
            assert profile['reliability'] == 'reliable'
            assert profile['durability'] == {'/a': 'transient_local', '/b': 'volatile'}[
                channel.topic]
        assert summary.statistics.message_count == 40
        assert len(summary.chunk_indexes) > 5
        assert {each.compression for each in summary.chunk_indexes} == {'zstd' if compress else ''}
        assert all(each.message_index_offsets for each in summary.chunk_indexes)
        indexed = {index.chunk_start_offset: (index.chunk_length, index.message_index_length)
                   for index in summary.chunk_indexes}
        found = [(channel.topic, message.log_time, message.data)
                 for _, channel, message in mcap.iter_messages()]
    assert indexed == lengths_of_chunks((tmp_path / 'bag' / 'bag.mcap').read_bytes())
    assert found == sorted(((each.topic, each.time_ns, each.cdr) for each in messages),
                           key=lambda each: each[1])


@pytest.mark.parametrize('kind', sorted({each.type for each in TOPICS}))
def test_a_schema_defines_all_that_its_message_is_made_of(tmp_path, kind):
    """As a reader that knows no ROS needs it: nested definitions after lines of =."""
    record(tmp_path / 'bag', [Recorded('/a', kind, 1, CDR)])
    with (tmp_path / 'bag' / 'bag.mcap').open('rb') as file:
        schema, = reader.make_reader(file).get_summary().schemas.values()
    first, *others = schema.data.decode().split('=' * 80 + '\n')
    names = [each.splitlines()[0].removeprefix('MSG: ') for each in others]
    used = {re.split(r'[\[<\s]', line)[0] for part in (first, *others)
            for line in part.splitlines() if re.match(r'\w+/', line)}
    assert used == set(names)
    assert first.strip()


def test_metadata_hold_what_jazzy_reads(tmp_path, messages):
    record(tmp_path / 'bag', messages)
    content = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    information = content['rosbag2_bagfile_information']
    assert information.keys() == FIELDS
    assert (information['version'], information['storage_identifier']) == (9, 'mcap')
    assert information['message_count'] == 40
    assert information['duration'] == {'nanoseconds': 39}
    assert information['starting_time'] == {'nanoseconds_since_epoch': 10**9}
    assert information['relative_file_paths'] == ['bag.mcap']
    # compressed are the chunks, by the storage itself: rosbag2 must not decompress once more
    assert (information['compression_format'], information['compression_mode']) == ('', '')
    counts = {}
    for each in information['topics_with_message_count']:
        topic = each['topic_metadata']
        assert topic.keys() == TOPIC_FIELDS
        assert topic['serialization_format'] == 'cdr'
        assert topic['type_description_hash'].startswith('RIHS01_')
        assert all(profile.keys() == QOS_FIELDS for profile in topic['offered_qos_profiles'])
        counts[topic['name']] = each['message_count']
    assert counts == {'/a': 26, '/b': 14}


def test_only_the_chunk_that_is_read_is_in_memory(tmp_path):
    """However long the bag is and however often it is read."""
    size, count = 1_000_000, 60
    with BagWriter(tmp_path / 'bag') as writer:
        for time in range(count):
            writer.write(Recorded('/a', 'std_msgs/msg/String', time, bytes(size)))
    tracemalloc.start()
    try:
        for _ in range(3):
            assert sum(len(each.cdr) for each in read(tmp_path / 'bag')) == count * size
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 15 * size


def test_what_was_written_before_a_failure_can_be_read(tmp_path):
    def failing():
        yield Recorded('/a', 'std_msgs/msg/String', 1, CDR)
        raise ZeroDivisionError
    with pytest.raises(ZeroDivisionError):
        record(tmp_path / 'bag', failing())
    assert [each.cdr for each in read(tmp_path / 'bag')] == [CDR]


def test_a_bag_without_a_message_is_none(tmp_path):
    record(tmp_path / 'bag', [])
    assert not (tmp_path / 'bag').exists()


def test_what_is_not_wanted_is_not_read(tmp_path, messages):
    record(tmp_path / 'bag', messages)
    assert {each.topic for each in read(tmp_path / 'bag', ['/b'])} == {'/b'}
    assert not list(read(tmp_path / 'bag', ['/c']))


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(BagError, match=r'cannot write .*bag: .*Not a directory'):
        record(tmp_path / 'file' / 'bag', [])
