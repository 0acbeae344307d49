"""A robot's side: gateway and simulated camera behind real, breaking connections."""

import base64
import hashlib
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import pytest
from gateways import CuttingProxy, gateway_of, gateway_to
from hypothesis import given, settings
from hypothesis import strategies as st
from requests import Response
from simulated_cameras import QUICK, serving, write_captures

from pmcl_ros.camera.client import Picture
from pmcl_ros.camera.gateway.client import ClockDifference, GatewayClient
from pmcl_ros.camera.gateway.download import Download, LostError
from pmcl_ros.camera.gateway.settings import GatewaySettings, read_token
from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.runtime.errors import CameraError, LinkError, SettingsError

SIDE = 512  # pixels: 393216 bytes
TOKEN = 'a-long-enough-token'
HASTY = GatewaySettings(timeout=2, answer_timeout=5, patience=0.5)
PATIENT = HASTY.model_copy(update={'patience': 20})


class Captures(NamedTuple):
    folder: Path
    raws: list[bytes]

    def __repr__(self):  # hypothesis prints it
        return str(self.folder)


@pytest.fixture(scope='module')
def captures(tmp_path_factory, camera_text):
    folder = tmp_path_factory.mktemp('captures')
    return Captures(folder, write_captures(folder, camera_text(SIDE, SIDE), side=SIDE))


@pytest.fixture(scope='module')
def gateway(captures):
    with gateway_of(captures.folder) as server:
        yield server


@contextmanager
def client_through(gateway, *cuts, **options):
    """(a client, the proxy between it and the gateway)."""
    with CuttingProxy(gateway.server_address[1], cuts, **options) as proxy, GatewayClient(
            f'http://127.0.0.1:{proxy.port}', settings=PATIENT) as client:
        yield client, proxy


def test_a_file_that_was_damaged_on_its_way_is_asked_for_as_a_whole():
    download = Download('a picture', 100)
    digest = base64.b64encode(hashlib.sha256(b'right').digest()).decode()
    for body, error in ((b'ri', 'ends after 2 of 5 bytes'), (b'wrong', 'SHA-256 differs')):
        answer = Response()
        answer.status_code, answer.raw = 200, BytesIO(body)
        answer.headers.update({'ETag': '"1"', 'Content-Length': '5',
                               'Repr-Digest': f'sha-256=:{digest}:'})
        with pytest.raises(LostError, match=error):
            download.take(answer)
        assert download.headers == ({'Range': 'bytes=2-', 'If-Range': '"1"'}
                                    if body == b'ri' else {})


def test_it_says_what_the_camera_says(captures, camera_text):
    folder, raws = captures
    with serving(folder) as address, gateway_to(address, TOKEN) as gateway, \
            GatewayClient(gateway.url, TOKEN) as client, LytroClient(address, QUICK) as direct:
        assert client.status() == direct.status()
        pictures = client.pictures()
        assert [each.id for each in pictures] == [each.id for each in direct.pictures()]
        assert [client.fetch(each) for each in pictures] == [
            (raw, camera_text(SIDE, SIDE)) for raw in raws]
        before = time.time_ns()
        picture = client.capture()
        assert before < picture.shutter_ns < time.time_ns()
        assert client.pictures() == [*pictures, picture]
        progress = []
        assert client.fetch(picture, lambda *each: progress.append(each))[0] == raws[0]
        assert progress[-1] == (len(raws[0]), len(raws[0]))
        assert progress == sorted(progress)


@pytest.mark.parametrize('reset', [False, True])
def test_a_download_is_resumed_where_it_was_cut(gateway, captures, camera_text, reset):
    text, (raw, *_) = camera_text(SIDE, SIDE), captures.raws
    # The text is cut in its head and in its body, the picture at several places.
    cuts = [30, 500, 300_000, 0, 50_000, 20]
    with client_through(gateway, *cuts, reset=reset) as (client, proxy):
        picture = Picture(GatewayClient(gateway.url).pictures()[0].id, 0)
        assert client.fetch(picture) == (raw, text)
        assert proxy.connections > 4
        assert b'Range: bytes=' in proxy.requests
        assert b'If-Range: "' in proxy.requests
        if not reset:  # what was under way when it was reset came to nothing
            assert proxy.to_client < len(raw) + 3 * 20_000  # no more than a block at each cut


