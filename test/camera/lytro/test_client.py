"""The client with a simulated camera, over real sockets."""

import json
import logging
import os
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
from simulated_cameras import (
    QUICK,
    SIDE,
    callbacks_that_can_be_cut,
    client_of,
    in_thread,
    serving,
    write_captures,
)
from waiting import eventually

from pmcl_ros.camera.client import CameraClient, Picture
from pmcl_ros.camera.files import read_picture
from pmcl_ros.camera.lytro import protocol
from pmcl_ros.camera.lytro.address import Address
from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.camera.lytro.link import Link
from pmcl_ros.camera.lytro.protocol import Command, Request, decode_time, encode_time
from pmcl_ros.camera.simulated.camera import SimulatedCamera
from pmcl_ros.camera.simulated.card import Card
from pmcl_ros.camera.simulated.server import CameraServer
from pmcl_ros.runtime.errors import CameraError, LinkError, SettingsError

ROOT = Path(__file__).parents[3]
SECOND = 1_000_000_000


@pytest.fixture
def captures(tmp_path, camera_text):
    return tmp_path, write_captures(tmp_path, camera_text(SIDE, SIDE))


@pytest.fixture
def client(captures):
    with client_of(captures[0]) as client:
        yield client


def test_who_the_camera_is(client):
    same: CameraClient = client
    status = same.status()
    assert status.battery == 87.5
    assert (status.serial, status.firmware) == (client.hardware_info().serial,
                                                client.hardware_info().software)


def test_a_picture_is_taken_and_fetched(client, captures, camera_text):
    old = client.pictures()
    before = time.time_ns()
    picture = client.capture()
    assert before <= picture.shutter_ns <= time.time_ns()
    assert client.pictures() == [*old, picture]
    progress = []
    raw, text = client.fetch(picture, lambda *each: progress.append(each))
    assert (raw, text) == (captures[1][0], camera_text(SIDE, SIDE))
    assert progress[-1] == (len(raw), len(raw))
    assert client.fetch(old[2])[0] == captures[1][2]


def test_the_time_of_the_shutter_is_not_that_of_the_arrival(captures):
    heard = QUICK.model_copy(update={'watchdog': 60})  # also on a busy machine
    with client_of(captures[0], delay=1.0, settings=heard) as client:
        shot = client.take_picture()
        deadline = time.monotonic() + 60
        while shot.pressed_ns is None:  # on a busy machine the list can show the picture first
            assert time.monotonic() < deadline
            time.sleep(0.01)
        picture = client.wait_for_picture(shot)
        assert time.time_ns() - picture.shutter_ns > SECOND // 2
        assert shot.sent_ns < picture.shutter_ns == shot.pressed_ns


def test_a_picture_that_another_client_takes_is_noticed(captures):
    with serving(captures[0]) as address, LytroClient(address, QUICK) as one, \
            LytroClient(address, QUICK) as other:
        picture = one.capture()
        eventually(lambda: picture.id in [each.id for each in other.pictures()])
        assert abs(other.pictures()[-1].shutter_ns - picture.shutter_ns) < 5 * SECOND


def test_pictures_before_it_came_have_the_date_of_this_hosts_clock(captures):
    with serving(captures[0]) as address:
        link = Link(address, QUICK)
        link.ask(Request(Command.SET_TIME, encode_time(datetime(2013, 1, 1, tzinfo=timezone.utc))))
        link.close()
        with LytroClient(address, QUICK) as first:
            assert first.camera_time().year == 2013
            picture = first.capture()
            assert first.records()[0].date.startswith('2013-01-01')
        with LytroClient(address, QUICK) as second:
            assert abs(second.pictures()[-1].shutter_ns - picture.shutter_ns) < 60 * SECOND


