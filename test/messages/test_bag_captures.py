"""Captures come back from bags as they were recorded, without ROS."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.camera.files import list_pictures, read_raw_frame
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.messages.bag_captures import (
    capture_messages,
    extract_captures,
    light_field_messages,
    posed_views_messages,
    read_bag,
    record_posed_views,
)
from pmcl_ros.messages.bags import is_bag, read, record
from pmcl_ros.runtime.errors import BagError

ROOT = Path(__file__).parents[2]
HEADER = Header(1_700_000_000_123_456_789, 'left_lytro')


@pytest.fixture
def raw_frame(camera_text):
    counts = np.random.default_rng(0).integers(0, 4096, (40, 60)).astype(np.uint16)
    return RawFrame(HEADER, counts, CameraMetadata.parse(camera_text(60, 40)))


@pytest.fixture
def light_field():
    rng = np.random.default_rng(1)
    grid = ViewGrid(Pinhole(6, 5, 20, 21, 2.4, 2.1), 0.002, nominal_positions(3, 2),
                    rng.random((3, 2), np.float32))
    return LightField(HEADER, rng.random((3, 2, 5, 6, 3), np.float32) * 1.5, grid)


def test_a_raw_picture_is_read_as_it_was(tmp_path, raw_frame):
    messages = capture_messages(raw_frame)
    record(tmp_path / 'bag', [*messages, *messages])  # of two captures the first
    found = read_bag(tmp_path / 'bag')
    assert found.header == HEADER
    for each in (found, *map(read_raw_frame, extract_captures(tmp_path / 'bag', tmp_path))):
        assert each.metadata == raw_frame.metadata
        np.testing.assert_array_equal(each.counts, raw_frame.counts)
    assert len(list_pictures(tmp_path)) == 2


def test_a_raw_picture_has_the_last_metadata_before_it(tmp_path, raw_frame, camera_text):
    """Those that are latched are of a picture before the recording."""
    text = camera_text(60, 40)
    other = replace(raw_frame, metadata=CameraMetadata.parse(text.replace('{', '{"x": 1, ', 1)))
    assert other.metadata != raw_frame.metadata
    metadata, image = capture_messages(raw_frame)
    later = replace(other, header=Header(HEADER.stamp_ns + 1, HEADER.frame_id))
    latched, second = capture_messages(later)
    for number, messages in enumerate(([latched, metadata, image], [image, metadata, latched],
                                       [image, second, metadata])):
        bag = tmp_path / f'bag{number}'
        record(bag, [each._replace(time_ns=HEADER.stamp_ns + k)
                     for k, each in enumerate(messages)])
        found = read_bag(bag)
        assert (found.header, found.metadata) == (HEADER, raw_frame.metadata)
    with pytest.raises(BagError, match='no /image_raw with /metadata before it'):
        extract_captures(bag, tmp_path)


def test_views_of_the_first_complete_capture_are_read(tmp_path, light_field):
    header = Header(HEADER.stamp_ns + 10 ** 9, HEADER.frame_id)
    first, second = light_field_messages(light_field), light_field_messages(
        replace(light_field, header=header))
    for left_out in range(len(first)):
        bag = tmp_path / f'bag{left_out}'
        record(bag, [*first[:left_out], *first[left_out + 1:], *second])
        found = read_bag(bag)
        needed = first[left_out].topic in ('/views', '/views/camera_info', '/views/pupil')
        assert found.header == (header if needed else HEADER)


def test_views_are_read_as_they_were_but_for_rounding(tmp_path, light_field):
    record(tmp_path / 'bag', light_field_messages(light_field))
    found = read_bag(tmp_path / 'bag')
    assert found.header == HEADER
    assert found.grid.pinhole == light_field.grid.pinhole
    assert found.grid.baseline == pytest.approx(0.002, rel=1e-12)
    np.testing.assert_array_equal(found.grid.weights, light_field.grid.weights)
    np.testing.assert_array_equal(found.grid.positions, light_field.grid.positions)
    np.testing.assert_allclose(found.views, light_field.views, atol=0.51 / 32768)


@pytest.fixture
def posed_views():
    """Three, each from another place, as sweep_driver makes them: one pinhole, one group."""
    rng = np.random.default_rng(2)
    made = []
    for k in range(3):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.random(None, np.random.default_rng(k)).as_matrix()
        pose[:3, 3] = rng.normal(size=3)
        made.append(PosedView(
            Header(HEADER.stamp_ns + 10 * k, 'base_link'), rng.random((5, 6, 3), np.float32),
            Pinhole(6, 5, 20, 21, 2.4, 2.1), pose, (0.001, 0.002 * k), 'hand-eye', 0.25))
    return PosedViews(tuple(made))


def test_posed_views_are_read_as_they_were_but_for_rounding(tmp_path, posed_views):
    record_posed_views(posed_views, tmp_path / 'bag')
    found = read_bag(tmp_path / 'bag')
    assert found.header == posed_views.header
    for one, other in zip(found.views, posed_views.views, strict=True):
        np.testing.assert_allclose(one.picture, other.picture, atol=0.51 / 65535)
        np.testing.assert_allclose(one.camera_to_reference, other.camera_to_reference, atol=1e-12)
        np.testing.assert_allclose(one.sigma, other.sigma, rtol=1e-6)
        assert (one.pinhole, one.common) == (other.pinhole, other.common)
    assert len({each.group for each in found.views}) == 1
    record_posed_views(found, tmp_path / 'again')
    again = read_bag(tmp_path / 'again')
    for one, other in zip(again.views, found.views, strict=True):  # rounded once
        np.testing.assert_array_equal(one.picture, other.picture)


def test_of_posed_views_that_grow_the_last_complete_ones_are_read(tmp_path, posed_views):
    fewer = PosedViews(posed_views.views[:2])
    later = PosedViews(tuple(replace(each, header=Header(HEADER.stamp_ns + 99, 'base_link'))
                             for each in posed_views.views))
    cut = posed_views_messages(later)[:3]  # the recording ended before the pictures came
    record(tmp_path / 'bag', [*posed_views_messages(fewer), *posed_views_messages(posed_views),
                              *cut])
    assert len(read_bag(tmp_path / 'bag').views) == 3
    assert read_bag(tmp_path / 'bag').header == posed_views.header


def test_the_views_are_those_that_a_node_would_read(tmp_path, light_field):
    pytest.importorskip('rclpy')
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import CameraInfo, Image

    from pmcl_ros.messages.light_field import light_field_from
    record(tmp_path / 'bag', light_field_messages(light_field))
    cdr = {each.topic: each.cdr for each in read(tmp_path / 'bag')}
    theirs = light_field_from(*(deserialize_message(cdr[topic], kind) for topic, kind in (
        ('/views/camera_info', CameraInfo), ('/views/pupil', Image), ('/views', Image))))
    ours = read_bag(tmp_path / 'bag')
    np.testing.assert_array_equal(ours.views, theirs.views)
    np.testing.assert_array_equal(ours.grid.positions, theirs.grid.positions)
    assert (ours.grid.pinhole, ours.header) == (theirs.grid.pinhole, theirs.header)
    assert ours.grid.baseline == pytest.approx(theirs.grid.baseline, rel=1e-12)


def test_messages_are_the_same_bytes_without_ros(tmp_path, light_field):
    pytest.importorskip('rclpy')
    record(tmp_path / 'with', light_field_messages(light_field))
    script = f"""
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0].endswith(('rclpy', '_msgs', '_interfaces')):
            raise ImportError(name + ' is blocked')