@settings(deadline=None, max_examples=15)
@given(st.lists(st.integers(0, 500_000), max_size=4))
def test_a_download_survives_any_cuts(gateway, captures, cuts):
    with client_through(gateway, *cuts) as (client, _):
        pictures = GatewayClient(gateway.url).pictures()
        assert client.fetch(pictures[1])[0] == captures.raws[1]


def test_a_capture_whose_answer_is_lost_is_one_capture(captures):
    repeated = 0
    with gateway_of(captures.folder, empty=True) as gateway:
        for cut in range(0, 700, 170):  # the first answer is the list, with less than 500
            before = {each.id for each in GatewayClient(gateway.url).pictures()}
            with client_through(gateway, cut + len(before) * 90, 20, 0) as (client, proxy):
                picture = client.capture()
            repeated += proxy.requests.count(b'POST /capture') - 1
            after = {each.id for each in GatewayClient(gateway.url).pictures()}
            assert after - before == {picture.id}
    assert repeated > 1


def test_pictures_taken_while_the_robot_was_away_are_listed(captures):
    with gateway_of(captures.folder, empty=True) as gateway:
        taken = GatewayClient(gateway.url).capture()
        assert GatewayClient(gateway.url).pictures() == [taken]


def test_a_busy_gateway_is_waited_for(captures):
    with gateway_of(captures.folder, empty=True, delay=0.3) as gateway:
        clients = [GatewayClient(gateway.url, settings=PATIENT)
                   for _ in range(3)]
        taken = []
        threads = [threading.Thread(target=lambda each=each: taken.append(each.capture()))
                   for each in clients]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len({each.id for each in taken}) == 3
        assert {each.id for each in clients[0].pictures()} == {each.id for each in taken}


def test_a_gateway_that_is_away_and_comes_back(captures):
    folder, raws = captures
    with serving(folder) as address, ExitStack() as first:
        gateway = first.enter_context(gateway_to(address))
        with CuttingProxy(0) as proxy:
            proxy.target = gateway.server_address[1]
            client = GatewayClient(f'http://127.0.0.1:{proxy.port}', settings=PATIENT)
            picture = client.pictures()[2]
            first.close()
            with gateway_to(address) as second:
                proxy.target = second.server_address[1]
                assert client.fetch(picture)[0] == raws[2]


def test_closing_ends_a_download(captures):
    with gateway_of(captures.folder, settings=QUICK) as server, \
            GatewayClient(server.url, None, PATIENT) as robot:
        picture, got = robot.pictures()[0], []

        def close(count, _):
            got.append(count)
            robot.close()

        with pytest.raises(LinkError, match='is closed'):
            robot.fetch(picture, close)
        assert got[-1] < len(captures.raws[0])
        with pytest.raises(LinkError, match='is closed'):
            robot.pictures()


def test_nobody_there():
    with socket.create_server(('127.0.0.1', 0)) as listening:
        port = listening.getsockname()[1]
    client = GatewayClient(f'http://127.0.0.1:{port}', settings=HASTY)
    for ask in (client.status, client.pictures, client.capture,
                lambda: client.fetch(Picture('x', 0))):
        with pytest.raises(LinkError, match=f'gateway http://127.0.0.1:{port}: '):
            ask()


def test_a_gateway_that_never_answers():
    hasty = GatewaySettings(timeout=0.1, answer_timeout=0.1, patience=0.1)
    with socket.create_server(('127.0.0.1', 0)) as listening:
        client = GatewayClient(f'http://127.0.0.1:{listening.getsockname()[1]}', settings=hasty)
        with pytest.raises(LinkError, match='timed out'):
            client.fetch(Picture('x', 0))


def test_a_camera_that_is_away(captures):
    with ExitStack() as camera:
        address = camera.enter_context(serving(captures.folder))
        hasty = QUICK.model_copy(update={'patience': 0.2})
        with gateway_to(address, settings=hasty) as gateway:
            client = GatewayClient(gateway.url, settings=HASTY)
            picture = client.pictures()[0]
            camera.close()
            for ask in (client.status, client.pictures, client.capture,
                        lambda: client.fetch(picture)):
                with pytest.raises(LinkError, match=f'gateway: .*{address.port}') as caught:
                    ask()
                assert not isinstance(caught.value, LostError)


def test_a_token_that_is_wrong(captures):
    with gateway_of(captures.folder, token=TOKEN) as gateway:
        for token in (None, TOKEN + 'x'):
            with pytest.raises(CameraError, match=r'missing or wrong token.*401') as caught:
                GatewayClient(gateway.url, token).capture()
            assert not isinstance(caught.value, LinkError)


