"""The driver and its camera, over real sockets: every picture is published, once, intact."""

import socket
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from gateways import gateway_of
from harness import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, Process
from lifecycle_msgs.msg import State, Transition
from sensor_msgs.msg import Image
from simulated_cameras import SIDE, replies_that_can_be_held, serving, write_captures
from std_msgs.msg import String
from std_srvs.srv import Trigger

from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.camera.packing import pack12
from pmcl_ros.camera.simulated.server import served
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.raw_frame import counts_from
from pmcl_ros.nodes.runtime.base import LATCHED, SMALL

DRIVER = 'pmcl_ros.nodes.lytro_driver'
SHUTDOWN = Transition.TRANSITION_ACTIVE_SHUTDOWN


@pytest.fixture
def card(tmp_path, camera_text):
    """A folder of three pictures, and their bytes."""
    return tmp_path / 'card', write_captures(tmp_path / 'card', camera_text(SIDE, SIDE))


@pytest.fixture
def driver(tmp_path, user):
    """A function of parameters -> the driver's process, active; ended after the test."""
    processes = []

    def start(**params):
        processes.append(Process(tmp_path, DRIVER, params=params))
        assert user.change('lytro_driver', CONFIGURE, ACTIVATE) == [True, True], processes[0].log
        return processes[0]

    yield start
    for process in processes:
        with process:
            pass


def capture(user):
    return user.call(Trigger, '/lytro_driver/capture', Trigger.Request())


def raw_of(image):
    return pack12(counts_from(image))


def stamp_of(message):
    return header_from(message.header).stamp_ns


def told(user, states, key, value=''):
    """Wait until the driver's diagnostics say so."""
    def says():
        return any(each.key == key and each.value.startswith(value)
                   for state in states for status in state.status for each in status.values
                   if each.value)
    user.wait(says, f'{key} {value}')


def test_trigger_callback_download_image(card, driver, user):
    folder, raws = card
    with serving(folder, empty=True, delay=0.3) as address:
        driver(address=address.text)
        images = user.listen(Image, 'image_raw', SMALL)
        texts = user.listen(String, 'metadata', LATCHED)
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
        before = time.time_ns()
        answer = capture(user)
        after = time.time_ns()
        assert answer.success, answer.message
        user.wait(lambda: images and texts, 'the picture')
        assert raw_of(images[0]) == raws[0]
        assert str(stamp_of(images[0])) in answer.message
        # The shutter's time: the picture came 0.3 s later.
        assert before < stamp_of(images[0]) < after - 0.25e9
        for key, value in (('source', 'wifi'), ('battery [%]', '88'), ('firmware', ''),
                           ('link', 'up'), ('last download [s]', '0.'),
                           ('last download [MB/s]', '')):
            told(user, states, key, value)
        assert states[-1].status[0].hardware_id


def test_a_picture_taken_by_hand_is_published_also_when_the_node_was_inactive(card, driver, user):
    folder, raws = card
    with serving(folder) as address, LytroClient(address) as hand:
        driver(address=address.text)
        images = user.listen(Image, 'image_raw', SMALL)
        first = hand.capture()
        user.wait(lambda: images, 'the first picture')
        assert user.change('lytro_driver', DEACTIVATE)
        second = hand.capture()
        assert user.change('lytro_driver', ACTIVATE)
        user.wait(lambda: len(images) == 2, 'the second picture')
        assert [stamp_of(each) for each in images] == sorted(map(stamp_of, images))
        assert [raw_of(each) for each in images] == raws[:2]
        assert first != second
        # None of those that were on the card before.
        assert capture(user).success
        user.wait(lambda: len(images) == 3, 'the third')
        assert raw_of(images[2]) == raws[2]


def test_the_node_answers_while_a_picture_is_on_its_way(card, driver, user):
    folder, raws = card
    with serving(folder, empty=True) as camera, \
            replies_that_can_be_held(camera) as (address, go):
        driver(address=address.text, patience=3600.0)
        images = user.listen(Image, 'image_raw', SMALL)
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
        client = user.node.create_client(Trigger, '/lytro_driver/capture')
        user.wait(client.service_is_ready, 'the service')
        user.meet('lytro_driver')
        go.clear()
        answer = client.call_async(Trigger.Request())
        count = len(states)
        user.wait(lambda: len(states) > count + 1, 'diagnostics meanwhile')
        assert user.state('lytro_driver') == State.PRIMARY_STATE_ACTIVE
        assert not answer.done()
        assert not images
        go.set()
        user.wait(answer.done, 'the answer')
        assert answer.result().success, answer.result().message
        user.wait(lambda: images, 'the picture')
        assert raw_of(images[0]) == raws[0]


def test_many_captures_over_a_link_that_drops(card, driver, user):
    folder, raws = card
    with serving(folder, 'drop-random=20kB:3', empty=True) as address:
        process = driver(address=address.text)
        images = user.listen(Image, 'image_raw', SMALL)
        count = 12
        for number in range(count):
            answer = capture(user)
            assert answer.success, answer.message
            user.wait(lambda number=number: len(images) > number, f'picture {number}')
        assert [raw_of(each) for each in images] == [raws[n % len(raws)] for n in range(count)]
        assert len({stamp_of(each) for each in images}) == count
        assert process.alive()