sys.meta_path.insert(0, Blocker())
from pmcl_ros.messages.bag_captures import light_field_messages, read_bag
from pmcl_ros.messages.bags import record
record({str(tmp_path / 'without')!r}, light_field_messages(read_bag({str(tmp_path / 'with')!r})))
"""
    subprocess.run([sys.executable, '-c', script], cwd=ROOT, check=True)
    again = light_field_messages(read_bag(tmp_path / 'with'))
    assert list(read(tmp_path / 'without')) == again


def test_a_bag_without_a_picture_is_refused(tmp_path, raw_frame, light_field):
    text, _ = capture_messages(raw_frame)
    record(tmp_path / 'text', [text])
    with pytest.raises(BagError, match=r'text holds neither /image_raw with /metadata nor /views'):
        read_bag(tmp_path / 'text')
    messages = light_field_messages(light_field)
    record(tmp_path / 'cut', [each for each in messages if each.topic != '/views/pupil'])
    with pytest.raises(BagError, match='it takes the picture or its views'):
        read_bag(tmp_path / 'cut')


def test_messages_that_do_not_fit_are_refused(tmp_path, raw_frame, light_field):
    text, _image = capture_messages(raw_frame)
    wrong = next(each for each in light_field_messages(light_field)
                 if each.topic == '/center/image')
    record(tmp_path / 'kind', [text, wrong._replace(topic='/image_raw')])
    with pytest.raises(BagError, match="image_raw: encoding is 'rgb8', expected 'bayer_bggr16'"):
        read_bag(tmp_path / 'kind')
    other = {each.topic: each for each in light_field_messages(LightField(
        HEADER, light_field.views[:2], ViewGrid(
            light_field.grid.pinhole, 0.002, light_field.grid.positions[:2],
            light_field.grid.weights[:2])))}
    mixed = [other.get(each.topic) if each.topic == '/views' else each
             for each in light_field_messages(light_field)]
    record(tmp_path / 'mixed', mixed)
    with pytest.raises(BagError, match=r'views is 12x10 pixels, but 2x3 views \(views/pupil\)'):
        read_bag(tmp_path / 'mixed')


def test_a_bag_is_known_by_its_files(tmp_path):
    assert is_bag(ROOT / 'bags' / 'wine_glass')
    assert not is_bag(ROOT / 'models')
    assert not is_bag(ROOT / 'bags' / 'wine_glass' / 'metadata.yaml')
    assert not is_bag(tmp_path / 'none')
