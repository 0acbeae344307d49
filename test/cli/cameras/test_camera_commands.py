"""`pmcl camera`, as users call it: a camera in a real process, over real sockets."""

import lzma
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import pytest
from command_line import Runner
from simulated_cameras import QUICK, SIDE, serving, write_captures
from waiting import eventually

from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.camera.lytro.link import Link
from pmcl_ros.camera.lytro.protocol import (
    LOAD_PICTURE_LIST,
    Command,
    Request,
    decode_picture_list,
)
from pmcl_ros.camera.simulated import card
from pmcl_ros.camera.simulated.server import served
from pmcl_ros.cli import main


def pmcl_camera(*arguments):
    return Runner().invoke(main, ['camera', *map(str, arguments)])


@pytest.fixture(scope='module')
def captures(tmp_path_factory, camera_text):
    folder = tmp_path_factory.mktemp('captures')
    return folder, write_captures(folder, camera_text(SIDE, SIDE))


@pytest.fixture(scope='module')
def address(captures):
    with served(captures[0], '--delay', '0', '--fault', 'drop-random=20kB',
                '--fault', 'short-chunks=1kB') as (address, _):
        yield address


def test_pictures_are_taken_and_saved_with_the_time_of_the_shutter(captures, address, tmp_path):
    before = time.time_ns()
    done = pmcl_camera('capture', '--address', address.text, '--out', tmp_path, '--count', 2)
    assert done.exit_code == 0, done.output
    paths = [tmp_path / f'IMG_{number:04d}.RAW' for number in (4, 5)]
    assert done.stdout.split() == [str(each) for each in paths]
    assert [each.read_bytes() for each in paths] == captures[1][:2]
    first, second = (each.stat().st_mtime_ns for each in paths)
    assert before < first < second < time.time_ns()
    assert all(each.with_suffix('.TXT').exists() for each in paths)
    done = pmcl_camera('capture', '--address', address.text, '--out', tmp_path, '--download',
                       'IMG_0004')
    assert done.exit_code == 1
    assert 'is there already' in done.stderr


def test_pictures_are_listed_downloaded_and_deleted(captures, tmp_path):
    with serving(captures[0]) as address:
        where = ['capture', '--address', address.text]
        listed = pmcl_camera(*where, '--list').stdout.splitlines()
        assert [each.split()[0] for each in listed] == ['IMG_0003', 'IMG_0002', 'IMG_0001']
        done = pmcl_camera(*where, '--download', 'IMG_0002', '--delete', '--out', tmp_path)
        assert done.exit_code == 0, done.output
        done = pmcl_camera(*where, '--download', 'all', '--out', tmp_path)
        assert [each[-12:] for each in done.stdout.split()] == ['IMG_0001.RAW', 'IMG_0003.RAW']
        assert [(tmp_path / f'IMG_{each:04d}.RAW').read_bytes() for each in (1, 2, 3)] == \
            captures[1]
        done = pmcl_camera(*where, '--download', 'IMG_0002', '--out', tmp_path / 'new')
        assert done.exit_code == 1
        assert 'has no IMG_0002, only IMG_0001, IMG_0003' in done.stderr


def test_a_picture_that_is_deleted_meanwhile_is_told_in_a_line(captures, tmp_path):
    # A second for each, so that the last is deleted in time on a busy machine, too.
    with serving(captures[0], 'slow=6kB/s') as address, closing(Link(address, QUICK)) as other:
        newest = decode_picture_list(other.load(LOAD_PICTURE_LIST, 'the list'))[0]
        with ThreadPoolExecutor(1) as pool:
            running = pool.submit(pmcl_camera, 'capture', '--address', address.text, '--out',
                                  tmp_path, '--download', 'all')
            eventually(lambda: list(tmp_path.glob('IMG_0001.*')))
            other.ask(Request(Command.DELETE_PICTURE, newest.key))
            done = running.result()
    assert isinstance(done.exception, SystemExit)  # no traceback
    assert done.exit_code == 1
    assert [each.name for each in sorted(tmp_path.glob('*.RAW'))] == [
        'IMG_0001.RAW', 'IMG_0002.RAW']
    told = [line for line in done.stderr.splitlines() if line.strip()][1:]
    assert f'IMG_0003: the camera has no picture {newest.id} (any more)' in told[0]
    assert told[1].startswith('Error: 1 pictures were not saved')
    assert len(told) == 2


