"""Bags that are damaged or made to do harm: one error that names the bag, little memory."""

import logging
import shutil
import sqlite3
import struct
from pathlib import Path

import numpy as np
import pytest
import yaml
import zstandard

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.bag_captures import capture_messages, extract_captures, read_bag
from pmcl_ros.messages.bags import LATCHED, Recorded, Topic, read, record, topics
from pmcl_ros.messages.cdr import cdr_from
from pmcl_ros.messages.mcap_records import HEAD, MAGIC, Op, sized, text
from pmcl_ros.messages.mcap_records import record as mcap_record
from pmcl_ros.messages.raw_frame import raw_frame_to_messages
from pmcl_ros.runtime.errors import BagError, OutputError

HEADER = Header(1_700_000_000_123_456_789, 'lytro')
STRING, CDR = 'std_msgs/msg/String', b'\0\1\0\0\4\0\0\0abc\0'


@pytest.fixture
def frame(camera_text):
    counts = np.random.default_rng(0).integers(0, 4096, (40, 60)).astype(np.uint16)
    return RawFrame(HEADER, counts, CameraMetadata.parse(camera_text(60, 40)))


@pytest.fixture
def bag(tmp_path, frame):
    record(tmp_path / 'bag', capture_messages(frame))
    return tmp_path / 'bag'


def chunk_of(data):
    """Where the first chunk's content begins and ends."""
    place = len(MAGIC)
    while True:
        op, length = HEAD.unpack_from(data, place)
        if op == Op.CHUNK:
            return place + HEAD.size, place + HEAD.size + length
        place += HEAD.size + length


def changed(file, change):
    data = bytearray(file.read_bytes())
    change(data)
    file.write_bytes(bytes(data))


@pytest.mark.parametrize('compress', [True, False])
def test_every_flipped_bit_of_a_chunk_is_noticed(tmp_path, frame, compress):
    bag = tmp_path / 'bag'
    record(bag, capture_messages(frame), compress)
    whole = (bag / 'bag.mcap').read_bytes()
    start, end = chunk_of(whole)
    for place in np.random.default_rng(1).integers(start, end, 60).tolist():
        (bag / 'bag.mcap').write_bytes(
            whole[:place] + bytes([whole[place] ^ 1 << place % 8]) + whole[place + 1:])
        with pytest.raises(BagError, match='cannot read the bag'):
            list(read(bag))


def without_crc(file):
    def change(data):
        start, _ = chunk_of(data)
        data[start + 24:start + 28] = bytes(4)
    changed(file, change)


def test_a_bag_without_checksums_is_told_once_and_not_warned_of(bag, caplog):
    caplog.set_level(logging.INFO)
    expected = list(read(bag))
    assert not caplog.records
    without_crc(bag / 'bag.mcap')
    assert [list(read(bag)), list(read(bag))] == [expected, expected]
    only, = caplog.records
    assert 'bag has no checksums' in only.getMessage()
    assert only.levelno == logging.INFO


def last(data, op):
    """Where the content of the last record of a kind begins."""
    place, found = len(MAGIC), 0
    while place < len(data) - len(MAGIC):
        each, length = HEAD.unpack_from(data, place)
        found = place + HEAD.size if each == op else found
        place += HEAD.size + length
    return found


def without_crc_of_summary(data):
    footer = last(data, Op.FOOTER)
    data[footer + 16:footer + 20] = bytes(4)


def test_a_bag_without_a_checksum_of_its_summary_alone_is_told_too(bag, caplog):
    caplog.set_level(logging.INFO)
    changed(bag / 'bag.mcap', without_crc_of_summary)
    assert len(list(read(bag))) == 2
    assert 'bag has no checksums' in caplog.text


@pytest.mark.parametrize('chunks', [0, 2])
def test_a_summary_of_another_number_of_chunks_is_damaged(bag, chunks):
    def change(data):
        without_crc_of_summary(data)
        struct.pack_into('<I', data, last(data, Op.STATISTICS) + 22, chunks)
    changed(bag / 'bag.mcap', change)
    with pytest.raises(BagError, match=f'it has 1 chunks, its summary says {chunks}'):
        topics(bag)


@pytest.mark.parametrize('later', [1, -1], ids=['begins later', 'ends earlier'])
def test_a_message_of_another_time_than_its_chunk_says_is_damage(bag, later):
    def change(data):
        start, _ = chunk_of(data)
        span = np.array(struct.unpack_from('<QQ', data, start)) + later
        struct.pack_into('<QQ', data, start, *span.tolist())
    changed(bag / 'bag.mcap', change)
    with pytest.raises(BagError, match='has a message of channel 1 at'):
        list(read(bag))


