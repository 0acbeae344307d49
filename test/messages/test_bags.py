"""Bags hold what the driver would publish, in the form that rosbag2 of Jazzy reads."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid
from pmcl_ros.messages import bag_metadata
from pmcl_ros.messages.bag_captures import (
    capture_messages,
    light_field_messages,
    record_light_field,
)
from pmcl_ros.messages.bags import (
    LATCHED,
    VOLATILE,
    Recorded,
    Topic,
    is_bag,
    read,
    record,
    remove_bag,
    topics,
)
from pmcl_ros.messages.mcap_records import Channel
from pmcl_ros.messages.mcap_writer import McapWriter
from pmcl_ros.runtime.errors import BagError

SHIPPED = sorted((Path(__file__).parents[2] / 'bags').iterdir())
TEXT = b'\0\1\0\0\4\0\0\0abc\0'  # a String
HEADER = Header(1_700_000_000_123_456_789, 'lytro_optical_frame')


@pytest.fixture
def raw_frame(camera_text):
    counts = np.random.default_rng(0).integers(0, 4096, (40, 60)).astype(np.uint16)
    return RawFrame(HEADER, counts, CameraMetadata.parse(camera_text(60, 40)))


@pytest.mark.parametrize('compress', [True, False])
def test_what_is_recorded_is_read(tmp_path, raw_frame, compress):
    messages = capture_messages(raw_frame)
    record(tmp_path / 'bag', messages, compress)
    assert list(read(tmp_path / 'bag')) == messages
    assert topics(tmp_path / 'bag') == [
        Topic('/metadata', 'std_msgs/msg/String', LATCHED, 1),
        Topic('/image_raw', 'sensor_msgs/msg/Image', VOLATILE, 1)]


def test_metadata_are_replaced_at_once(tmp_path):
    """Who is reading those before them reads them to the end."""
    path = tmp_path / bag_metadata.NAME
    bag_metadata.write(path, {'version': 8})
    before = path.read_text()
    with path.open() as reading:
        bag_metadata.write(path, {'version': 9})
        assert reading.read() == before
    assert path.read_text() == before.replace('8', '9')
    assert [*tmp_path.iterdir()] == [path]


def test_recorded_messages_are_those_of_the_driver(raw_frame):
    pytest.importorskip('rclpy')
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import Image
    from std_msgs.msg import String

    from pmcl_ros.messages.raw_frame import metadata_from, raw_frame_from, raw_frame_to_messages
    text, image = (deserialize_message(each.cdr, kind) for each, kind in
                   zip(capture_messages(raw_frame), (String, Image), strict=True))
    assert (text, image) == raw_frame_to_messages(raw_frame)
    found = raw_frame_from(image, metadata_from(text))
    np.testing.assert_array_equal(found.counts, raw_frame.counts)
    assert found.header == HEADER


@pytest.fixture
def light_field():
    """4x6 views at irregular places, two dark ones, light below 0 and beyond what is kept."""
    random = np.random.default_rng(7)
    weights = random.random((4, 6), np.float32)
    weights[0, 0] = weights[3, 5] = 0
    grid = ViewGrid(Pinhole(17, 11, 31.25, 29.7, 8.1, 4.9), 0.0123,
                    random.normal(size=(4, 6, 2)), weights)
    views = random.normal(0.5, 1, (4, 6, 11, 17, 3)).astype(np.float32)
    return LightField(HEADER, views, grid)


def test_recorded_views_are_those_of_the_node(light_field, tmp_path):
    pytest.importorskip('rclpy')
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import CameraInfo, Image

    from pmcl_ros.messages.camera_info import pinhole_to_message
    from pmcl_ros.messages.image import picture_from
    from pmcl_ros.messages.light_field import light_field_to_messages
    record_light_field(light_field, tmp_path / 'bag')
    recorded = list(read(tmp_path / 'bag'))
    assert recorded == light_field_messages(light_field)
    kinds = (CameraInfo, Image, CameraInfo, Image, Image)
    info, picture, *parts = (deserialize_message(each.cdr, kind) for each, kind in
                             zip(recorded, kinds, strict=True))
    assert info == pinhole_to_message(HEADER, light_field.grid.pinhole)
    assert tuple(parts) == tuple(light_field_to_messages(light_field))
    np.testing.assert_array_equal(picture_from(picture), light_field.picture())
    assert [each.topic for each in recorded] == [
        '/center/camera_info', '/center/image', '/views/camera_info', '/views/pupil', '/views']


def test_messages_come_in_the_order_of_their_times(tmp_path):
    kind, cdr = 'std_msgs/msg/String', b'\0\1\0\0\1\0\0\0\0'
    messages = [Recorded('/b', kind, 30, cdr), Recorded('/a', kind, 10, cdr),
                Recorded('/a', kind, 20, cdr)]
    record(tmp_path / 'bag', messages)
    assert [each.time_ns for each in read(tmp_path / 'bag')] == [10, 20, 30]


def test_a_bag_is_never_overwritten(tmp_path, raw_frame):
    record(tmp_path / 'bag', capture_messages(raw_frame))
    with pytest.raises(BagError, match='already there'):
        record(tmp_path / 'bag', [])


@pytest.mark.parametrize('content', [None, '', 'rosbag2_bagfile_information: 3'])
def test_what_is_no_bag_is_refused(tmp_path, content):
    bag = tmp_path / 'bag'
    bag.mkdir()
    if content is not None:
        (bag / 'metadata.yaml').write_text(content)
    with pytest.raises(BagError, match='cannot read the bag'):
        topics(bag)


@pytest.mark.parametrize('bag', SHIPPED, ids=lambda bag: bag.name)
def test_shipped_bags_are_small_and_of_jazzy(bag):
    assert sum(each.stat().st_size for each in bag.iterdir()) <= 12_000_000
    information = yaml.safe_load((bag / 'metadata.yaml').read_text())[
        'rosbag2_bagfile_information']
    assert (information['version'], information['storage_identifier']) == (9, 'mcap')
    assert [(each.name, each.qos, each.messages) for each in topics(bag)] == [
        ('/metadata', LATCHED, 1), ('/image_raw', VOLATILE, 1)]
    text, image = read(bag)
    assert text.time_ns == image.time_ns
    assert len(image.cdr) > 2 * 3280 * 3280
    assert (bag / 'truth.json').is_file()


def test_a_bag_of_several_files_is_read_as_one(tmp_path):
    parts = [[Recorded('/a', 'std_msgs/msg/String', time, TEXT, LATCHED) for time in times]
             for times in ((1, 2), (3, 4, 5))]
    for number, part in enumerate(parts):
        record(tmp_path / f'bag_{number}', part)
    bag = tmp_path / 'bag_0'
    shutil.move(tmp_path / 'bag_1' / 'bag_1.mcap', bag)
    metadata = yaml.safe_load((bag / 'metadata.yaml').read_text())
    metadata['rosbag2_bagfile_information']['relative_file_paths'].append('bag_1.mcap')
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(metadata))
    assert list(read(bag)) == parts[0] + parts[1]
    assert topics(bag) == [Topic('/a', 'std_msgs/msg/String', LATCHED, 5)]


def test_a_bag_is_removed_but_nothing_else(tmp_path):
    bag = tmp_path / 'bag'
    own = ['bag.mcap', 'bag.mcap.zstd', 'bag_0.db3', 'bag_0.db3-wal', 'metadata.yaml',
           'metadata.yaml.part', 'metadata.yaml.12.part', '.room_for_the_summary']
    for more in ([], ['notes.txt'], ['mcap'], ['metadata.yaml.old']):
        bag.mkdir(exist_ok=True)
        for name in (*own, *more):
            (bag / name).touch()
        remove_bag(bag)
        assert bag.exists() == bool(more)
        if more:
            (bag / more[0]).unlink()
    remove_bag(tmp_path / 'bag' / 'metadata.yaml')
    assert (bag / 'metadata.yaml').exists()


def test_a_bag_is_a_folder_with_metadata_and_a_file(tmp_path):
    for name, files in (('no_metadata', ['bag.mcap']), ('no_file', ['metadata.yaml']),
                        ('mcap', ['bag.mcap', 'metadata.yaml']),
                        ('packed', ['bag.mcap.zstd', 'metadata.yaml']),
                        ('db3', ['bag_0.db3', 'metadata.yaml'])):
        (tmp_path / name).mkdir()
        for each in files:
            (tmp_path / name / each).touch()
        assert is_bag(tmp_path / name) == (not name.startswith('no_'))


def test_an_unknown_type_and_another_encoding_are_told(tmp_path):
    with pytest.raises(BagError, match=r"'my_msgs/msg/Thing' is none of ROS 2 Jazzy; nothing is"):
        record(tmp_path / 'bag', [Recorded('/a', 'my_msgs/msg/Thing', 1, TEXT)])
    assert not (tmp_path / 'bag').exists()
    writer = McapWriter(tmp_path / 'one.mcap')
    writer.write(writer.add(Channel('/a', 'std_msgs/msg/String', 'json', ''), 'string data'), 1,
                 b'{}')
    writer.flush()
    writer.finish('')
    writer.close()
    with pytest.raises(BagError, match=r'one\.mcap: its messages are json, only cdr is read'):
        list(read(tmp_path / 'one.mcap'))
