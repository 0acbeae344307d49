"""The server under clients that misbehave."""

import socket
import struct
from contextlib import closing

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from simulated_cameras import QUICK, SIDE, in_thread, serving, write_captures

from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.camera.lytro.link import Link
from pmcl_ros.camera.lytro.protocol import Command, Request, load_file
from pmcl_ros.camera.simulated.camera import SimulatedCamera
from pmcl_ros.camera.simulated.card import Card
from pmcl_ros.camera.simulated.server import CameraServer
from pmcl_ros.runtime.errors import CameraError

FRAME = st.builds(
    lambda length, flags, group, sub, rest, payload: struct.pack(
        '<IIIBBB13s', 0xFAAA55AF, length, flags, group, 0, sub, rest) + payload,
    st.integers(0, 40) | st.just(2**32 - 1), st.integers(0, 3), st.integers(0xC0, 0xC7),
    st.integers(0, 16) | st.sampled_from([0xFE, 0xFF]), st.binary(max_size=13),
    st.binary(max_size=40))


@pytest.fixture(scope='module')
def address(tmp_path_factory, camera_text):
    folder = tmp_path_factory.mktemp('captures')
    write_captures(folder, camera_text(SIDE, SIDE))
    with serving(folder) as address:
        yield address


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(FRAME | st.binary(max_size=60), min_size=1, max_size=8))
def test_whatever_a_client_sends_the_camera_serves_the_next(address, messages):
    with socket.create_connection((address.host, address.port), 60) as connected:
        try:
            connected.sendall(b''.join(messages))
            connected.shutdown(socket.SHUT_WR)
            while connected.recv(65536):
                pass  # the camera closes, after all it could answer
        except ConnectionError:
            pass
    with socket.create_connection((address.host, address.port), 60) as connected:
        connected.sendall(bytes.fromhex('AF55AAFA 04000000 01000000 C600 06' + '00' * 13))
        data = b''
        while len(data) < 32:
            data += connected.recv(32)
        assert data[28:] == bytes.fromhex('0000AF42')


def test_a_request_with_gigabytes_of_payload_is_refused(address):
    with socket.create_connection((address.host, address.port), 60) as connected:
        connected.sendall(bytes.fromhex('AF55AAFA FFFFFFFF 00000000 C200 01' + '00' * 13))
        assert connected.recv(1) == b''


def test_connections_that_are_left_open_do_not_stop_others(address):
    idle = [socket.create_connection((address.host, address.port), 60) for _ in range(10)]
    idle += [socket.create_connection((address.host, address.callback_port), 60)
             for _ in range(10)]
    with LytroClient(address, QUICK) as client:
        client.capture()
    for each in idle:
        each.close()


def test_a_port_that_is_taken_is_told(address, tmp_path, camera_text):
    write_captures(tmp_path, camera_text(SIDE, SIDE), 1)
    camera = SimulatedCamera(Card.from_folder(tmp_path))
    with pytest.raises(CameraError, match=rf'cannot listen at 127.0.0.1:{address.port} \(Addr'):
        CameraServer(camera, port=address.port, callback_port=0)
    with pytest.raises(CameraError, match=r'cannot listen at no\.such\.host'):
        CameraServer(camera, 'no.such.host', 0, 0)


def test_the_second_port_takes_commands_too(tmp_path, camera_text):
    write_captures(tmp_path, camera_text(SIDE, SIDE), 1)
    with socket.create_server(('127.0.0.1', 0)) as free:
        second = free.getsockname()[1]
    server = CameraServer(SimulatedCamera(Card.from_folder(tmp_path)), port=0, callback_port=0,
                          second_port=second)
    with in_thread(server) as address:
        other = address.model_copy(update={'port': second})
        with LytroClient(address, QUICK) as one, LytroClient(other, QUICK) as two:
            assert one.records() == two.records()
    with pytest.raises(OSError, match='refused'):  # closed when it ends
        socket.create_connection((address.host, address.port), 1)


def test_pictures_that_vanish_from_this_disk_are_not_found(tmp_path, camera_text):
    write_captures(tmp_path, camera_text(SIDE, SIDE), 2)
    with serving(tmp_path) as address, LytroClient(address, QUICK) as client:
        (tmp_path / 'capture0' / 'IMG.RAW').unlink()
        first, second = client.pictures()
        with pytest.raises(CameraError, match=r'the camera has no I:\\DCIM\\100PHOTO\\IMG_0001'):
            client.fetch(first)
        client.fetch(second)


def test_a_client_that_names_no_offset_gets_the_first_bytes_each_time(tmp_path, camera_text):
    raw, = write_captures(tmp_path, camera_text(SIDE, SIDE), 1)
    with serving(tmp_path) as address, closing(Link(address, QUICK)) as link:
        link.ask(load_file(r'I:\DCIM\100PHOTO\IMG_0001.RAW'))
        part = Request(Command.DOWNLOAD, room=1000)
        assert link.ask_once(part) == link.ask_once(part) == raw[:1000]