@pytest.mark.parametrize('kept', [0, 1, 8, 9, 40, -1, -8, -9, -37, 0.3, 0.9])
def test_a_file_that_was_cut_short(bag, kept):
    data = (bag / 'bag.mcap').read_bytes()
    (bag / 'bag.mcap').write_bytes(data[:int(kept * len(data)) if 0 < kept < 1 else kept])
    with pytest.raises(BagError, match=r'cannot read the bag .*bag: it '):
        topics(bag)
    with pytest.raises(BagError, match=r'cannot read the bag .*bag.mcap: it '):
        topics(bag / 'bag.mcap')


@pytest.mark.parametrize(('content', 'told'), [
    ('[' * 500, 'more than 100000 values or 64 levels'),
    ('rosbag2_bagfile_information: 3', 'has no rosbag2_bagfile_information'),
    ('rosbag2_bagfile_information: {version: 9}', 'storage_identifier: Field required'),
    ('a0: &a0 {x: 1}\n' + '\n'.join(
        f'a{n}: &a{n}\n  <<: [{", ".join([f"*a{n - 1}"] * 9)}]' for n in range(1, 12)),
     r'more than 100000 values .*aliases followed'),
    ('rosbag2_bagfile_information: {version: 9, storage_identifier: mcap, '
     'relative_file_paths: [../../../etc/passwd]}', 'passwd is no .mcap'),
    ('\xff', 'no text in UTF-8'),
])
def test_metadata_that_are_none(bag, content, told):
    (bag / 'metadata.yaml').write_bytes(content.encode('latin-1'))
    with pytest.raises(BagError, match=f'(?s)cannot read the bag .*{told}'):
        topics(bag)


def test_a_chunk_that_unpacks_to_gigabytes(bag):
    """12 kB of zstd; whether it says so or not."""
    packed = zstandard.ZstdCompressor().compress(bytes(2 ** 27)) * 3
    for size, told in ((3 * 2 ** 27, 'says that it unpacks to 402653184 bytes'),
                       (1000, 'unpack to more than 1000')):
        chunk = mcap_record(Op.CHUNK, struct.pack('<QQQI', 0, 0, size, 0), text('zstd'),
                            struct.pack('<Q', len(packed)), packed)
        (bag / 'bag.mcap').write_bytes(
            MAGIC + mcap_record(Op.HEADER, text('ros2'), text('')) + chunk
            + mcap_record(Op.FOOTER, bytes(20)) + MAGIC)
        with pytest.raises(BagError, match=told):
            topics(bag)


def test_a_quality_of_service_that_is_none_is_refused_and_an_unknown_one_is_not(bag):
    def of(qos):
        channel = mcap_record(Op.CHANNEL, struct.pack('<HH', 1, 0), text('/a'), text('cdr'),
                              sized(text('offered_qos_profiles') + text(qos)))
        (bag / 'bag.mcap').write_bytes(
            MAGIC + mcap_record(Op.HEADER, text('ros2'), text('')) + channel
            + mcap_record(Op.FOOTER, bytes(20)) + MAGIC)
        return topics(bag)[0].qos
    forever = '{sec: 9223372036, nsec: 854775807}'
    rest = (f'deadline: {forever}, lifespan: {forever}, liveliness: 1, '
            f'liveliness_lease_duration: {forever}, avoid_ros_namespace_conventions: false')
    assert of(f'[{{history: 1, depth: 1, reliability: 1, durability: 1, {rest}}}]') == LATCHED
    found = of(f'[{{history: unknown, depth: 0, reliability: 7, durability: odd, {rest}}}]')
    assert found[:4] == (found.history.UNKNOWN, 0, found.reliability.UNKNOWN,
                         found.durability.UNKNOWN)
    deep = f'[{{history: 1, depth: -5, reliability: 1, durability: 1, {rest}}}]'
    for qos in ('[{history: 1}]', '3', '[[[[', deep, '{<<: [*a]}'):
        with pytest.raises(BagError, match='/a has no quality of service that is known'):
            of(qos)


def test_a_message_that_is_damaged_or_of_another_type(tmp_path, frame):
    metadata, image = capture_messages(frame)
    for number, (wrong, told) in enumerate((
            (image._replace(cdr=image.cdr[:30]), r'30 bytes are no sensor_msgs/msg/Image'),
            (image._replace(type=STRING), r'/image_raw is std_msgs/msg/String, expected'),
            (image._replace(cdr=b'\xff' * 100), 'are no sensor_msgs/msg/Image'))):
        bag = tmp_path / str(number)
        record(bag, [metadata, wrong])
        for reader in (read_bag, lambda bag: extract_captures(bag, tmp_path)):
            with pytest.raises(BagError, match=told):
                reader(bag)