def test_a_picture_that_is_gone(gateway):
    with pytest.raises(CameraError, match='no such picture'):
        GatewayClient(gateway.url).fetch(Picture('../../etc/passwd', 0))


@pytest.mark.parametrize('url', ['', '127.0.0.1:80', 'ftp://a', 'http://', 'http://a:b',
                                 'http://a/b', 'http://a?b', 'http://u@a', 'http://[a'])
def test_what_is_no_url(url):
    with pytest.raises(SettingsError, match='no address of a gateway'):
        GatewayClient(url)


def test_tokens(tmp_path):
    path = tmp_path / 'token'
    path.write_text(f' {TOKEN}\n')
    assert read_token(path) == TOKEN
    for content in (b'', b'short', b'with a space in its middle', b'\xff' * 20, b'x' * 2000):
        path.write_bytes(content)
        with pytest.raises(SettingsError, match='token'):
            read_token(path)
    with pytest.raises(SettingsError, match='cannot read a token'):
        read_token(tmp_path / 'none')
    with pytest.raises(SettingsError, match='is no token'):
        GatewayClient('http://a', 'x\r\nHost: evil')


@contextmanager
def answering(data):
    """The address of something that answers `data` to whatever it is asked, and hangs up."""
    with socket.create_server(('127.0.0.1', 0)) as listening:
        def serve():
            with suppress(OSError):
                while True:
                    connection, _ = listening.accept()
                    with connection:
                        connection.recv(65536)
                        connection.sendall(data)
                        connection.shutdown(socket.SHUT_WR)
                        connection.recv(65536)
        threading.Thread(target=serve, daemon=True).start()
        try:
            yield f'http://127.0.0.1:{listening.getsockname()[1]}'
        finally:
            listening.shutdown(socket.SHUT_RDWR)


TIME = 'Gateway-Time-Ns: 1760000000000000000'  # the last line of a gateway's head


def answer(body, *headers, status='200 OK', last=TIME):
    lines = [f'HTTP/1.1 {status}', f'Content-Length: {len(body)}', *headers, last, '', '']
    return '\r\n'.join(lines).encode() + body


IMPATIENT = GatewaySettings(timeout=60, answer_timeout=60, patience=0.01)


@pytest.mark.parametrize(('data', 'reason'), [
    (answer(b'<html>'), 'something else than expected'),
    (answer(b'[' * 100_000), 'something else than expected'),
    (answer(b'{"id": "x"}'), 'something else than expected'),
    (answer(b'[{"id": "x", "shutter_ns": "noon"}]'), 'shutter_ns: .*noon'),
    (answer(b'[{"id": "", "shutter_ns": 1}]'), 'id: '),
    (answer(b' ' * 1_100_000), 'more than 1048576 bytes'),
    (answer(b'', 'Location: http://127.0.0.1:1/', status='302 Found'), 'no reason given.*302'),
    (answer(b'no', status='500 Oh'), 'no reason given.*500'),
    (answer(b'[]', last='X: y'), 'answers as no gateway of pmcl_ros does'),
    (answer(b'[]', last='Gateway-Time-Ns: 1'), 'or its answer was cut short'),
    (answer(b'[]')[:-1], 'cut short|IncompleteRead'),
    (b'SSH-2.0\r\n', 'SSH'),
    (b'', 'closed|aborted'),
])
def test_something_else_than_a_gateway(data, reason):
    with answering(data) as url, pytest.raises(CameraError, match=reason):
        GatewayClient(url, settings=IMPATIENT).pictures()


DIGEST = 'Repr-Digest: sha-256=:47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU=:'  # of nothing


@pytest.mark.parametrize(('data', 'reason'), [
    (answer(b'', DIGEST, 'ETag: "a"'), 'not JSON'),  # the text of a picture
    (answer(b'{}', DIGEST, 'ETag: "a"'), 'its SHA-256 differs'),
    (answer(b'{}', DIGEST), 'no length, ETag or Repr-Digest'),
    (answer(b'{}', 'ETag: "a"'), 'no length, ETag or Repr-Digest'),
    (b'HTTP/1.1 200 OK\r\nETag: "a"\r\n' + DIGEST.encode() + b'\r\nContent-Length: 99999999999'
     b'\r\n' + TIME.encode() + b'\r\n\r\n', 'has 99999999999 bytes, at most'),
    (answer(b'{}', 'Content-Range: bytes 0-1/2', status='206 Partial'), 'the answer has others'),
    (answer(b'{"error": "x"}', status='416 No'), 'gateway: x'),
])
def test_a_picture_that_cannot_be(data, reason):
    with answering(data) as url, pytest.raises(CameraError, match=reason):
        GatewayClient(url, settings=IMPATIENT).fetch(Picture('x', 0))