def test_a_camera_that_is_gone_is_told_and_used_again_when_it_is_back(card, driver, user):
    folder, raws = card
    with served(folder, '--empty') as (address, camera):
        process = driver(address=address.text, patience=2.0)
        images = user.listen(Image, 'image_raw', SMALL)
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
        camera.kill()
        camera.wait()
        answer = capture(user)
        assert not answer.success
        assert str(address) in answer.message
        told(user, states, 'link', 'lost')
    with serving(folder, empty=True, at=address):
        states.clear()
        told(user, states, 'link', 'up')
        assert capture(user).success
        user.wait(lambda: images, 'a picture')
        assert raw_of(images[0]) == raws[0]
        assert process.alive()


@pytest.mark.parametrize(('fault', 'first', 'second'), [
    ('drop-after=3kB', '', ''),
    ('slow=20kB/s', '', ''),
    ('short-chunks=500B', '', ''),
    ('garbage-header=10', '', ''),
    ('busy', 'it is busy', ''),
    ('card-full=1', '', 'its memory is full'),
    ('card-full', 'its memory is full', 'its memory is full')])
def test_each_fault_ends_with_the_picture_or_the_reason(card, driver, user, fault, first, second):
    folder, raws = card
    with serving(folder, fault, empty=True) as address:
        # Where each capture brings a picture there is no limit that a busy machine may exceed.
        process = driver(address=address.text, picture_timeout=4.0 if first or second else 60.0)
        images = user.listen(Image, 'image_raw', SMALL)
        count = 0
        for reason in (first, second):
            answer = capture(user)
            assert answer.success == (not reason), answer.message
            assert reason in answer.message
            count += answer.success
            user.wait(lambda count=count: len(images) >= count, 'the picture')
        assert [raw_of(each) for each in images] == raws[:count]
        assert process.alive()


def test_gateway(card, driver, user):
    folder, raws = card
    with gateway_of(folder, empty=True) as server:
        driver(source='gateway', gateway=server.url)
        images = user.listen(Image, 'image_raw', SMALL)
        before = time.time_ns()
        answer = capture(user)
        assert answer.success, answer.message
        user.wait(lambda: images, 'the picture')
        assert raw_of(images[0]) == raws[0]
        assert before < stamp_of(images[0]) < time.time_ns()


def test_a_camera_that_is_silent_at_times(card, driver, user):
    folder, raws = card
    with serving(folder, 'silence=11', empty=True) as address:
        process = driver(address=address.text, picture_timeout=10.0)
        images = user.listen(Image, 'image_raw', SMALL)
        answers = [capture(user) for _ in range(3)]
        taken = [each for each in answers if each.success]
        assert taken
        # Where the very command was not answered no picture was taken.
        assert all('did not press the shutter' in each.message
                   for each in answers if not each.success)
        user.wait(lambda: len(images) >= len(taken), 'the pictures')
        assert [raw_of(each) for each in images] == raws[:len(taken)]
        assert process.alive()


@pytest.mark.parametrize('transitions', [(DEACTIVATE, CLEANUP), (SHUTDOWN,), ()])
def test_the_node_leaves_while_a_picture_is_awaited(card, tmp_path, user, transitions):
    folder, _ = card
    # The picture never comes: nobody may wait for it.
    with serving(folder, empty=True, delay=3600) as address, \
            Process(tmp_path, DRIVER, params={'address': address.text,
                                              'picture_timeout': 3600.0}) as process:
        assert user.change('lytro_driver', CONFIGURE, ACTIVATE) == [True, True], process.log
        client = user.node.create_client(Trigger, '/lytro_driver/capture')
        user.wait(client.service_is_ready, 'the service')
        user.meet('lytro_driver')
        with socket.create_connection((address.host, address.callback_port), 60) as callbacks:
            heard = callbacks.recv(4096)  # a heartbeat: the camera knows this connection
            answer = client.call_async(Trigger.Request())
            while b'ShutterPressed' not in heard:
                user.wait(lambda: True, 'the request to be sent')
                heard += callbacks.recv(4096)
        for each in transitions:
            assert user.change('lytro_driver', each)
        if transitions:
            user.wait(answer.done, 'the answer')
            assert not answer.result().success
    assert 'Traceback' not in process.log


def test_a_picture_that_came_damaged_is_read_again(card, driver, user):
    folder, raws = card
    path = folder / 'capture0' / 'IMG.RAW'
    path.write_bytes(raws[0][:100])
    process = driver(source='files', path=str(folder))
    images = user.listen(Image, 'image_raw', SMALL)
    answer = capture(user)
    assert not answer.success
    assert 'will be tried again' in answer.message
    path.write_bytes(raws[0])
    user.wait(lambda: images or 'given up' in process.log, 'the picture')
    assert capture(user).success
    user.wait(lambda: len(images) == 2 or 'given up' in process.log, 'the next')
    assert [raw_of(each) for each in images] == raws[:2]


def test_what_nobody_received_is_not_deleted(card, driver, user):
    folder, _ = card
    with serving(folder, empty=True) as address, LytroClient(address) as hand:
        process = driver(address=address.text, delete=True)
        assert capture(user).success
        assert len(hand.records()) == 1
        assert 'nobody received it' in process.log
        images = user.listen(Image, 'image_raw', SMALL)
        assert capture(user).success
        user.wait(lambda: images, 'the picture')
        assert [each.number for each in hand.records()] == [1]


def test_no_camera_is_told_when_configured(tmp_path, user):
    with Process(tmp_path, DRIVER, params={'address': '127.0.0.1:9', 'patience': 1.0}) as process:
        assert not user.change('lytro_driver', CONFIGURE)
        assert '127.0.0.1:9' in process.log
        assert 'not active' in capture(user).message
        assert process.alive()