@pytest.mark.parametrize('mine', ['IMG_0001.TXT', 'IMG_0001.RAW'])
def test_what_is_there_is_overwritten_by_force_only(captures, tmp_path, mine):
    (tmp_path / mine).write_text('x')
    with serving(captures[0]) as address:
        command = ('capture', '--address', address.text, '--out', tmp_path)
        for what, others in (('IMG_0001', 0), ('all', 2)):
            done = pmcl_camera(*command, '--download', what)
            # By its name a RAW is the picture of this number, which `all` leaves.
            assert done.exit_code == int(what != 'all' or mine.endswith('TXT')), done.output
            assert (tmp_path / mine).read_text() == 'x'
            assert len(list(tmp_path.glob('*.RAW'))) - mine.endswith('RAW') == others
        assert pmcl_camera(*command, '--download', 'all', '--force').exit_code == 0
    assert [(tmp_path / f'IMG_{each:04d}.RAW').read_bytes() for each in (1, 2, 3)] == captures[1]
    assert (tmp_path / 'IMG_0001.TXT').read_text() == (tmp_path / 'IMG_0002.TXT').read_text()


def test_a_packed_picture_is_not_fetched_again(captures, tmp_path):
    (tmp_path / 'IMG_0001.RAW.xz').write_bytes(lzma.compress(captures[1][0]))
    (tmp_path / 'IMG_0001.TXT').write_text('mine')
    with serving(captures[0]) as address:
        done = pmcl_camera('capture', '--address', address.text, '--out', tmp_path, '--download',
                           'all')
    assert done.exit_code == 0
    assert '1 of 3 pictures are in' in done.stderr
    assert (tmp_path / 'IMG_0001.TXT').read_text() == 'mine'


def test_one_number_in_two_folders_of_the_card_gives_two_files(captures, tmp_path, monkeypatch):
    monkeypatch.setattr(card, 'FILES_PER_FOLDER', 2)
    with serving(captures[0]) as address:
        where = ('capture', '--address', address.text)
        names = ['101PHOTO/IMG_0001', 'IMG_0002', 'IMG_0001']
        assert [each.split()[0] for each in pmcl_camera(*where, '--list').stdout.splitlines()
                ] == names
        assert pmcl_camera(*where, '--out', tmp_path, '--download', 'all').exit_code == 0
        again = pmcl_camera(*where, '--out', tmp_path, '--download', 'all')
        assert '3 of 3 pictures are in' in again.stderr
        one = pmcl_camera(*where, '--out', tmp_path / 'one', '--download', names[0])
        assert one.stdout.strip() == str(tmp_path / 'one' / f'{names[0]}.RAW')
    assert [(tmp_path / f'{each}.RAW').read_bytes() for each in names[::-1]] == captures[1]


@pytest.mark.parametrize(('arguments', 'reason'), [
    (['serve', '--pictures', '.', '--fault', 'nothing'], 'no fault'),
    (['serve', '--pictures', '/nonexistent'], 'does not exist'),
    (['capture'], '--out'),
    (['capture', '--list', '--out', 'x'], 'give --out, or --list alone'),
    (['capture', '--list', '--download', 'all'], 'give --out, or --list alone'),
    (['capture', '--list', '--address', 'a:b:c:d'], 'no address'),
    (['capture', '--list', '--address', 'no.such.host.invalid'], 'no camera answers'),
])
def test_mistakes_are_told_in_one_line(captures, monkeypatch, arguments, reason):
    monkeypatch.chdir(captures[0])
    done = pmcl_camera(*arguments)
    assert done.exit_code != 0
    assert reason in done.stderr
    assert isinstance(done.exception, SystemExit)  # no traceback


def test_help_tells_the_faults():
    assert 'garbage-header' in pmcl_camera('serve', '--help').stdout


@pytest.mark.parametrize('sent', [signal.SIGINT, signal.SIGTERM])
def test_serving_ends_when_told(captures, sent):
    with served(captures[0]) as (address, process):
        with LytroClient(address) as client:
            client.battery()
        process.send_signal(sent)
        assert process.wait(10) == 0
