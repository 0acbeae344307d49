"""Callbacks and the pictures that they announce."""

import contextlib
import queue
import socket
import threading
import time
from datetime import datetime, timezone
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.camera.client import Picture
from pmcl_ros.camera.lytro.address import Address, LinkSettings
from pmcl_ros.camera.lytro.events import Arrivals, CallbackListener, Event, EventParser
from pmcl_ros.camera.lytro.protocol import PictureRecord
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
        self.listening.settimeout(60)
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
        assert listener.get(timeout=60) is True
        got = [listener.get(timeout=60) for _ in range(3)]
    assert [(each.name, each.arguments) for each in got] == [
        (each.name, each.arguments) for each in EVENTS[1:]]
    assert all(each.arrived_ns > 1_000_000_000 * 10**9 for each in got)


@pytest.mark.parametrize('end', ['closed', 'garbage'])
def test_a_lost_connection_is_made_again(camera, listener, end):
    first = camera.accept()
    assert listener.get(timeout=60) is True
    if end == 'closed':
        first.close()
    else:
        first.sendall(b'\x01\x02\x00')
    assert listener.get(timeout=60) is False
    with first, camera.accept() as connected:
        assert listener.get(timeout=60) is True
        connected.sendall(EVENTS[1].encode())
        assert listener.get(timeout=60).name == 'ShutterPressed'


def test_silence_is_a_lost_connection(camera):
    heard = queue.Queue()
    settings = SETTINGS.model_copy(update={'watchdog': 0.2, 'timeout': 600})
    listener = CallbackListener(camera.address, settings, heard.put, heard.put)
    with camera.accept(), camera.accept():
        assert [heard.get(timeout=60) for _ in range(3)] == [True, False, True]
        listener.close()


def test_nobody_there():
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(LinkError, match='no camera answers'):
        CallbackListener(Address(host='127.0.0.1', callback_port=port), SETTINGS, print, print)


SECOND = 1_000_000_000


def record(number, taken_ns):
    date = datetime.fromtimestamp(taken_ns / 1e9, timezone.utc).isoformat()
    return PictureRecord(100, number, f'sha1-{number:040d}', date)


@pytest.fixture
def now():
    return time.time_ns()


@pytest.fixture
def arrivals(now):
    arrivals = Arrivals()
    arrivals.listed([record(1, now - 100 * SECOND)])
    return arrivals


def test_pictures_of_the_first_list_have_the_cameras_date(arrivals, now):
    (picture,) = arrivals.listed([record(1, 0)])
    assert picture.shutter_ns == pytest.approx(now - 100 * SECOND, rel=0, abs=2000)


@pytest.mark.parametrize('date', ['9999-12-31T23:59:59.999Z', '0001-01-01T00:00:00.000Z',
                                  '2038-01-20T00:00:00.000Z', 'yesterday'])
def test_a_date_that_no_stamp_can_hold_is_none(arrivals, date):
    assert arrivals.listed([PictureRecord(100, 9, 'sha1-9', date)], all_complete=True) == [
        Picture('sha1-9', 0)]


def test_a_picture_counts_when_it_is_announced(arrivals, now):
    old, new = record(1, 0), record(2, now)
    assert len(arrivals.listed([new, old])) == 1  # still being rendered
    assert not arrivals.pending
    arrivals.announced(new.id)
    assert arrivals.pending
    assert [each.id for each in arrivals.listed([new, old])] == [old.id, new.id]
    assert not arrivals.pending


