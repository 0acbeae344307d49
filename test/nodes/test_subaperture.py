"""subaperture_node takes another calibration or white image while it runs, or says why not."""

import json
import re
from functools import cache

import numpy as np
import pytest
import rclpy
from harness import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, Process
from rcl_interfaces.srv import DescribeParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String
from synthetic_camera import SIDE, SyntheticCamera, waves

from pmcl_ros.camera.files import write_raw_frame
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.lightfield.light_field import VIEW_WHITE
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.light_field import light_field_from, pupil_from
from pmcl_ros.messages.raw_frame import raw_frame_to_messages
from pmcl_ros.nodes.runtime.base import BIG, LATCHED, SMALL
from pmcl_ros.nodes.subaperture_node import SubapertureNode

NAME = 'subaperture_node'


@cache
def synthetic(text, serial, zoom):
    """A camera whose vignetting tells its zoom."""
    frame = json.loads(text)
    frame['devices'] = {'lens': {'zoomStep': zoom, 'focusStep': 700}}
    return SyntheticCamera(json.dumps(frame), serial=serial, tilt=(zoom / 1e4, 0))


class Camera:
    """A made-up camera: its files, and what its pictures become."""

    def __init__(self, text, folder, serial, zoom):
        self.camera = synthetic(text, serial, zoom)
        self.white = folder / 'whites' / f'MOD_{serial}_{zoom}.RAW'
        self.white.parent.mkdir(exist_ok=True)
        write_raw_frame(self.white, self.camera.white())

    def calibration(self, folder, **changes):
        path = folder / f'{self.camera.calibration.serial}_{len(changes)}.yaml'
        self.camera.calibration.model_copy(update=changes).save(path)
        return path

    def decoded(self, frame, **changes):
        calibration = self.camera.calibration.model_copy(update=changes)
        return Decoder(calibration, self.camera.white()).decode(frame)


@pytest.fixture
def cameras(camera_text, tmp_path):
    """A function serial, zoom -> a camera whose white image lies in tmp_path/whites."""
    return lambda serial='A1', zoom=600: Camera(camera_text(SIDE, SIDE), tmp_path, serial, zoom)


@pytest.fixture
def node(tmp_path, user):
    """A function parameters -> (process, send) of an active node.

    send(camera, stamp) publishes a picture and returns the frame and the light field that comes.
    """
    processes = []

    def start(**parameters):
        values = {name: str(value) for name, value in parameters.items()}
        processes.append(Process(tmp_path, f'pmcl_ros.nodes.{NAME}', params=values).__enter__())
        assert all(user.change(NAME, CONFIGURE, ACTIVATE)), processes[0].log
        parts = [user.listen(CameraInfo, 'views/camera_info', SMALL),
                 user.listen(Image, 'views/pupil', SMALL), user.listen(Image, 'views', BIG)]
        texts = user.publisher(String, 'metadata', LATCHED)
        images = user.publisher(Image, 'image_raw', BIG)

        def send(camera, stamp):
            frame = camera.camera.picture(waves, header=Header(stamp))
            text, image = raw_frame_to_messages(frame)
            texts.publish(text)
            user.delivered(texts)
            images.publish(image)
            return frame

        def receive(stamp):
            def complete():
                found = [[each for each in part if header_from(each.header).stamp_ns == stamp]
                         for part in parts]
                return all(found) and [each[0] for each in found]
            return light_field_from(*user.wait(complete, f'views of {stamp}'))
        return processes[0], send, receive

    yield start
    for each in processes:
        each.__exit__(None)


def same(found, expected):
    assert found.grid.pinhole == expected.grid.pinhole
    np.testing.assert_array_equal(found.grid.weights, expected.grid.weights)
    np.testing.assert_allclose(found.views, np.clip(expected.views, 0, 65535 / VIEW_WHITE),
                               atol=1 / VIEW_WHITE)