def test_only_what_a_camera_writes_is_extracted(tmp_path, frame):
    text_message, image = raw_frame_to_messages(frame)
    metadata, recorded = capture_messages(frame)
    cases = []
    for width, height, told in ((2, 2, 'raw frame is 2x2 pixels, its metadata says 60x40'),
                                (0, 0, 'at least one pixel'), (60, 39, '60x39 pixels in rows')):
        image.width, image.height, image.step = width, height, 2 * width
        image.data = frame.counts.tobytes()[:2 * width * min(height, 2)]
        cases.append((metadata, recorded._replace(cdr=cdr_from(image)), told))
    image.width, image.height, image.step = 60, 40, 120
    image.data, image.is_bigendian = frame.counts.tobytes(), 1
    cases.append((metadata, recorded._replace(cdr=cdr_from(image)), 'is_bigendian is 1'))
    text_message.data = 'nonsense'
    cases.append((metadata._replace(cdr=cdr_from(text_message)), recorded, 'is not JSON'))
    for number, (first, second, told) in enumerate(cases):
        record(tmp_path / f'bag{number}', [first, second])
        (tmp_path / f'out{number}').mkdir()
        with pytest.raises(BagError, match=told):
            extract_captures(tmp_path / f'bag{number}', tmp_path / f'out{number}')
        assert not list((tmp_path / f'out{number}').iterdir())


@pytest.mark.parametrize('there', ['IMG_0001.RAW', 'IMG_0001.TXT'])
def test_nothing_is_overwritten(bag, tmp_path, there):
    (tmp_path / there).write_text('mine')
    with pytest.raises(OutputError, match=f'{there} is there already'):
        extract_captures(bag, tmp_path)
    assert (tmp_path / there).read_text() == 'mine'


def test_messages_whose_chunks_overlap_come_in_order_or_not_at_all(tmp_path, monkeypatch):
    times = [5, 1, 4, 2, 3, 0]
    record(tmp_path / 'bag', [Recorded('/a', STRING, each, CDR + bytes(1_100_000))
                              for each in times])
    assert [each.time_ns for each in read(tmp_path / 'bag')] == [*range(6)]
    chunks = b''.join(mcap_record(
        Op.CHUNK, struct.pack('<QQQI', 0, 9, 2 ** 28, 0), text('zstd'), struct.pack('<Q', 0))
        for _ in range(2))
    statistics = mcap_record(Op.STATISTICS, struct.pack('<QHIIIIQQ', 0, 0, 1, 0, 0, 2, 0, 0),
                             sized(b''))
    channel = mcap_record(Op.CHANNEL, struct.pack('<HH', 1, 0), text('/a'), text('cdr'),
                          sized(b''))
    (tmp_path / 'bag' / 'bag.mcap').write_bytes(
        MAGIC + mcap_record(Op.HEADER, text('ros2'), text('')) + chunks + channel + statistics
        + mcap_record(Op.FOOTER, bytes(20)) + MAGIC)
    with pytest.raises(BagError, match='chunks of one time unpack to more than 384 MiB'):
        list(read(tmp_path / 'bag'))


def test_a_message_that_is_too_large_to_be_read_again_is_not_written(tmp_path):
    with pytest.raises(BagError, match='is larger than the 255 MiB that a bag takes'):
        record(tmp_path / 'bag', [Recorded('/a', STRING, 1, bytes(2 ** 28))])


def sqlite_bag(folder, script, rows=()):
    folder.mkdir()
    with sqlite3.connect(folder / 'bag.db3') as file:
        file.executescript(script)
        for row in rows:
            file.execute('INSERT INTO messages (topic_id, timestamp, data) VALUES (1, ?, ?)', row)
    (folder / 'metadata.yaml').write_text(yaml.safe_dump({'rosbag2_bagfile_information': {
        'version': 4, 'storage_identifier': 'sqlite3', 'relative_file_paths': ['bag.db3']}}))
    return folder


TOPICS = """CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT,
serialization_format TEXT, offered_qos_profiles TEXT);
INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/String', 'cdr', '');"""
MESSAGES = ('CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
            'data BLOB)')


