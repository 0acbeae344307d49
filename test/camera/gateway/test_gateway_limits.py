"""What one client can do to a gateway, and to the others: limits before a token is seen."""

import shutil
import socket
import subprocess
import sys
import threading
import tracemalloc
from contextlib import ExitStack, closing
from http.client import HTTPConnection

import pytest
import requests
from gateways import gateway_of, said
from simulated_cameras import SIDE, serving, write_captures
from waiting import eventually

from pmcl_ros.camera.gateway.connections import MAX_CONNECTIONS, MAX_OF_ONE_ADDRESS, Connections
from pmcl_ros.camera.gateway.head import LONGEST_HEAD, MOST_LINES

TOKEN = 'a-long-enough-token'
RIGHT = {'Authorization': f'Bearer {TOKEN}'}
SOON = 30.0  # s: within which others are served
STATUS = b'GET /status HTTP/1.1\r\nHost: localhost\r\n'


@pytest.fixture(scope='module')
def folder(tmp_path_factory, camera_text):
    folder = tmp_path_factory.mktemp('captures')
    write_captures(folder, camera_text(SIDE, SIDE))
    return folder


@pytest.fixture(scope='module')
def gateway(folder):
    """Whose camera is asked, and takes no pictures."""
    with gateway_of(folder, token=TOKEN) as server, pytest.MonkeyPatch.context() as patch:
        # Nobody is served since others' requests have ended.
        patch.setattr(server.connections, 'request_timeout', 10 * SOON)
        assert served(server)
        yield server


def served(gateway):
    """Whether somebody with the token has an answer soon."""
    found = requests.get(f'{gateway.url}/status', headers=RIGHT, timeout=SOON).json()
    return found['link'] == 'up'


def ended(connection):
    """Whether the other side has ended the connection."""
    try:
        connection.sendall(b'X')
    except ConnectionError:
        return True
    return False


def test_slow_requests_without_a_token_lock_nobody_out(gateway):
    with ExitStack() as opened:
        slow = [opened.enter_context(socket.create_connection(gateway.server_address[:2]))
                for _ in range(MAX_CONNECTIONS)]
        for each in slow:
            each.sendall(b'GET /status HTTP/1.1\r\nX')
        for _ in range(3):  # a byte each, while others ask
            for each in slow:
                ended(each)
            assert served(gateway)


def test_the_connection_that_waits_longest_without_a_token_makes_room(gateway):
    robot = HTTPConnection(*gateway.server_address[:2], timeout=30)

    def asked():
        robot.request('GET', '/status', headers=RIGHT)
        answer = robot.getresponse()
        return answer.status, len(answer.read()) > 0

    with ExitStack() as opened, closing(robot):
        assert asked() == (200, True)  # the oldest connection, and admitted
        used = robot.sock
        pending = [opened.enter_context(socket.create_connection(gateway.server_address[:2]))
                   for _ in range(MAX_OF_ONE_ADDRESS)]
        eventually(lambda: ended(pending[0]))
        assert asked() == (200, True)
        assert robot.sock is used
        assert not ended(pending[-1])


def test_one_address_has_its_share_and_is_the_first_to_make_room():
    kept = Connections()
    with ExitStack() as opened:
        def connected(address):
            near, far = socket.socketpair()
            opened.enter_context(far)
            return opened.enter_context(near), kept.opened(near, address)

        crowd = [connected('crowd')[0] for _ in range(MAX_OF_ONE_ADDRESS)]
        for each in crowd:
            kept.answers(each)  # at work: no room is made
        assert not connected('crowd')[1]
        several = [connected(f'{number}') for number in range(MAX_CONNECTIONS - len(crowd))]
        assert all(taken for _, taken in several)
        assert connected('another')[1]  # in place of one that waits
        with pytest.raises(ConnectionError, match='make room'):
            kept.answers(several[0][0])
        assert several[0][0].recv(1) == b''


def test_many_addresses_without_a_token_do_not_end_what_is_admitted():
    kept = Connections()
    with ExitStack() as opened:
        def connected(address):
            near, far = socket.socketpair()
            opened.enter_context(far)
            opened.enter_context(near)
            assert kept.opened(near, address)
            return near

        robot = connected('robot')
        kept.answers(robot)
        kept.reads(robot)  # it waits, and longest
        for number in range(3 * MAX_CONNECTIONS):
            connected(f'{number}')
        kept.answers(robot)


def test_a_request_that_comes_byte_by_byte_is_ended(gateway, monkeypatch):
    monkeypatch.setattr(gateway.connections, 'request_timeout', 0.3)
    with socket.create_connection(gateway.server_address[:2], timeout=30) as connection:
        eventually(lambda: ended(connection))


