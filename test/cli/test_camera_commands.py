"""`pmcl camera`, as users call it: a camera in a real process, over real sockets."""

import signal
import time

import pytest
from click.testing import CliRunner
from simulated_cameras import SIDE, serving, write_captures

from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.camera.simulated.server import served
from pmcl_ros.cli import main


def pmcl_camera(*arguments):
    return CliRunner().invoke(main, ['camera', *map(str, arguments)])


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


@pytest.mark.parametrize(('arguments', 'reason'), [
    (['serve', '--pictures', '.', '--fault', 'nothing'], 'no fault'),
    (['serve', '--pictures', '/nonexistent'], 'does not exist'),
    (['capture'], '--out'),
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