def test_a_clock_that_is_set_to_its_end_stands_still(captures):
    end = datetime(9999, 12, 31, 23, 59, 59, tzinfo=timezone.utc)
    with serving(captures[0]) as address:
        link = Link(address, QUICK)
        link.ask(Request(Command.SET_TIME, encode_time(end)))
        assert decode_time(link.ask_once(protocol.CAMERA_TIME)) >= end
        assert link.made == 1  # the connection was kept
        link.close()
        with LytroClient(address, QUICK) as client:
            before = time.time_ns()
            assert before < client.capture().shutter_ns < time.time_ns()


def test_the_clock(client):
    assert abs(client.camera_time() - datetime.now(timezone.utc)) < timedelta(seconds=60)


def test_a_picture_is_deleted(client):
    first, second, third = client.pictures()
    client.delete(second)
    assert client.pictures() == [first, third]
    for again in (client.delete, client.fetch):
        with pytest.raises(CameraError, match=f'no picture {second.id}'):
            again(second)


def test_files_and_calibration(client, captures):
    assert client.download(r'i:\dcim\100photo\img_0002.raw') == captures[1][1]
    assert list(client.calibration()) == ['C:\\T1CALIB\\MLACALIBRATION.TXT']
    with pytest.raises(CameraError, match=r'the camera has no C:\\NOTHING'):
        client.download('C:\\NOTHING')
    with pytest.raises(CameraError, match='no picture sha1-x'):
        client.fetch(Picture('sha1-x', 0))


def test_pictures_that_are_no_pictures(captures):
    folder, _ = captures
    with client_of(folder) as client:
        (folder / 'capture0' / 'IMG.RAW').write_bytes(b'too short')
        with pytest.raises(CameraError, match=r'IMG_0001\.RAW has 9 bytes, expected 6144'):
            client.fetch(client.pictures()[0])


@pytest.mark.parametrize('heard', [False, True])
def test_what_was_taken_while_the_callbacks_were_lost_is_found(captures, heard):
    with serving(captures[0], delay=0.3) as address, \
            callbacks_that_can_be_cut(address) as (relayed, cut), \
            LytroClient(relayed, QUICK) as client:
        if not heard:
            cut()
        shot = client.take_picture()
        cut()
        picture = client.wait_for_picture(shot)
        assert picture.shutter_ns in (shot.sent_ns, shot.pressed_ns)
        assert client.pictures()[-1] == picture


def test_a_camera_that_comes_back(captures):
    with serving(captures[0]) as address:
        settings = QUICK.model_copy(update={'patience': 0.2})
        client = LytroClient(address, settings)
        known = client.pictures()
    with client:
        with pytest.raises(LinkError, match='no camera answers'):
            client.battery()
        again = CameraServer(SimulatedCamera(Card.from_folder(captures[0]), delay=0),
                             port=address.port, callback_port=address.callback_port)
        with in_thread(again):
            assert client.pictures() == known
            assert client.fetch(client.capture())[0] == captures[1][0]


def test_a_picture_is_taken_though_the_connection_had_died_unnoticed(captures):
    with ExitStack() as stack:
        with serving(captures[0]) as address:
            client = stack.enter_context(LytroClient(address, QUICK))
        stack.enter_context(serving(captures[0], at=address))
        assert client.fetch(client.capture())[0] == captures[1][0]


def test_the_camera_is_kept_awake(captures, caplog):
    caplog.set_level(logging.DEBUG, 'pmcl_ros.camera.simulated.server')
    settings = QUICK.model_copy(update={'keep_alive': 0.1})
    with client_of(captures[0], settings=settings):
        eventually(lambda: caplog.text.count('C606') >= 3)  # nobody asked for the battery


def test_closing_leaves_no_thread_and_no_descriptor(captures):
    def threads():
        """But for those of asyncio, which the simulated camera keeps."""
        return {each for each in threading.enumerate() if not each.name.startswith('asyncio')}

    with serving(captures[0]) as address:
        before, descriptors = threads(), len(os.listdir('/proc/self/fd'))
        with LytroClient(address, QUICK) as client:
            client.capture()
        for _ in range(5):
            with LytroClient(address, QUICK) as client:
                client.battery()
            with pytest.raises(LinkError, match='is closed'):
                client.battery()
        # The server's side ends a tick later.
        eventually(lambda: threads() <= before)
        eventually(lambda: len(os.listdir('/proc/self/fd')) <= descriptors)


