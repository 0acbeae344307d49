"""Answers of a gateway that have no end, and clients that are closed meanwhile."""

import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress

import pytest

from pmcl_ros.camera.client import Picture, PictureQueue
from pmcl_ros.camera.gateway.client import GatewayClient
from pmcl_ros.camera.gateway.exchange import Exchanges
from pmcl_ros.camera.gateway.settings import GatewaySettings
from pmcl_ros.runtime.errors import CameraError, LinkError

SOME = Picture('x', 0)
LONG = 60.0  # s: much longer than a test takes
HEAD = b'HTTP/1.1 200 OK\r\nX: '
BODY = b'HTTP/1.1 200 OK\r\nContent-Length: 5000\r\nGateway-Time-Ns: 1760000000000000000\r\n\r\n'
LIMITS = {'timeout': LONG, 'answer_timeout': LONG, 'answer_limit': LONG, 'patience': LONG}


class Dripping:
    """Answers each request with `begin`, then drips: `drop` again and again."""

    def __init__(self, begin, drop=b' ', last=LONG):
        self._begin, self._drop, self._end = begin, drop, time.monotonic() + last
        self._listening = socket.create_server(('127.0.0.1', 0))
        self.url = f'http://127.0.0.1:{self._listening.getsockname()[1]}'
        self.requests, self.drips = 0, threading.Event()

    def __enter__(self):
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_):
        self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()

    def _accept(self):
        with suppress(OSError):
            while True:
                threading.Thread(target=self._serve, args=self._listening.accept()[:1],
                                 daemon=True).start()

    def _serve(self, connection):
        with suppress(OSError), connection:
            connection.recv(65536)
            self.requests += 1
            connection.sendall(self._begin)
            while time.monotonic() < self._end:
                connection.sendall(self._drop)
                self.drips.set()
                time.sleep(0.05)


ASKS = {'status': GatewayClient.status, 'pictures': GatewayClient.pictures,
        'capture': GatewayClient.capture, 'fetch': lambda client: client.fetch(SOME),
        'queue': PictureQueue}  # what lytro_driver waits for while it configures


@pytest.mark.parametrize('ask', ASKS.values(), ids=ASKS)
@pytest.mark.parametrize(('begin', 'drop', 'limits', 'seconds'), [
    (b'', b'HTTP/1.1 100 Continue\r\n\r\n', {'answer_limit': 0.3}, '0.3'),
    (HEAD, b' ', {'answer_limit': 0.3}, '0.3'), (BODY, b' ', {'timeout': 0.2}, '0.5'),
], ids=['interim', 'head', 'body'])
def test_an_answer_that_drips_ends_at_its_limit(ask, begin, drop, limits, seconds):
    if begin is BODY and ask is ASKS['fetch']:
        begin = begin.replace(b'\r\nGateway', b'\r\nETag: "a"\r\nRepr-Digest: sha-256=:'
                              b'47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU=:\r\nGateway')
    settings = GatewaySettings(**{**LIMITS, **limits})
    with Dripping(begin, drop) as server, \
            GatewayClient(server.url, None, settings) as client:
        with pytest.raises(CameraError, match=f'{server.url}: GET /.*no complete answer within '
                                              f'{seconds} s') as caught:
            ask(client)
        assert not isinstance(caught.value, LinkError)
        assert server.requests <= 1  # it is not tried again; its thread may be late


@contextmanager
def asking(server, ask=GatewayClient.pictures):
    """(a client whose answer drips, the future of that answer)."""
    with ThreadPoolExecutor(1) as pool, \
            GatewayClient(server.url, None, GatewaySettings(**LIMITS)) as client:
        answer = pool.submit(ask, client)
        assert server.drips.wait(LONG)
        yield client, answer


@pytest.mark.parametrize('begin', [b'', HEAD, BODY], ids=['silence', 'head', 'body'])
def test_closing_ends_the_wait_for_an_answer(begin):
    drop = b' ' if begin else b''
    with Dripping(begin, drop) as server, asking(server) as (client, answer):
        assert not answer.done()
        began = time.monotonic()
        client.close()
        with pytest.raises(LinkError, match='is closed'):
            answer.result(LONG)
        assert time.monotonic() - began < LONG / 4
        assert server.requests == 1


def test_closing_ends_all_waits():
    with Dripping(HEAD) as server, asking(server) as (client, first), \
            asking(server) as (_, another), ThreadPoolExecutor(2) as pool:
        answers = [first, *(pool.submit(client.status) for _ in range(2))]
        end = time.monotonic() + LONG
        while server.requests < 4 and time.monotonic() < end:
            time.sleep(0.01)
        client.close()
        for each in answers:
            with pytest.raises(LinkError, match='is closed'):
                each.result(LONG)
        assert not another.done()  # of another client


@pytest.fixture
def connected():
    """(our end of a connection, which gives up after a while; the other end)."""
    ours, other = socket.socketpair()
    ours.settimeout(LONG)
    with ours, other:
        yield ours, other


def test_the_limit_of_an_answer_is_in_place_of_that_of_the_request(connected):
    """A large picture takes longer than an answer may keep one waiting."""
    ours, other = connected
    with Exchanges().begin(1.0) as exchange:
        exchange.uses(ours)
        exchange.answers(LONG, 2 * LONG)
        time.sleep(1.5)
        other.sendall(b'x')
        assert ours.recv(1) == b'x'
        assert (exchange.ended, exchange.limit) == (False, 2 * LONG)
        exchange.answers(0.1, LONG)
        with pytest.raises(TimeoutError):  # of silence
            ours.recv(1)
        assert not exchange.ended


def test_what_has_ended_stays_ended_and_takes_its_next_socket_with_it(connected):
    ours, _ = connected
    with Exchanges().begin(2 * LONG) as exchange:
        exchange.end()  # while it connects
        exchange.answers(LONG, LONG)
        assert (exchange.ended, exchange.limit) == (True, 2 * LONG)
        exchange.uses(ours)
        assert ours.recv(1) == b''


def test_what_is_over_leaves_its_socket_to_the_next(connected):
    ours, other = connected
    exchanges = Exchanges()
    with exchanges.begin(LONG) as over:
        pass
    with exchanges.begin(1.0) as first:
        first.uses(ours)
    with exchanges.begin(LONG) as second:
        second.uses(ours)
        time.sleep(1.5)
        assert not first.ended  # its limit is over with it
        first.end()
        other.sendall(b'x')
        assert ours.recv(1) == b'x'
        exchanges.end_all()
        assert (over.ended, second.ended) == (False, True)
        assert ours.recv(1) == b''
    with exchanges.begin(LONG) as third:
        assert not third.ended
