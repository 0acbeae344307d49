"""A robot's bag of images and camera poses is the views of where its camera rested."""

import logging
from array import array
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import interpolate, transform
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.sweep import view_collection
from pmcl_ros.messages.bag_captures import read_bag
from pmcl_ros.messages.bag_views import BagViews, read_views
from pmcl_ros.messages.bags import Recorded, is_bag, record
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.cdr import cdr_from, type_name, typestore
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.image import picture_to_message
from pmcl_ros.messages.pose import pose_to_message
from pmcl_ros.messages.types import (
    CompressedImage,
    PoseStamped,
    Transform,
    TransformStamped,
    Vector3,
)
from pmcl_ros.runtime.errors import BagError, SettingsError

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
PINHOLE = Pinhole(32, 24, 90.0, 92.0, 15.0, 12.0)
PICTURES = np.random.default_rng(0).integers(0, 255, (3, 24, 32, 3), np.uint8)
MOUNT = BagViews(mount_position=(0.02, -0.03, 0.1), mount_rpy=(0.1, 0.2, -1.5))
HAND_EYE = transform(MOUNT.mount_position, MOUNT.mount_rpy)


PLACES = np.tile(np.eye(4), (3, 1, 1))
PLACES[:, :3, :3] = Rotation.from_rotvec([[0, -0.35, 0], [0, 0, 0], [0, 0.35, 0]]).as_matrix()
PLACES[:, :3, 3] = [[0.1, 0.2, 0.3], [0.3, 0.1, 0.35], [0.5, 0.2, 0.3]]


def camera_at(seconds):
    """At rest for 0.6 s at each place, then 0.4 s on the way to the next."""
    number, rest = divmod(seconds, 1.0)
    first, second = PLACES[int(number)], PLACES[min(int(number) + 1, 2)]
    return interpolate(first, second, max(rest - 0.6, 0) / 0.4)


@dataclass(frozen=True)
class Robot:
    """What a robot records: images at 10 Hz, poses at 25 Hz, 3 s long."""

    camera: str = '/wrist'
    frame: str = 'base_link'
    clock: float = 0  # s: ahead of the time

    def images(self, compressed=False, first=0.05, last=2.6, bits=8):
        for seconds in np.arange(first, last, 0.1):
            header = self.header(seconds, 'eye')
            message = picture_to_message(header, PICTURES[int(seconds)])
            topic = f'{self.camera}/image'
            if compressed:
                values = PICTURES[int(seconds)]
                if bits > 8:
                    values = np.rint(values * ((2 ** bits - 1) / 255)).astype(np.uint16)
                png = cv2.imencode('.png', values[..., ::-1])[1]
                message = CompressedImage(header=header_to_message(header), format='png',
                                          data=array('B', png.tobytes()))
                topic += '/compressed'
            yield recorded(topic, message, header)

    def info(self, seconds=0, **changes):
        header = self.header(seconds)
        message = pinhole_to_message(header, PINHOLE)
        for name, value in changes.items():
            setattr(message, name, value)
        return recorded(f'{self.camera}/camera_info', message, header)

    def poses(self, topic='/camera_pose', mount=None, last=3.0, unit=1):
        """PoseStamped of the camera, or of the link that it is on by a mount (4, 4).

        unit: of the lengths in the bag, in 1/m.
        """
        for seconds in np.arange(0, last, 0.04):
            header = self.header(seconds)
            pose = camera_at(seconds) @ np.linalg.inv(np.eye(4) if mount is None else mount)
            pose[:3, 3] *= unit
            yield recorded(topic, PoseStamped(header=header_to_message(header),
                                              pose=pose_to_message(pose)), header)

    def tf(self, with_camera=True):
        """base_link <- torso (fixed), torso <- wrist (moving), wrist <- eye (fixed)."""
        torso = transform((0.1, 0.0, 0.7), (0.0, 0.1, 0.4))
        fixed = [('base_link', 'torso', torso)] + [('wrist', 'eye', HAND_EYE)] * with_camera
        yield transforms('/tf_static', self.header(0), fixed)
        for seconds in np.arange(0, 3.0, 0.04):
            wrist = np.linalg.inv(torso) @ camera_at(seconds) @ np.linalg.inv(HAND_EYE)
            header = self.header(seconds)
            yield transforms('/tf', header, [('torso', 'wrist', wrist)])

    def header(self, seconds, frame=None):
        return Header(START + round((self.clock + seconds) * SECOND), frame or self.frame)


def recorded(topic, message, header):
    return Recorded(topic, type_name(type(message)), header.stamp_ns, cdr_from(message))