FRACTION = st.floats(0, 1, exclude_max=True)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(FRACTION, st.integers(0, 7)), min_size=1, max_size=4), FRACTION)
def test_mutated_answers(flips, cut):
    good = answer(b'[{"id": "sha1-0", "shutter_ns": 17}]')
    data = bytearray(good)
    for where, bit in flips:
        data[int(where * len(data))] ^= 1 << bit
    with answering(bytes(data[:max(1, int(cut * 3 * len(data)))])) as url:
        try:
            pictures = GatewayClient(url, settings=IMPATIENT).pictures()
        except CameraError:
            return
    assert all(isinstance(each.shutter_ns, int) for each in pictures)


@given(st.integers(-10 ** 18, 10 ** 18), st.lists(
    st.tuples(st.integers(0, 10 ** 9), st.integers(0, 10 ** 9), st.integers(0, 10 ** 10)),
    min_size=1))
def test_the_other_clock_is_known_as_well_as_the_quickest_answer_tells(ahead, exchanges):
    clock, now = ClockDifference(), 10 ** 18
    assert clock.ahead_ns == 0
    for there, back, pause in exchanges:
        clock = clock.updated(now, now + there + ahead, now + there + back)
        now += there + back + pause
    quickest = min(there + back for there, back, _ in exchanges)
    drift = 2e-4 * (now - 10 ** 18)
    if abs(ahead) > 10 ** 9:
        assert abs(clock.ahead_ns - ahead) <= quickest + drift + 1
    if ahead == 0:
        assert clock.ahead_ns == 0


def test_a_clock_that_is_set_is_followed():
    clock = ClockDifference().updated(0, 5, 10)
    assert clock.ahead_ns == 0
    assert clock.updated(100, 10 ** 9, 1000).ahead_ns == pytest.approx(10 ** 9, abs=1000)


def test_stamps_are_of_the_robots_clock(captures, monkeypatch):
    with gateway_of(captures.folder, empty=True) as gateway:
        hour = 3600 * 10 ** 9
        real = time.time_ns
        client = GatewayClient(gateway.url)
        # Another clock on the robot's side alone; both are in this process.
        monkeypatch.setattr('pmcl_ros.camera.gateway.client.time', _Clock(-hour))
        before = real() - hour
        picture = client.capture()
        assert before - 10 ** 8 < picture.shutter_ns < real() - hour + 10 ** 8


class _Clock:
    def __init__(self, ahead_ns):
        self._ahead_ns = ahead_ns
        self.monotonic, self.sleep = time.monotonic, time.sleep

    def time_ns(self):
        return time.time_ns() + self._ahead_ns


@contextmanager
def process(*options):
    """The gateway as users start it; (process, url)."""
    command = [sys.executable, '-m', 'pmcl_ros.cli', 'camera', 'gateway', *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        try:
            yield running, running.stdout.readline().removeprefix('gateway at ').strip()
        finally:
            running.terminate()


def test_the_command(captures, tmp_path):
    folder, raws = captures
    (tmp_path / 'token').write_text(TOKEN)
    with serving(folder) as address, process(
            '--host', '127.0.0.1', '--port', '0', '--camera', address.text, '--token-file',
            str(tmp_path / 'token'), '--cache', str(tmp_path)) as (running, url):
        client = GatewayClient(url, TOKEN)
        pictures = client.pictures()
        assert client.fetch(pictures[0])[0] == raws[0]
        assert 'Lytro A' in running.stdout.readline()
        kept = [each for each in tmp_path.rglob('*') if each.is_file()]
        assert hashlib.sha256(raws[0]).digest() in {
            hashlib.sha256(each.read_bytes()).digest() for each in kept}
        running.terminate()
        assert running.wait() == 0
    assert [each.name for each in tmp_path.iterdir()] == ['token']


def test_the_command_refuses_to_serve_everybody():
    done = subprocess.run([sys.executable, '-m', 'pmcl_ros.cli', 'camera', 'gateway', '--host',
                           '0.0.0.0', '--port', '0'], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert 'give a token (--token-file)' in ' '.join(done.stderr.split())
    assert 'Traceback' not in done.stderr
