"""A broken message is told, counted and survived by every node; a good one after it works."""

from array import array

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from harness import ACTIVATE, CONFIGURE, Process
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32MultiArray, String
from synthetic_camera import SIDE

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.light_field import light_field_to_messages
from pmcl_ros.messages.raw_frame import counts_from, raw_frame_to_messages
from pmcl_ros.messages.volume import volume_from, volume_to_message
from pmcl_ros.nodes.runtime.base import BIG, LATCHED, SMALL


@pytest.fixture
def start(tmp_path, user, parameters):
    """A function name -> the node's process, active; ended after the test."""
    started = []

    def start(name, **changes):
        process = Process(tmp_path, f'pmcl_ros.nodes.{name}', params=parameters[name] | changes)
        started.append(process)
        assert user.change(name, CONFIGURE, ACTIVATE) == [True, True], process.log
        return process

    yield start
    for process in started:
        with process:
            pass


def copy(message):
    """The same message with data of its own."""
    from rclpy.serialization import deserialize_message
    return deserialize_message(serialize_message(message), type(message))


def broken_images(good):
    """Images of the wrong encoding, too short, empty, and of the wrong step."""
    encoding, short, empty, step = (copy(good) for _ in range(4))
    encoding.encoding = 'mono8'
    short.data = short.data[:-4]
    empty.data, empty.width, empty.height = array('B'), 0, 0
    step.step += 2
    return [(encoding, "encoding is 'mono8'"), (short, 'bytes of data'),
            (empty, 'at least one pixel'), (step, 'in rows of')]


def broken_volumes(good):
    """Volumes with an empty layout, NaN, less data than the layout says, and wrong strides."""
    nan, short, strides = (copy(good) for _ in range(3))
    nan.data[-1] = float('nan')
    short.data = short.data[:-1]
    strides.layout.dim[1].stride -= 1
    return [(Float32MultiArray(), '0 dimensions'), (nan, 'NaN or infinity'),
            (short, 'values for sizes'), (strides, 'strides')]


def send(user, process, publisher, message, reason):
    """Publish, and wait until the node has told what is wrong."""
    before = len(process.log)

    def told():
        *lines, _ = process.log[before:].split('\n')  # whole ones
        return [line for line in lines if '[ERROR]' in line]

    publisher.publish(message)
    error, = user.wait(told, f'{reason!r} to be told')
    assert reason in error, process.log
    assert 'Traceback' not in process.log
    assert process.alive()