def transforms(topic, header, edges):
    types = typestore().types
    made = []
    for parent, child, matrix in edges:
        pose = pose_to_message(matrix)
        p = pose.position
        made.append(TransformStamped(
            header=header_to_message(Header(header.stamp_ns, parent)), child_frame_id=child,
            transform=Transform(translation=Vector3(x=p.x, y=p.y, z=p.z),
                                rotation=pose.orientation)))
    return recorded(topic, types['tf2_msgs/msg/TFMessage'](transforms=made), header)


def bag_of(folder, *parts):
    messages = [each for part in parts for each in (
        [part] if isinstance(part, Recorded) else part)]
    record(folder / 'bag', sorted(messages, key=lambda each: each.time_ns))
    return folder / 'bag'


def assert_rests(found):
    """The views are one of each place, at its pose, with its picture."""
    assert isinstance(found, PosedViews)
    assert found.header.frame_id == 'base_link'
    assert len(found.views) == 3
    for view, place, picture in zip(found.views, PLACES, PICTURES, strict=True):
        np.testing.assert_allclose(view.camera_to_reference, place, atol=1e-9)
        np.testing.assert_array_equal(view.displayed(), picture)
        assert view.pinhole == PINHOLE
        assert view.sigma == (0.001, 0.0035)
        assert (view.group, view.common) == ('hand-eye', 0.5)


ROBOT = Robot()


@pytest.mark.parametrize(('parts', 'wanted'), [
    ((ROBOT.info(), ROBOT.images(), ROBOT.poses()), None),
    ((ROBOT.info(), ROBOT.images(compressed=True), ROBOT.poses()), None),
    ((ROBOT.info(), ROBOT.images(), ROBOT.images(compressed=True), ROBOT.poses()), None),
    ((ROBOT.info(), ROBOT.images(), ROBOT.tf()), None),
    ((ROBOT.info(), ROBOT.images(), ROBOT.tf(with_camera=False)),
     MOUNT.model_copy(update={'mount_parent': 'wrist'})),
    ((ROBOT.info(), ROBOT.images(), ROBOT.poses(mount=HAND_EYE)), MOUNT),
    ((ROBOT.info(), ROBOT.images(), ROBOT.poses(), Robot('/other').images(),
      ROBOT.poses('/goal', HAND_EYE), ROBOT.tf()),
     BagViews(image_topic='/wrist/image', pose_topic='/camera_pose')),
    ((ROBOT.info(), ROBOT.images(compressed=True, bits=12), ROBOT.poses()), BagViews(bits=12)),
    ((ROBOT.info(k=1.1 * PINHOLE.matrix.ravel(), d=array('d', [0.1] * 5)), ROBOT.images(),
      ROBOT.poses()), BagViews(rectified=True)),
], ids=['poses', 'compressed', 'both', 'tf', 'tf and mount', 'poses and mount', 'chosen',
        '12 bits', 'rectified'])
def test_a_view_of_each_place_where_the_camera_rested(tmp_path, parts, wanted):
    assert_rests(read_bag(bag_of(tmp_path, *parts), wanted))


def test_frames_that_are_left_out_are_told_in_one_line(tmp_path, caplog):
    read_bag(bag_of(tmp_path, ROBOT.info(), ROBOT.images(first=1.45), ROBOT.poses(last=2.3)))
    line, = caplog.messages
    assert '2 posed views in base_link; left out: frame 3: moved by 2.5 px' in line
    assert line.count('moved by') == 1
    assert 'frame 10: no pose of its time, or later, is there' in line
    assert line.endswith('3 of places with a better one')
    assert '\n' not in line


def test_a_view_that_is_blurred_is_a_warning(tmp_path, caplog, monkeypatch):
    pictures = np.random.default_rng(0).integers(0, 255, (3, 48, 64, 3), np.uint8)
    pictures[1] = cv2.blur(pictures[1], (5, 1))
    monkeypatch.setitem(globals(), 'PICTURES', pictures)
    monkeypatch.setitem(globals(), 'PINHOLE', Pinhole(64, 48, 90.0, 92.0, 31.0, 24.0))
    assert_rests(read_views(bag_of(tmp_path, ROBOT.info(), ROBOT.images(), ROBOT.poses()),
                            BagViews()))
    line, = [each for each in caplog.records if 'blurred' in each.message]
    assert line.levelname == 'WARNING'
    assert '3 posed views in base_link; view 1 (frame ' in line.message


def test_an_arm_that_moves_between_places_is_no_warning(tmp_path, caplog):
    with caplog.at_level(logging.INFO):
        assert_rests(read_bag(bag_of(tmp_path, ROBOT.info(), ROBOT.images(), ROBOT.poses())))
    line, = [each for each in caplog.records if 'left out' in each.message]
    assert line.levelno == logging.INFO
    assert len(line.message) < 300