def test_a_connection_between_two_requests_is_ended_later(gateway, monkeypatch):
    monkeypatch.setattr(gateway.connections, 'idle_timeout', 0.3)
    with socket.create_connection(gateway.server_address[:2], timeout=30) as connection:
        connection.sendall(STATUS + f'Authorization: Bearer {TOKEN}\r\n\r\n'.encode())
        answer = b''
        while block := connection.recv(4096):
            answer += block
        assert answer.startswith(b'HTTP/1.1 200 ')
        assert b'Connection: close' not in answer


def test_headers_before_the_token_take_no_memory(gateway):
    line = b'a: ' + 64_996 * b'a' + b'\r\n'

    def flood():
        with socket.create_connection(gateway.server_address[:2], timeout=30) as connection:
            try:
                connection.sendall(STATUS)
                for _ in range(98):
                    connection.sendall(line)
                connection.sendall(b'\r\n')
                connection.recv(65536)
            except OSError:
                return  # refused long before

    threads = [threading.Thread(target=flood) for _ in range(31)]
    tracemalloc.start()
    for each in threads:
        each.start()
    assert served(gateway)
    for each in threads:
        each.join()
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()
    assert served(gateway)


@pytest.mark.parametrize('lines', [
    MOST_LINES * b'a: b\r\n', b'a: ' + LONGEST_HEAD * b'a' + b'\r\n',
    40 * (b'a: ' + 500 * b'a' + b'\r\n')])
def test_number_and_length_of_header_lines(gateway, lines):
    answer = said(gateway, STATUS + lines + b'\r\n')
    # What is left unread may reset the connection before the answer is read.
    assert answer == b'' or answer.startswith(b'HTTP/1.1 431 ')


@pytest.mark.parametrize('head', [
    b'Host: localhost\r\nContent-Length : 50\r\n', b'Host: localhost\r\nContent-Length\r\n',
    b'Host: localhost\r\nno colon here\r\n', b'Host: localhost\r\n: value\r\n',
    b'Host: localhost\r\na: b\r\n folded: c\r\n', b'Host: localhost\r\na: b\rc: d\r\n',
    b'Host: localhost\r\na\0: b\r\n', b'Host: localhost\r\na: \xff\r\n', b'',
    b'Host: localhost\r\nHost: localhost\r\n', b'Host: localhost\r\nHost: evil\r\n',
])
def test_headers_that_others_may_read_in_another_way_end_the_connection(gateway, head):
    body = STATUS + f'Authorization: Bearer {TOKEN}\r\n\r\n'.encode()
    answer = said(gateway, b'GET /status HTTP/1.1\r\n' + head
                  + f'Authorization: Bearer {TOKEN}\r\n\r\n'.encode() + body)
    assert answer.startswith(b'HTTP/1.1 400 ') or answer == b''
    assert answer.count(b'HTTP/1.1') <= 1


def test_who_shows_no_token_is_answered_once(gateway):
    answer = said(gateway, 3 * (STATUS + b'\r\n'))
    assert answer.count(b'HTTP/1.1') == 1
    assert answer.startswith(b'HTTP/1.1 401 ')
    assert b'Connection: close' in answer



# In a mount namespace of its own: a disk with room for two pictures, and a gateway on it.
SMALL_DISK = """
mount -t tmpfs -o size={size} none "$1" && exec "$2" -m pmcl_ros.cli camera gateway \
    --host 127.0.0.1 --port 0 --camera "$3" --cache "$1"
"""


def can_mount():
    return shutil.which('unshare') is not None and subprocess.run(
        ['unshare', '-Urm', 'mount', '-t', 'tmpfs', 'none', '/mnt'],
        capture_output=True, check=False).returncode == 0


@pytest.mark.skipif(not can_mount(), reason='no mount namespaces here')
def test_on_a_full_disk_the_oldest_pictures_go(folder, tmp_path):
    raws = [path.read_bytes() for path in sorted(folder.rglob('*.RAW'))]
    script = SMALL_DISK.format(size=f'{8 * 4096}')  # a picture and its text take four pages
    with serving(folder) as camera, subprocess.Popen(
            ['unshare', '-Urm', 'sh', '-c', script, 'sh', tmp_path, sys.executable, camera.text],
            stdout=subprocess.PIPE, text=True) as gateway:
        try:
            url = gateway.stdout.readline().split()[-1]
            pictures = requests.get(f'{url}/pictures', timeout=30).json()
            for index in (0, 1, 2, 0, 1, 2):
                answer = requests.get(f'{url}/pictures/{pictures[index]["id"]}/raw', timeout=30)
                assert (answer.status_code, answer.content) == (200, raws[index])
        finally:
            gateway.terminate()
