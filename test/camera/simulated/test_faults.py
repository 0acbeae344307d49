"""Every fault, on real sockets: the picture is intact or the error clear, and the next comes."""

import contextlib
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from simulated_cameras import QUICK, SIDE, client_of, serving, write_captures
from waiting import eventually

from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.camera.simulated.faults import Faults
from pmcl_ros.runtime.errors import CameraError, LinkError, SettingsError

HASTY = QUICK.model_copy(update={'picture_timeout': 1.0})  # of a picture that does not come


@pytest.fixture
def captures(tmp_path, camera_text):
    return tmp_path, write_captures(tmp_path, camera_text(SIDE, SIDE))


@pytest.mark.parametrize(('fault', 'side'), [
    ('drop-after=1kB', SIDE), ('drop-after=700', SIDE), ('drop-after=5kB:once', SIDE),
    ('drop-random=1500:1', SIDE), ('drop-random=1kB:2', SIDE), ('drop-random=4kB:3', SIDE),
    ('slow=100kB/s', SIDE), ('short-chunks=500', SIDE), ('short-chunks=1', 16),
    ('garbage-header=7', SIDE)])
def test_pictures_arrive_intact(tmp_path, camera_text, fault, side):
    folder, raws = tmp_path, write_captures(tmp_path, camera_text(side, side), side=side)
    settings = QUICK.model_copy(update={'timeout': 0.5})
    with client_of(folder, fault, settings=settings, empty=True) as client:
        seen = []
        for number in range(4):
            picture = client.capture()
            raw, _ = client.fetch(picture)
            assert raw == raws[number % 3]
            seen.append(picture.id)
        assert len(set(seen)) == 4
        assert [each.id for each in client.pictures()] == seen


def test_a_command_that_is_never_answered_takes_no_picture_and_is_told(captures):
    folder, raws = captures
    settings = QUICK.model_copy(update={'timeout': 0.5, 'picture_timeout': 3.0})
    with client_of(folder, 'silence=9', settings=settings, empty=True) as client:
        seen, problems = [], []
        for _ in range(6):
            try:
                picture = client.capture()
            except CameraError as error:  # of the requests the command was the ninth
                problems.append(str(error))
                continue
            assert client.fetch(picture)[0] == raws[len(seen) % 3]
            seen.append(picture.id)
        assert all('did not press the shutter' in each for each in problems)
        assert len(set(seen)) == len(seen) > 0
        assert [each.id for each in client.pictures()] == seen


def test_faults_together(captures):
    folder, raws = captures
    settings = QUICK.model_copy(update={'timeout': 0.5})
    with client_of(folder, 'drop-random=3kB:5', 'short-chunks=700', 'garbage-header=11',
                   settings=settings, empty=True) as client:
        for number in range(6):
            raw, _ = client.fetch(client.capture())
            assert raw == raws[number % 3]


def test_a_connection_that_never_carries_a_reply(captures):
    settings = QUICK.model_copy(update={'patience': 0.5})
    with serving(captures[0], 'drop-after=20') as address, \
            pytest.raises(LinkError, match=r'lost the camera at 127\.0\.0\.1'):
        LytroClient(address, settings)


def test_silence_is_told(captures):
    with serving(captures[0], 'silence') as address:
        settings = QUICK.model_copy(update={'timeout': 0.2, 'patience': 0.5})
        with pytest.raises(LinkError, match=r'LOAD_HARDWARE_INFO .*timed out'):
            LytroClient(address, settings)


@pytest.mark.parametrize(('fault', 'refused'), [('busy', 1), ('busy=3', 3)])
def test_a_busy_camera_takes_the_next_picture(captures, fault, refused):
    folder, raws = captures
    with serving(folder, fault, empty=True) as address, LytroClient(address, HASTY) as hasty, \
            LytroClient(address, QUICK) as client:
        for _ in range(refused):
            with pytest.raises(CameraError, match='did not press the shutter and holds 0 pict'):
                hasty.capture()
        before = time.time_ns()
        picture = client.capture()
        assert picture.shutter_ns >= before  # not the time of a command that was refused
        assert client.fetch(picture)[0] == raws[0]


def test_a_full_card_takes_pictures_again_after_a_deletion(captures):
    folder, raws = captures
    with serving(folder, 'card-full=1', empty=True) as address, \
            LytroClient(address, HASTY) as hasty, LytroClient(address, QUICK) as client:
        first = client.capture()
        for _ in range(2):
            with pytest.raises(CameraError, match='memory is full'):
                hasty.capture()
        client.delete(first)
        assert client.fetch(client.capture())[0] == raws[1]


def test_a_slow_link_is_slow_for_every_connection(captures):
    with client_of(captures[0], 'slow=30kB/s') as client:
        began = time.monotonic()
        raw, _ = client.fetch(client.pictures()[0])
        assert time.monotonic() - began > len(raw) / 40_000


def test_two_clients_at_once(captures):
    folder, raws = captures
    with serving(folder, empty=True) as address, LytroClient(address, QUICK) as one, \
            LytroClient(address, QUICK) as other:
        picture = one.capture()
        eventually(lambda: picture.id in [each.id for each in other.pictures()])
        with ThreadPoolExecutor(2) as pool:  # one buffer: an error is right, wrong bytes are not
            results = [pool.submit(each.fetch, picture) for each in (one, other) * 5]
        for each in results:
            with contextlib.suppress(CameraError):
                assert each.result()[0] == raws[0]
        assert one.fetch(picture)[0] == raws[0]


def test_what_faults_say():
    faults = Faults.parse(['drop-after=5MB', 'slow=1.5MB/s', 'short-chunks', 'garbage-header',
                           'silence=3', 'busy', 'card-full=2'])
    assert (faults.drop_after, faults.slow, faults.short_chunks) == (5_000_000, 1_500_000, 64_000)
    assert (faults.garbage_header, faults.silence, faults.busy, faults.room) == (10, 3, 1, 2)
    assert [faults.budget(), faults.budget()] == [5_000_000] * 2
    once = Faults.parse(['drop-after=4KiB:once'])
    assert [once.budget(), once.budget()] == [4096, None]
    runs = [[Faults.parse([f'drop-random=1MB:{seed}']).budget() for _ in range(1)]
            for seed in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]


@pytest.mark.parametrize('text', [
    '', 'drop', 'drop-after', 'drop-after=', 'drop-after=5TB', 'drop-after=-5', 'drop-after=0',
    'drop-after=5MB:twice', 'slow=fast', 'slow=1MB/s:once', 'silence=0', 'busy=x',
    'drop-random=1MB:x', 'short-chunks=0'])
def test_other_faults_are_refused(text):
    with pytest.raises(SettingsError, match=r'no fault: .* drop-after=SIZE\[:once\], .*\[=N\];'):
        Faults.parse([text])
