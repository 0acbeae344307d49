"""Which pictures are new and whose shutter they were."""

import time
from datetime import datetime, timezone

import pytest

from pmcl_ros.camera.lytro.arrivals import Arrivals
from pmcl_ros.camera.lytro.payloads import PictureRecord

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


def test_pictures_of_the_first_list_are_not_new(arrivals, now):
    assert arrivals.take() is None
    (picture,) = arrivals.listed([record(1, 0)])
    assert picture.shutter_ns == pytest.approx(now - 100 * SECOND, rel=0, abs=2000)


def test_a_picture_counts_when_it_is_announced(arrivals, now):
    old, new = record(1, 0), record(2, now)
    assert len(arrivals.listed([new, old])) == 1  # still being rendered
    assert not arrivals.pending
    arrivals.announced(new.id)
    assert arrivals.pending
    assert [each.id for each in arrivals.listed([new, old])] == [old.id, new.id]
    assert not arrivals.pending
    assert arrivals.take().id == new.id
    assert arrivals.take() is None


def test_the_callback_is_the_shutter_else_the_command(arrivals, now):
    shot = arrivals.commanded(now)
    assert shot.stamp_ns == now
    arrivals.pressed(now + SECOND // 10)
    new = record(2, now + SECOND)
    arrivals.announced(new.id)
    arrivals.listed([new])
    assert arrivals.take(shot).shutter_ns == now + SECOND // 10
    assert arrivals.take() is None


def test_the_cameras_own_button_is_not_taken_for_the_command(arrivals, now):
    arrivals.pressed(now - 8 * SECOND)  # somebody pressed it
    shot = arrivals.commanded(now)
    arrivals.pressed(now)
    button, commanded = record(2, now - 8 * SECOND), record(3, now)
    arrivals.announced(button.id)
    arrivals.listed([button])
    assert arrivals.take(shot) is None
    arrivals.announced(commanded.id)
    arrivals.listed([commanded, button])
    assert arrivals.take(shot).id == commanded.id
    assert arrivals.take().id == button.id  # it is not lost


def test_a_shot_without_a_picture_is_given_up(arrivals, now):
    refused = arrivals.commanded(now - 2 * SECOND)
    arrivals.given_up(refused)
    arrivals.commanded(now)
    new = record(2, now)
    arrivals.announced(new.id)
    arrivals.listed([new])
    assert arrivals.take().shutter_ns == now


@pytest.mark.parametrize('ahead', [0, 3600 * SECOND, -86400 * SECOND])
def test_after_a_gap_every_picture_counts_by_its_date(arrivals, now, ahead):
    arrivals.clock_ahead_ns = ahead
    shot = arrivals.commanded(now - 20 * SECOND)
    arrivals.callbacks(connected=False)
    arrivals.callbacks(connected=True)
    assert arrivals.pending
    mine, other = record(2, now - 19 * SECOND + ahead), record(3, now - 10 * SECOND + ahead)
    arrivals.listed([other, mine])
    assert not arrivals.pending
    assert arrivals.take(shot).shutter_ns == now - 20 * SECOND
    assert arrivals.take().shutter_ns == pytest.approx(now - 10 * SECOND, rel=0, abs=2000)


def test_without_callbacks_the_list_is_looked_at_again_and_again(arrivals, now):
    arrivals.callbacks(connected=False)
    arrivals.listed([])
    assert arrivals.pending
    assert not arrivals.connected


def test_a_picture_that_is_announced_twice_is_new_once(arrivals, now):
    new = record(2, now)
    for _ in range(2):
        arrivals.announced(new.id)
        arrivals.listed([new])
    assert arrivals.take() is not None
    assert arrivals.take() is None


def test_a_date_that_is_none(arrivals, now):
    shot = arrivals.commanded(now)
    new = PictureRecord(100, 2, 'sha1-x', 'no date')
    arrivals.callbacks(connected=False)
    arrivals.listed([new])
    assert arrivals.take(shot).shutter_ns == now
