"""Callbacks: events from pieces of bytes, and a listener that comes back."""

import contextlib
import queue
import socket
import threading
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.camera.lytro.callbacks import CallbackListener, Event, EventParser
from pmcl_ros.camera.lytro.settings import Address, LinkSettings
from pmcl_ros.runtime.errors import LinkError, ProtocolError

SETTINGS = LinkSettings(timeout=5, watchdog=10)
IDENTITY = 'sha1-' + 40 * 'a'
EVENTS = [Event('HeartbeatTick', ('tick',)), Event('ShutterPressed', ('CLICK',)),
          Event('NewPictureAvailable', (IDENTITY,)), Event('LikedChanged', (IDENTITY, '1'))]


def test_the_bytes_are_those_of_the_document():
    wire = bytes.fromhex('5B') + b'NewPictureAvailable' + bytes.fromhex('5D 20')
    wire += IDENTITY.encode() + bytes.fromhex('0D 0A 00')
    assert EVENTS[2].encode() == wire
    assert EventParser().feed(wire) == [EVENTS[2]]


@given(st.lists(st.sampled_from(EVENTS), max_size=6), st.lists(st.integers(0, 300)))
def test_events_come_in_any_pieces(events, cuts):
    data, parser = b''.join(each.encode() for each in events), EventParser()
    edges = [0, *sorted(cuts), len(data)]
    got = [event for begin, end in pairwise(edges)
           for event in parser.feed(data[begin:end])]
    assert got == events


@given(st.lists(st.binary(max_size=200), max_size=10))
def test_other_bytes_end_in_the_packages_own_error(pieces):
    parser = EventParser()
    with contextlib.suppress(ProtocolError):
        for each in pieces:
            parser.feed(each)


def test_an_event_without_end_is_given_up():
    parser = EventParser()
    parser.feed(b'x' * 4000)
    with pytest.raises(ProtocolError, match='no end'):
        parser.feed(b'x' * 1000)


class Camera:
    """Only the callback port."""

    def __init__(self):
        self.listening = socket.create_server(('127.0.0.1', 0))
        port = self.listening.getsockname()[1]
        self.address = Address(host='127.0.0.1', callback_port=port)

    def accept(self):
        self.listening.settimeout(10)
        return self.listening.accept()[0]


@pytest.fixture
def camera():
    camera = Camera()
    with camera.listening:
        yield camera


@pytest.fixture
def listener(camera):
    """What a listener heard, and when it was connected, in one queue."""
    heard = queue.Queue()
    listener = CallbackListener(camera.address, SETTINGS, heard.put, heard.put)
    yield heard
    listener.close()
    assert 'lytro callbacks' not in {each.name for each in threading.enumerate()}


def test_events_are_handed_on_without_heartbeats(camera, listener):
    with camera.accept() as connected:
        connected.sendall(b''.join(each.encode() for each in EVENTS))
        assert listener.get(timeout=5) is True
        got = [listener.get(timeout=5) for _ in range(3)]
    assert [(each.name, each.arguments) for each in got] == [
        (each.name, each.arguments) for each in EVENTS[1:]]
    assert all(each.arrived_ns > 1_000_000_000 * 10**9 for each in got)


@pytest.mark.parametrize('end', ['closed', 'garbage'])
def test_a_lost_connection_is_made_again(camera, listener, end):
    first = camera.accept()
    assert listener.get(timeout=5) is True
    if end == 'closed':
        first.close()
    else:
        first.sendall(b'\x01\x02\x00')
    assert listener.get(timeout=5) is False
    with first, camera.accept() as connected:
        assert listener.get(timeout=5) is True
        connected.sendall(EVENTS[1].encode())
        assert listener.get(timeout=5).name == 'ShutterPressed'


def test_silence_is_a_lost_connection(camera):
    heard = queue.Queue()
    settings = SETTINGS.model_copy(update={'watchdog': 0.2})
    listener = CallbackListener(camera.address, settings, heard.put, heard.put)
    with camera.accept(), camera.accept():
        assert [heard.get(timeout=5) for _ in range(3)] == [True, False, True]
        listener.close()


def test_nobody_there():
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(LinkError, match='no camera answers'):
        CallbackListener(Address(host='127.0.0.1', callback_port=port), SETTINGS, print, print)