@pytest.mark.parametrize('make', [ROBOT.poses, ROBOT.tf])
@pytest.mark.parametrize('late', [-100, 100])
def test_clocks_that_differ_are_told(tmp_path, make, late):
    images = Robot(clock=late).images()
    with pytest.raises(BagError, match='the clocks of images and poses differ by 100 s'):
        read_bag(bag_of(tmp_path, ROBOT.info(), images, make()))


@pytest.mark.parametrize(('topic', 'wanted', 'asked'), [
    ('/ee_pose', None, True), ('/robot/tool0/pose', None, True),
    ('/arm/wrist_pose', BagViews(pose_topic='/arm/wrist_pose'), True), ('/ee_pose', MOUNT, False),
    ('/wrist/camera_pose', None, False), ('/handle_pose', None, False), ('/pose', None, False)])
def test_whose_poses_are_the_camera_s_is_told_and_asked_for_those_of_an_arm(
        tmp_path, caplog, topic, wanted, asked):
    poses = ROBOT.poses(topic, HAND_EYE if wanted is MOUNT else None)
    with caplog.at_level(logging.INFO):
        assert_rests(read_bag(bag_of(tmp_path, ROBOT.info(), ROBOT.images(), poses), wanted))
    line, = [each for each in caplog.records if f' {topic}' in each.message]
    assert (line.levelno, 'are they of the arm?' in line.message) == (
        (logging.WARNING, True) if asked else (logging.INFO, False))


def test_poses_in_millimetres_are_asked_for_once(tmp_path, caplog):
    read_bag(bag_of(tmp_path, ROBOT.info(), ROBOT.images(), ROBOT.poses(unit=1000)))
    line, = caplog.messages
    assert line.count('are the poses in millimetres, not metres?') == 1


def test_a_calibration_of_another_resolution_is_told_once(tmp_path):
    with pytest.raises(BagError, match=r'there is no view: frame 1 has \d+x\d+ px, its camera '
                       r'.* resolution and \d+ more like it$'):
        read_bag(bag_of(tmp_path, ROBOT.info(width=999), ROBOT.images(), ROBOT.poses()))


def test_an_image_that_cannot_be_read_is_left_out_and_the_others_are_not(tmp_path, caplog):
    images = list(ROBOT.images(compressed=True))
    header = ROBOT.header(0.15, 'eye')
    images[1] = recorded(images[1].topic, CompressedImage(
        header=header_to_message(header), format='png', data=array('B', [1, 2, 3])), header)
    assert_rests(read_bag(bag_of(tmp_path, ROBOT.info(), images, ROBOT.poses())))
    line, = caplog.messages
    assert 'left out: frame 2: compressed image: 3 bytes of format' in line
    assert '\n' not in line


def test_what_comes_without_a_calibration_is_left_out_and_the_rest_is_not(tmp_path, caplog):
    infos = [ROBOT.info(), ROBOT.info(0.12, k=np.zeros(9)), ROBOT.info(0.22)]
    assert_rests(read_bag(bag_of(tmp_path, infos, ROBOT.images(), ROBOT.poses())))
    line, = caplog.messages
    assert 'calibrate the camera' in line


def test_a_distortion_that_leaves_little_of_the_picture_is_told_once(tmp_path, caplog):
    wide = {'k': np.array([20.0, 0, 15, 0, 20, 12, 0, 0, 1]),
            'd': array('d', [-0.35, 0.12, 0, 0, 0])}
    infos = [ROBOT.info(seconds, **wide) for seconds in (0, 1, 2)]
    read_bag(bag_of(tmp_path, infos, ROBOT.images(), ROBOT.poses()))
    line, = [each for each in caplog.messages if 'distortion' in each]
    assert line.startswith("camera 'base_link': without its distortion ")


def test_views_beyond_the_memory_are_left_and_those_before_taken(tmp_path, caplog, monkeypatch):
    monkeypatch.setattr(view_collection, 'MOST_BYTES', 2 * 5 * PICTURES[0].size + 100)
    found = read_bag(bag_of(tmp_path, ROBOT.info(), ROBOT.images(), ROBOT.poses()))
    assert len(found.views) == 2
    assert '3 views need' in caplog.text
    assert 'the views before it are taken' in caplog.text


def test_bags_of_the_older_storage_are_read_too(tmp_path):
    """Topics of a Lytro that took no picture count as none."""
    writer = Writer(tmp_path / 'bag', version=8, storage_plugin=StoragePlugin.SQLITE3)
    with writer:
        for topic, kind in (('/metadata', 'std_msgs/msg/String'),
                            ('/image_raw', 'sensor_msgs/msg/Image')):
            writer.add_connection(topic, kind, typestore=typestore())
        known = {}
        for each in (ROBOT.info(), *ROBOT.images(), *ROBOT.poses()):
            if each.topic not in known:
                known[each.topic] = writer.add_connection(each.topic, each.type,
                                                          typestore=typestore())
            writer.write(known[each.topic], each.time_ns, each.cdr)
    assert is_bag(tmp_path / 'bag')
    assert_rests(read_bag(tmp_path / 'bag'))