def test_the_callback_is_the_shutter_else_the_command(arrivals, now):
    shot = arrivals.commanded(now)
    assert shot.stamp_ns == now
    arrivals.pressed(now + SECOND // 10)
    new = record(2, now + SECOND)
    arrivals.announced(new.id)
    arrivals.listed([new])
    assert shot.picture.shutter_ns == now + SECOND // 10


def test_the_cameras_own_button_is_not_taken_for_the_command(arrivals, now):
    arrivals.pressed(now - 8 * SECOND)  # somebody pressed it
    shot = arrivals.commanded(now)
    arrivals.pressed(now)
    button, commanded = record(2, now - 8 * SECOND), record(3, now)
    arrivals.announced(button.id)
    arrivals.listed([button])
    assert shot.picture is None
    arrivals.announced(commanded.id)
    pictures = arrivals.listed([commanded, button])
    assert shot.picture == pictures[1]
    assert [each.id for each in pictures] == [button.id, commanded.id]
    assert [each.shutter_ns for each in pictures] == [now - 8 * SECOND, now]


def test_a_button_long_after_a_command_without_a_picture_is_not_its_shutter(arrivals, now):
    shot = arrivals.commanded(now - 20 * SECOND)
    arrivals.pressed(now)
    new = record(2, now)
    arrivals.announced(new.id)
    assert [each.shutter_ns for each in arrivals.listed([new])] == [now]
    assert (shot.picture, shot.stamp_ns) == (None, now - 20 * SECOND)


def test_a_button_soon_after_a_command_is_of_another_picture(arrivals, now):
    arrivals.commanded(now)
    stamps = [now + SECOND // 10, now + 2 * SECOND]
    for each in stamps:
        arrivals.pressed(each)
    pictures = [record(2, stamps[0]), record(3, stamps[1])]
    for each in pictures:
        arrivals.announced(each.id)
    assert [each.shutter_ns for each in arrivals.listed(pictures[::-1])] == stamps


def test_a_shot_is_of_the_picture_that_is_announced_whatever_the_cameras_date(arrivals, now):
    shot = arrivals.commanded(now)
    new = record(2, now - 30 * SECOND)  # its clock was set meanwhile
    arrivals.announced(new.id)
    assert arrivals.listed([new]) == [shot.picture] == [Picture(new.id, now)]


def test_a_shot_that_brought_no_picture_for_a_minute_is_of_none(arrivals, now):
    shot = arrivals.commanded(now - 61 * SECOND)
    new = PictureRecord(100, 2, 'sha1-x', 'no date')
    arrivals.announced(new.id)
    assert arrivals.listed([new]) == [Picture(new.id, 0)]
    assert shot.picture is None


def test_a_shutter_is_of_one_picture(arrivals, now):
    first, second = record(2, now), record(3, now + 3 * SECOND)  # its callback was lost
    arrivals.pressed(now)
    for each in (first, second):
        arrivals.announced(each.id)
        arrivals.listed([first])
    stamps = [each.shutter_ns for each in arrivals.listed([second, first])]
    assert stamps[0] == now
    assert stamps[1] == pytest.approx(now + 3 * SECOND, rel=0, abs=2000)


def test_a_shot_without_a_picture_is_given_up(arrivals, now):
    refused = arrivals.commanded(now - 2 * SECOND)
    arrivals.given_up(refused)
    arrivals.commanded(now)
    new = record(2, now)
    arrivals.announced(new.id)
    (picture,) = arrivals.listed([new])
    assert picture.shutter_ns == now


def test_after_a_gap_a_picture_of_another_time_is_not_that_of_the_shot(arrivals, now):
    shot = arrivals.commanded(now - 20 * SECOND)
    (picture,) = arrivals.listed([record(2, now - 10 * SECOND)], all_complete=True)
    assert picture.shutter_ns == pytest.approx(now - 10 * SECOND, rel=0, abs=2000)
    assert shot.picture is None


@pytest.mark.parametrize('ahead', [0, 3600 * SECOND, -86400 * SECOND])
def test_after_a_gap_every_picture_counts_by_its_date(arrivals, now, ahead):
    arrivals.clock_ahead_ns = ahead
    shot = arrivals.commanded(now - 20 * SECOND)
    arrivals.callbacks(connected=False)
    arrivals.callbacks(connected=True)
    assert arrivals.pending
    mine, other = record(2, now - 19 * SECOND + ahead), record(3, now - 10 * SECOND + ahead)
    first, second = arrivals.listed([other, mine])
    assert not arrivals.pending
    assert (shot.picture, first.shutter_ns) == (first, now - 20 * SECOND)
    assert second.shutter_ns == pytest.approx(now - 10 * SECOND, rel=0, abs=2000)


def test_without_callbacks_the_list_is_looked_at_again_and_again(arrivals, now):
    arrivals.callbacks(connected=False)
    arrivals.listed([])
    assert arrivals.pending


def test_a_picture_that_is_announced_twice_is_waited_for_once(arrivals, now):
    new = record(2, now)
    arrivals.announced(new.id)
    listed = arrivals.listed([new])
    arrivals.announced(new.id)
    assert not arrivals.pending
    assert arrivals.listed([new]) == listed


def test_a_date_that_is_none(arrivals, now):
    shot = arrivals.commanded(now)
    new = PictureRecord(100, 2, 'sha1-x', 'no date')
    arrivals.callbacks(connected=False)
    arrivals.listed([new])
    assert shot.picture.shutter_ns == now