def test_driver_tells_of_a_picture_it_cannot_read(start, user, tmp_path, camera_text):
    from std_srvs.srv import Trigger
    folder = tmp_path / 'pictures'
    folder.mkdir()
    text = camera_text(SIDE, SIDE)
    for name in ('A', 'B'):
        (folder / f'{name}.TXT').write_text(text)
    (folder / 'A.RAW').write_bytes(b'short')
    (folder / 'B.RAW').write_bytes(bytes(SIDE * SIDE * 3 // 2))
    process = start('lytro_driver', path=str(folder))
    images = user.listen(Image, 'image_raw', BIG)
    texts = user.listen(String, 'metadata', LATCHED)

    def capture():
        return user.call(Trigger, '/lytro_driver/capture', Trigger.Request())

    first = capture()
    assert not first.success
    assert 'A.RAW' in first.message
    assert 'holds 5 bytes' in first.message
    second = capture()
    assert second.success, second.message
    user.wait(lambda: images and texts, 'image and metadata')
    assert texts[0].data == text
    assert counts_from(images[0]).shape == (SIDE, SIDE)
    assert str(header_from(images[0].header).stamp_ns) in second.message
    assert 'are published; set loop' in capture().message
    assert process.alive()


@pytest.mark.parametrize('loop', [True, False])
def test_driver_publishes_by_itself(start, user, loop):
    messages = []
    user.node.create_subscription(String, 'metadata', messages.append, LATCHED)
    process = start('lytro_driver', period=0.1, loop=loop)
    if loop:
        user.wait(lambda: len(messages) >= 3, 'three pictures')
    else:
        user.wait(lambda: messages and 'all 1 pictures of' in process.log, 'the end')
        assert len(messages) == 1


def test_subaperture_node_survives_broken_images(start, user, parameters):
    process = start('subaperture_node')
    frame = read_raw_frame(parameters['lytro_driver']['path'], Header(77))
    metadata, good = raw_frame_to_messages(frame)
    images = user.publisher(Image, 'image_raw', BIG)
    texts = user.publisher(String, 'metadata', LATCHED)
    send(user, process, texts, String(data='{'), 'metadata is not JSON')
    for message, reason in broken_images(good):
        send(user, process, images, message, reason)
    pictures = user.listen(Image, 'center/image', SMALL)
    images.publish(good)
    user.wait(lambda: 'dropped capture 77: refused metadata: ' in process.log,
              'the image to be dropped')
    texts.publish(metadata)
    user.delivered(texts)
    good.header.stamp.nanosec = 78
    images.publish(good)
    user.wait(lambda: pictures, 'a centre picture')
    assert header_from(pictures[0].header).stamp_ns == 78
    assert pictures[0].width == pictures[0].height == SIDE // 10


def test_dlv_node_survives_broken_views(start, user, small_light_field):
    process = start('dlv_node', views=3)
    info, pupil, views = light_field_to_messages(small_light_field)
    publishers = [user.publisher(CameraInfo, 'views/camera_info', SMALL),
                  user.publisher(Image, 'views/pupil', SMALL),
                  user.publisher(Image, 'views', BIG)]
    volumes = user.listen(Float32MultiArray, 'dlv', BIG)
    for message, reason in broken_images(views):
        send(user, process, publishers[2], message, reason)
    dark = copy(pupil)
    np.frombuffer(dark.data, np.float32)[0] = np.nan
    send(user, process, publishers[1], dark, 'views/pupil holds NaN')
    send(user, process, publishers[0], CameraInfo(), 'impossible camera')
    for publisher, message in zip(publishers, (info, pupil, views), strict=True):
        publisher.publish(message)
    user.wait(lambda: volumes, 'a volume')
    volume = volume_from(volumes[0])
    assert volume.header == small_light_field.header
    assert volume.likelihood.shape == (40, 48, 16)
    assert len(volumes) == 1


def test_dlv_node_pairs_captures_that_come_mixed(start, user, small_light_field):
    from dataclasses import replace
    process = start('dlv_node', views=3)
    publishers = [user.publisher(CameraInfo, 'views/camera_info', SMALL),
                  user.publisher(Image, 'views/pupil', SMALL),
                  user.publisher(Image, 'views', BIG)]
    volumes = user.listen(Float32MultiArray, 'dlv', BIG)
    one, two = (light_field_to_messages(replace(small_light_field, header=Header(stamp)))
                for stamp in (10, 20))
    publishers[0].publish(one.camera_info)
    publishers[0].publish(two.camera_info)
    user.delivered(publishers[0])  # so that capture 10 begins before 20 is complete
    publishers[1].publish(two.pupil)
    publishers[2].publish(two.views)
    user.wait(lambda: volumes, 'a volume')
    assert volume_from(volumes[0]).header.stamp_ns == 20
    assert 'dropped capture 10: no views/pupil or views came with it' in process.log


def test_pmcl_node_survives_broken_volumes(start, user, small_volume):
    process = start('pmcl_node', mode='faithful', faithful_iterations=1)
    publisher = user.publisher(Float32MultiArray, 'dlv', BIG)
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    good = volume_to_message(small_volume)
    for message, reason in broken_volumes(good):
        send(user, process, publisher, message, reason)

    def values():
        return {each.key: each.value for each in states[-1].status[0].values}

    user.wait(lambda: states and values()['errors'] == '4', 'four errors')
    assert states[-1].status[0].level == DiagnosticStatus.ERROR
    assert 'strides' in values()['last error']
    publisher.publish(good)
    user.wait(lambda: 'capture 1700000000000000001' in states[-1].status[0].message, 'a search')
    assert states[-1].status[0].level in (DiagnosticStatus.OK, DiagnosticStatus.WARN)