OTHER = Robot(frame='map')


@pytest.mark.parametrize(('parts', 'wanted', 'reason'), [
    ((ROBOT.info(), ROBOT.images()), None, r'nor images with poses of their camera'),
    ((ROBOT.images(), ROBOT.poses()), None, r'no /wrist/camera_info \(CameraInfo\) beside'),
    ((ROBOT.info(distortion_model='fov', d=array('d', [1.0] * 5)), ROBOT.images(), ROBOT.poses()),
     None, "distortion model 'fov' is not known"),
    ((ROBOT.info(k=np.zeros(9)), ROBOT.images(), ROBOT.poses()), None, 'calibrate the camera'),
    ((ROBOT.info(), ROBOT.images(), ROBOT.poses(last=1.0), OTHER.poses()), None,
     "/camera_pose is in frame 'map' at 17.*, expected 'base_link'"),
    ((ROBOT.info(), ROBOT.images(), OTHER.poses()), BagViews(fixed_frame='base_link'),
     "expected 'base_link'"),
    ((ROBOT.info(), ROBOT.images(first=1.05), ROBOT.poses(last=1.0)), None,
     'there is no view: frame 1: no pose of its time, or later, is there'),
    ((ROBOT.info(), ROBOT.images(), ROBOT.poses(last=0.01)), None,
     'there is no view: frame 1: no pose'),
    ((ROBOT.info(), ROBOT.images(), ROBOT.tf(with_camera=False)), None,
     "no chain of transforms joins 'eye' to 'base_link': there are base_link, torso, wrist; "
     'name the frames by fixed_frame, and camera_frame or mount_parent .--collect.'),
    ((ROBOT.info(), ROBOT.images(), ROBOT.tf()), MOUNT,
     'place the camera in mount_parent, which is empty'),
    ((ROBOT.info(), ROBOT.images(), ROBOT.poses(), Robot('/left').images()), None,
     'has /wrist/image, /left/image for image: choose one .--image-topic.'),
    ((ROBOT.info(), ROBOT.images(), ROBOT.poses('/a'), ROBOT.tf()), None,
     'has .* for camera_pose: choose one .--pose-topic.'),
    ((ROBOT.info(), ROBOT.images(), ROBOT.poses()), BagViews(image_topic='/no'),
     'has no /no of this kind; it has /wrist/image'),
], ids=['no poses', 'no camera_info', 'unknown lens', 'uncalibrated', 'two frames', 'other frame',
        'poses ended', 'one pose', 'not on tf', 'no mount_parent', 'two cameras', 'two sources',
        'no such topic'])
def test_what_is_missing_or_wrong_is_told_in_one_line(tmp_path, parts, wanted, reason):
    with pytest.raises(BagError, match=reason) as caught:
        read_bag(bag_of(tmp_path, *parts), wanted)
    assert '\n' not in str(caught.value)


def test_the_mask_of_a_camera_is_that_of_its_views(tmp_path):
    bag = bag_of(tmp_path, ROBOT.info(), ROBOT.images(), ROBOT.poses())
    height, width = read_views(bag, BagViews()).views[0].picture.shape[:2]
    mask = np.full((height, width), 255, np.uint8)
    mask[height // 2:, 5:15] = 0
    cv2.imwrite(str(tmp_path / 'gripper.png'), mask)
    for view in read_views(bag, BagViews(mask=str(tmp_path / 'gripper.png'))).views:
        np.testing.assert_array_equal(view.mask, mask > 0)
    with pytest.raises(BagError, match=r"parameter 'mask': there is no .*none\.png"):
        read_views(bag, BagViews(mask=str(tmp_path / 'none.png')))


def test_a_parameter_file_is_read_as_sweep_driver_reads_it():
    """That of `pmcl handeye`, or one for all nodes; a section of another node is refused."""
    def section(**values):
        return {'ros__parameters': values}

    own = {'/**/sweep_driver': section(common=0.5), '/**/grasp_node': section(mount_rpy=[0.0] * 3)}
    assert BagViews.make(own) == BagViews(common=0.5)
    assert BagViews.make({'/**': section(common=0.25, gap=0.2)} | own | {'image_topic': '/i'}) == (
        BagViews(common=0.5, gap=0.2, image_topic='/i'))
    with pytest.raises(SettingsError, match=r'/\*\*/fixed_cameras: there is no such key'):
        BagViews.make(own | {'/**/fixed_cameras': section(common=0.5)})