def test_a_white_image_is_chosen_for_each_zoom(tmp_path, node, cameras):
    near, far = cameras(zoom=100), cameras(zoom=600)
    process, send, receive = node(calibration=near.calibration(tmp_path), white=near.white.parent)
    for stamp, camera in enumerate((near, far, far, near), 1):
        frame = send(camera, stamp)
        same(receive(stamp), camera.decoded(frame))
    chosen = [line for line in process.log.splitlines() if 'white image: ' in line]
    assert ['MOD_A1_100' in line for line in chosen] == [True, False, True]


def test_a_calibration_is_taken_over_while_pictures_come(tmp_path, node, user, cameras):
    """Each picture is decoded wholly with the one or the other, and none is lost."""
    camera = cameras()
    old, new = camera.calibration(tmp_path), camera.calibration(tmp_path, fx=150.0)
    process, send, receive = node(calibration=old, white=camera.white)
    frame = send(camera, 1)
    same(receive(1), camera.decoded(frame))
    frame = send(camera, 2)  # on its way when the parameter is set
    assert user.set(NAME, calibration=str(new)) == []
    found = receive(2)
    changes = {'fx': 150.0} if found.grid.pinhole.fx == 150 else {}
    same(found, camera.decoded(frame, **changes))
    frame = send(camera, 3)
    same(receive(3), camera.decoded(frame, fx=150.0))
    assert f'decodes with calibration {new}' in process.log
    assert '[ERROR]' not in process.log


def test_what_cannot_be_used_is_refused_and_the_old_stays(tmp_path, node, user, cameras):
    camera, other = cameras(), cameras('A2')
    bad = tmp_path / 'bad'
    bad.mkdir()
    (bad / 'bad.yaml').write_text('fx: long')
    process, send, receive = node(calibration=camera.calibration(tmp_path), white=camera.white)
    refused = [
        ('calibration', bad / 'nothing.yaml', 'there is no'),
        ('calibration', bad / 'bad.yaml', 'fx: Input should be a valid number'),
        ('calibration', other.calibration(tmp_path), 'of camera A1.* is for A2'),
        ('calibration', camera.calibration(tmp_path, width=80, height=80), '80x80'),
        ('white', bad, r'no \.RAW'), ('white', bad / 'bad.yaml', r'not a \.RAW'),
        ('white', other.white, 'of camera A2, the calibration is for A1')]
    for stamp, (name, path, reason) in enumerate(refused, 1):
        told, = user.set(NAME, **{name: str(path)})
        assert re.search(reason, told), told
        frame = send(camera, stamp)
        same(receive(stamp), camera.decoded(frame))
    assert process.log.count('not changed: ') == len(refused)
    assert 'Traceback' not in process.log
    # What is refused is not remembered: the node can be configured again.
    assert all(user.change(NAME, DEACTIVATE, CLEANUP, CONFIGURE, ACTIVATE))


def test_another_camera_is_taken_over_by_setting_both_together(tmp_path, node, user, cameras):
    first, second = cameras('A1'), cameras('A2')
    _, send, receive = node(calibration=first.calibration(tmp_path), white=first.white)
    frame = send(first, 1)
    same(receive(1), first.decoded(frame))
    values = {'calibration': second.calibration(tmp_path), 'white': second.white}
    parameters = [Parameter(name, value=str(value)).to_parameter_msg()
                  for name, value in values.items()]
    answer = user.call(SetParametersAtomically, f'/{NAME}/set_parameters_atomically',
                       SetParametersAtomically.Request(parameters=parameters))
    assert answer.result.successful, answer.result.reason
    frame = send(second, 2)
    same(receive(2), second.decoded(frame))
    described = user.call(DescribeParameters, f'/{NAME}/describe_parameters',
                          DescribeParameters.Request(names=list(values)))
    assert [each.additional_constraints for each in described.descriptors] == [
        'applied at once', 'applied at once']