def test_a_bag_of_older_versions(tmp_path):
    bag = sqlite_bag(tmp_path / 'bag', TOPICS + MESSAGES, [(3, CDR), (1, CDR), (2, CDR)])
    assert [(each.topic, each.time_ns, each.cdr) for each in read(bag)] == [
        ('/a', time, CDR) for time in (1, 2, 3)]
    assert [(each.name, each.messages) for each in topics(bag)] == [('/a', 3)]


@pytest.mark.parametrize(('script', 'told'), [
    (TOPICS, 'no table messages'),
    (MESSAGES, 'no table topics'),
    (TOPICS + 'CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 '
     'FROM n) SELECT id, 1 AS topic_id, 1 AS timestamp, 1 AS data FROM n', 'no table messages'),
    (TOPICS + 'CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp '
     'INTEGER, data BLOB AS (zeroblob(1000000000)))', 'no table messages'),
    (TOPICS + MESSAGES + "; INSERT INTO messages VALUES (1, 1, 'x', 'y')", 'invalid literal'),
    (TOPICS + MESSAGES + '; INSERT INTO messages VALUES (1, 1, 5, NULL)', 'has None bytes'),
])
def test_a_file_of_sqlite_that_is_no_bag(tmp_path, script, told):
    bag = sqlite_bag(tmp_path / 'bag', script)
    with pytest.raises(BagError, match=told):
        list(read(bag))


def test_bags_that_rosbag2_has_compressed(tmp_path, bag):
    expected = list(read(bag))
    pack = zstandard.ZstdCompressor().compress
    values = yaml.safe_load((bag / 'metadata.yaml').read_text())
    information = values['rosbag2_bagfile_information']
    whole = tmp_path / 'whole'
    shutil.copytree(bag, whole)
    (whole / 'bag.mcap').unlink()
    (whole / 'bag.mcap.zstd').write_bytes(pack((bag / 'bag.mcap').read_bytes()))
    information |= {'compression_format': 'zstd', 'compression_mode': 'FILE',
                    'relative_file_paths': ['bag.mcap.zstd']}
    (whole / 'metadata.yaml').write_text(yaml.safe_dump(values))
    assert list(read(whole)) == expected
    (whole / 'bag.mcap.zstd').write_bytes(pack(bytes(2 ** 26)))
    with pytest.raises(BagError, match='unpacks to more than 1000 times its size'):
        topics(whole)
    (whole / 'bag.mcap.zstd').write_bytes(b'nothing that zstd has written')
    with pytest.raises(BagError, match='zstd is damaged'):
        topics(whole)
    each = tmp_path / 'each'
    record(each, [one._replace(cdr=pack(one.cdr)) for one in expected])
    information |= {'compression_mode': 'MESSAGE', 'relative_file_paths': ['each.mcap']}
    (each / 'metadata.yaml').write_text(yaml.safe_dump(values))
    assert list(read(each)) == expected


def test_a_file_without_a_summary(bag):
    """Of the preset `fastwrite`: no chunks, nothing after the data."""
    expected, there = list(read(bag)), topics(bag)
    data = (bag / 'bag.mcap').read_bytes()
    start, end = chunk_of(data)
    records = zstandard.ZstdDecompressor().decompress(data[start + 44:end])
    (bag / 'bag.mcap').write_bytes(
        MAGIC + mcap_record(Op.HEADER, text('ros2'), text('')) + records
        + mcap_record(Op.FOOTER, bytes(20)) + MAGIC)
    assert list(read(bag)) == expected
    assert topics(bag) == there
    assert isinstance(there[0], Topic)


@pytest.mark.parametrize('counted', [True, False])
def test_a_summary_need_not_count_the_messages_of_each_channel(bag, counted):
    there, data = topics(bag), (bag / 'bag.mcap').read_bytes()
    start, end = chunk_of(data)
    records = zstandard.ZstdDecompressor().decompress(data[start + 44:end])
    numbers = struct.pack('<QHIIIIQQ', sum(each.messages for each in there), 2, 2, 0, 0, 0, 1, 1)
    counts = b''.join(struct.pack('<HQ', number, each.messages) for number, each in enumerate(
        there, 1)) if counted else b''
    (bag / 'bag.mcap').write_bytes(
        MAGIC + mcap_record(Op.HEADER, text('ros2'), text('')) + records
        + mcap_record(Op.STATISTICS, numbers, sized(counts))
        + mcap_record(Op.FOOTER, bytes(20)) + MAGIC)
    assert topics(bag) == there


@pytest.mark.parametrize('name', ['shaker', 'wine_glass'])
def test_the_shipped_bags_have_checksums(name, caplog):
    caplog.set_level(logging.INFO)
    assert len(list(read(Path(__file__).parents[2] / 'bags' / name))) == 2
    assert not caplog.records