def test_who_waits_for_a_picture_is_told_when_the_client_is_closed(captures):
    with serving(captures[0], empty=True, delay=3600) as address:
        client = LytroClient(address, QUICK.model_copy(update={'picture_timeout': 3600}))
        problems = []

        def wait():
            with pytest.raises(LinkError) as caught:
                client.capture()
            problems.append(str(caught.value))

        thread = threading.Thread(target=wait, daemon=True)
        with socket.create_connection((address.host, address.callback_port), 60) as callbacks:
            heard = callbacks.recv(4096)  # a heartbeat: the camera knows this connection
            thread.start()
            while b'ShutterPressed' not in heard:
                heard += callbacks.recv(4096)
        client.close()
        thread.join(60)
        assert ['is closed' in each for each in problems] == [True]


def test_another_camera_at_the_same_address_is_not_taken_for_the_first(tmp_path, camera_text):
    frame = {'metadata': json.loads(camera_text(SIDE, SIDE)),
             'privateMetadata': {'camera': {'serialNumber': 'A000000002'}}}
    other = {'master': {'picture': {'frameArray': [{'frame': frame}]}}}
    write_captures(tmp_path / 'first', camera_text(SIDE, SIDE))
    write_captures(tmp_path / 'other', json.dumps(other))
    with ExitStack() as stack:
        with serving(tmp_path / 'first') as address:
            client = stack.enter_context(LytroClient(address, QUICK))
            pictures = client.pictures()
        with serving(tmp_path / 'other', at=address), pytest.raises(LinkError, match='A000000002'):
            client.pictures()
        with serving(tmp_path / 'first', at=address):
            assert len(client.pictures()) == len(pictures)


def test_a_picture_of_full_size_over_a_link_that_drops(tmp_path):
    white = ROOT / 'config' / 'cameras' / 'demo_white.RAW.xz'
    for each in (white, white.with_name('demo_white.TXT')):
        (tmp_path / each.name).symlink_to(each)
    expected = read_picture(white)
    with client_of(tmp_path, 'drop-random=5MB:1') as client:
        assert client.fetch(client.capture()) == expected


def test_two_clients_fetch_two_pictures_at_once(tmp_path, camera_text):
    raws = write_captures(tmp_path, camera_text(2000, 2000), 2, 2000)
    with serving(tmp_path, 'slow=20MB/s') as address, ExitStack() as stack:
        clients = [stack.enter_context(LytroClient(address, QUICK)) for _ in raws]
        pictures = clients[0].pictures()
        with ThreadPoolExecutor(len(raws)) as pool:
            fetched = [*pool.map(LytroClient.fetch, clients, pictures)]
    assert [raw for raw, _ in fetched] == raws


def test_no_camera_there():
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(LinkError, match=r'network lytro\.camera\.NNN'):
        LytroClient(Address(host='127.0.0.1', port=port), QUICK.model_copy(
            update={'patience': 0.1}))


def test_a_camera_without_callbacks(captures):
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    with serving(captures[0]) as address, pytest.raises(LinkError, match=f'answers at .*:{port}'):
        LytroClient(address.model_copy(update={'callback_port': port}), QUICK)


@pytest.mark.parametrize(('text', 'values'), [
    ('10.100.1.1', ('10.100.1.1', 5678, 5677)), ('cam.local:1', ('cam.local', 1, 5677)),
    ('[::1]:1:2', ('::1', 1, 2)), ('[::1]', ('::1', 5678, 5677))])
def test_addresses(text, values):
    address = Address.parse(text)
    assert (address.host, address.port, address.callback_port) == values
    assert Address.parse(address.text) == address


@pytest.mark.parametrize('text', ['', ':', 'a:b', 'a:1:2:3', 'a:70000', '::1', 'a:0', '[]:1'])
def test_no_addresses(text):
    with pytest.raises(SettingsError):
        Address.parse(text)