@pytest.fixture
def idle(cameras, tmp_path, user):
    """A function camera -> an active node in this process, spun while the user waits."""
    context = Context()
    rclpy.init(context=context)
    executor = SingleThreadedExecutor(context=context)

    def start(camera):
        node = SubapertureNode(context=context, parameter_overrides=[
            Parameter('calibration', value=str(camera.calibration(tmp_path))),
            Parameter('white', value=str(camera.white.parent))])
        executor.add_node(node)
        assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
        user.others.append(executor)
        return node

    yield start
    user.others.clear()
    for node in executor.get_nodes():
        node.close()
    executor.shutdown()
    rclpy.shutdown(context=context)


def published(publisher, message):
    """What the node then has in its history, and has not taken."""
    publisher.publish(message)
    assert publisher.wait_for_all_acked(Duration(seconds=60))


@pytest.fixture
def two_zooms(idle, user, cameras):
    """A node, two cameras of other zoom, the pupils it publishes; publishers of its input."""
    near, far = cameras(zoom=100), cameras(zoom=600)
    return (idle(near), near, far, user.listen(Image, 'views/pupil', SMALL),
            user.publisher(String, 'metadata', LATCHED), user.publisher(Image, 'image_raw', BIG))


def test_each_picture_gets_its_own_metadata(two_zooms, user):
    """Those of the next capture are there before the picture is taken."""
    node, near, far, pupils, texts, images = two_zooms
    frame = near.camera.picture(waves, header=Header(1))
    text, image = raw_frame_to_messages(frame)
    later, _ = raw_frame_to_messages(far.camera.picture(waves, header=Header(2)))
    for publisher, message in ((texts, text), (images, image), (texts, later), (texts, later)):
        published(publisher, message)
    user.wait(lambda: pupils, 'a light field')
    expected = near.decoded(frame).grid.weights
    assert not np.allclose(far.decoded(frame).grid.weights, expected)
    np.testing.assert_allclose(pupil_from(pupils[0])[..., 0], expected, atol=1e-6)
    assert node.health.errors == 0


def test_a_picture_whose_metadata_are_refused_is_dropped(two_zooms, user, capfd):
    """It gets neither those of the picture before it nor those of the next."""
    node, near, far, pupils, texts, images = two_zooms

    def sent(camera, stamp):
        frame = camera.camera.picture(waves, header=Header(stamp))
        return zip((texts, images), raw_frame_to_messages(frame), strict=True), frame

    messages, _ = sent(near, 1)
    for publisher, message in messages:
        published(publisher, message)
    user.wait(lambda: pupils, 'the former light field')
    refused, _ = sent(near, 2)
    next_, frame = sent(far, 3)
    published(texts, String(data='{'))
    published(images, dict(refused)[images])
    user.wait(lambda: node.health.dropped, 'it to be dropped')
    for publisher, message in next_:
        published(publisher, message)
    user.wait(lambda: len(pupils) == 2, 'the next light field')
    assert [header_from(each.header).stamp_ns for each in pupils] == [1, 3]
    np.testing.assert_allclose(pupil_from(pupils[1])[..., 0], far.decoded(frame).grid.weights,
                               atol=1e-6)
    assert (node.health.errors, node.health.dropped) == (1, 1)
    told, = (line for line in capfd.readouterr().err.splitlines() if 'dropped' in line)
    assert 'dropped capture 2: refused metadata: metadata is not JSON' in told


def test_a_picture_before_any_metadata_is_dropped_with_those_that_are_refused(two_zooms, user,
                                                                              capfd):
    node, near, _, pupils, texts, images = two_zooms
    text, image = raw_frame_to_messages(near.camera.picture(waves, header=Header(1)))
    published(images, image)
    user.wait(lambda: 'an image waits for metadata' in node.health.message, 'it to wait')
    published(texts, String(data='{'))
    user.wait(lambda: node.health.dropped, 'it to be dropped')
    assert 'dropped capture 1: refused metadata: ' in capfd.readouterr().err
    published(texts, text)
    image.header.stamp.nanosec = 2
    published(images, image)
    user.wait(lambda: pupils, 'a light field')
    assert header_from(pupils[0].header).stamp_ns == 2
