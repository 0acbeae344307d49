"""A command overwrites its own results, and nobody else's files."""

import json
import os
import resource
import signal
import sys
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from pmcl_ros.lightfield.readers.npz import save_npz
from pmcl_ros.runtime.errors import FileError, OutputError
from pmcl_ros.runtime.outputs import Results, replacing, write_file

NOTE = '.pmcl_results.json'
NOBODY = 65534


def write(folder, text, command='decode', force=False, name='a.txt'):
    with Results(folder, command, force) as results:
        results.path(name).write_text(text)


def test_own_results_are_written_again(tmp_path):
    folder = tmp_path / 'new' / 'out'
    for text in ('one', 'two', 'three'):
        write(folder, text, name='0/a.txt')
        assert (folder / '0' / 'a.txt').read_text() == text


def test_what_another_wrote_is_refused_and_kept(tmp_path):
    file = tmp_path / 'a.txt'
    file.write_text('mine')
    for _ in range(2):
        with pytest.raises(OutputError, match=r'a\.txt is there already.*--force'):
            write(tmp_path, 'result')
    assert file.read_text() == 'mine'
    write(tmp_path, 'result', force=True)
    write(tmp_path, 'result of another run')  # its own by now
    with pytest.raises(OutputError):
        write(tmp_path, 'result', command='lattice')
    file.write_text('changed by hand')
    with pytest.raises(OutputError):
        write(tmp_path, 'result')
    assert file.read_text() == 'changed by hand'


def test_what_is_forced_is_its_own_also_where_it_is_the_same(tmp_path):
    (tmp_path / 'a.txt').write_text('result')
    os.utime(tmp_path / 'a.txt', (0, 0))
    write(tmp_path, 'result', force=True)
    write(tmp_path, 'result')


def test_a_file_holds_what_is_written_and_one_that_cannot_be_written_is_named(tmp_path):
    write_file(tmp_path / 'a.txt', 'Größe\n')
    assert (tmp_path / 'a.txt').read_bytes() == 'Größe\n'.encode()
    write_file(tmp_path / 'a.txt', os.fsdecode(b'ph\xff'))  # the name of a file
    assert (tmp_path / 'a.txt').read_bytes() == rb'ph\udcff'
    write_file(str(tmp_path / 'a.txt'), b'\0\xff')
    assert (tmp_path / 'a.txt').read_bytes() == b'\0\xff'
    write_file(tmp_path / 'new' / 'out' / 'a.txt', b'\0')
    assert (tmp_path / 'new' / 'out' / 'a.txt').read_bytes() == b'\0'
    for path, why in ((tmp_path / 'a.txt' / 'b.txt', f"{tmp_path / 'a.txt'} is no folder"),
                      (tmp_path, 'Is a directory'), ('/dev/full', 'No space left on device')):
        with pytest.raises(OutputError) as told:
            write_file(path, 'text')
        assert str(told.value) == f'cannot write {path}: {why}'


def limited(written, room):
    """Let a process write `room` bytes to a file, as on a disk that becomes full."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
    try:
        written()
    except OutputError as error:
        sys.stderr.write(str(error))
        os._exit(3)
    os._exit(0)


def by_npz(path):
    save_npz(path, values=np.random.default_rng(0).random(10_000))


@pytest.mark.parametrize('write', [lambda path: write_file(path, b'x' * 10_000), by_npz],
                         ids=['file', 'npz'])
@pytest.mark.parametrize('before', [None, b'mine'])
def test_what_cannot_be_written_whole_leaves_all_as_it_was(tmp_path, write, before):
    """Nor does a link become a file, nor a file that others may not read one that they may."""
    path, real = tmp_path / 'link', tmp_path / 'real'
    path.symlink_to(real)
    if before is not None:
        real.write_bytes(before)
        real.chmod(0o600)
    writing = get_context('fork').Process(target=limited, args=(lambda: write(path), 5000))
    writing.start()
    writing.join()
    assert writing.exitcode == 3
    there = {each.name: each.read_bytes() for each in tmp_path.iterdir() if each.exists()}
    assert there == ({} if before is None else {'link': before, 'real': before})
    write(path)
    assert path.is_symlink()
    assert {each.name for each in tmp_path.iterdir()} == {'link', 'real'}
    assert len(real.read_bytes()) >= 10_000
    if before is not None:
        assert real.stat().st_mode & 0o777 == 0o600


def test_a_file_in_a_folder_that_may_not_be_changed_is_written():
    def written():
        os.setuid(user)  # root may change all
        write_file(path, 'text')

    user = os.getuid() or NOBODY
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'a.txt'
        path.write_text('mine')
        os.chown(path, user, -1)
        Path(folder).chmod(0o555)
        writing = get_context('fork').Process(target=written)
        writing.start()
        writing.join()
        assert writing.exitcode == 0
        assert path.read_text() == 'text'
        Path(folder).chmod(0o755)


def test_a_file_that_may_not_be_written_stays():
    """Though its folder may be."""
    def written():
        os.setuid(user)  # root may write all
        limited(lambda: write_file(path, 'text'), 5000)

    user = os.getuid() or NOBODY
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'a.txt'
        path.write_text('mine')
        path.chmod(0o444)
        for each in (folder, path):
            os.chown(each, user, -1)
        writing = get_context('fork').Process(target=written)
        writing.start()
        writing.join()
        assert writing.exitcode == 3
        assert [each.name for each in Path(folder).iterdir()] == ['a.txt']
        assert path.read_text() == 'mine'


def test_what_is_interrupted_leaves_all_as_it_was(tmp_path):
    path = tmp_path / 'a.txt'
    path.write_text('mine')

    def written():
        with replacing(path) as part:
            part.write_text('half')
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        written()
    assert [each.name for each in tmp_path.iterdir()] == ['a.txt']
    assert path.read_text() == 'mine'


def test_a_device_is_written_itself(tmp_path):
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_file(pipe, 'text')
    assert os.read(reader, 10) == b'text'
    os.close(reader)
    assert [each.name for each in tmp_path.iterdir()] == ['pipe']
    ends = os.pipe()  # as of `-o /dev/stdout | less` and `-o >(less)`
    write_file(f'/dev/fd/{ends[1]}', 'text')
    assert os.read(ends[0], 10) == b'text'
    for each in ends:
        os.close(each)
    with (tmp_path / 'log').open('w') as log:  # as of `-o /dev/stdout > log`
        write_file(f'/dev/fd/{log.fileno()}', 'text')
        log.seek(4)
        log.write(' and more')
    assert (tmp_path / 'log').read_text() == 'text and more'


@pytest.mark.parametrize('there', ['folder', 'link'])
def test_what_is_no_file_is_refused(tmp_path, there):
    path = tmp_path / 'a.txt'
    if there == 'folder':
        path.mkdir()
    else:
        path.symlink_to(tmp_path / 'nowhere')
    with pytest.raises(OutputError):
        write(tmp_path, 'result')
    assert not (tmp_path / 'nowhere').exists()


def test_a_run_that_wrote_nothing_makes_nothing_its_own(tmp_path):
    (tmp_path / 'a.txt').write_text('mine')
    with Results(tmp_path, 'decode', force=True) as results:
        results.reserve('a.txt', 'b.txt')
    (tmp_path / 'b.txt').write_text('mine')
    for name in ('a.txt', 'b.txt'):
        with pytest.raises(OutputError):
            write(tmp_path, 'result', name=name)


def test_a_folder_that_was_made_for_nothing_goes(tmp_path):
    for folder in (tmp_path, tmp_path / 'new'):
        with Results(folder, 'decode') as results:
            results.reserve('a.txt')
            assert (folder / NOTE).exists()
    assert not list(tmp_path.iterdir())


def test_a_run_that_was_killed_is_repeated(tmp_path):
    Results(tmp_path, 'decode').path('a.txt').write_text('half')  # it never ended
    write(tmp_path, 'whole')
    assert (tmp_path / 'a.txt').read_text() == 'whole'


def test_a_run_that_failed_is_repeated(tmp_path):
    def fail():
        with Results(tmp_path, 'decode') as results:
            results.path('a.txt').write_text('half')
            raise ArithmeticError

    with pytest.raises(ArithmeticError):
        fail()
    write(tmp_path, 'whole')
    (tmp_path / 'a.txt').write_text('mine')
    with pytest.raises(OutputError):
        write(tmp_path, 'result')


def test_what_a_killed_run_would_have_written_is_not_its_own_for_ever(tmp_path):
    Results(tmp_path, 'decode').reserve('a.txt', 'b.txt')  # it never ended, nor wrote them
    write(tmp_path, 'whole')
    (tmp_path / 'b.txt').write_text('mine')
    with pytest.raises(OutputError):
        write(tmp_path, 'result', name='b.txt')
    assert (tmp_path / 'b.txt').read_text() == 'mine'


@pytest.mark.parametrize('remove', [Results.remove_earlier, Results.remove_others])
def test_what_earlier_runs_wrote_and_nobody_changed_is_removed(tmp_path, remove):
    names = '0/a.txt', '0/b.txt', '1/a.txt', 'c.txt', 'again.txt'
    with Results(tmp_path, 'decode') as results:
        for name in names:
            results.path(name).write_text(name)
    write(tmp_path, 'of another', command='localize', name='d.txt')
    (tmp_path / '0' / 'b.txt').write_text('mine')
    with Results(tmp_path, 'decode') as results:
        results.path('again.txt')
        remove(results)
    left = {each.relative_to(tmp_path).as_posix() for each in tmp_path.rglob('*')}
    assert left - {'again.txt'} == {'0', '0/b.txt', 'd.txt', NOTE}
    assert ('again.txt' in left) == (remove is Results.remove_others)
    assert (tmp_path / '0' / 'b.txt').read_text() == 'mine'


def test_what_is_forced_stays_until_it_is_written(tmp_path):
    (tmp_path / 'a.txt').write_text('mine')
    with Results(tmp_path, 'decode', force=True) as results:
        results.path('a.txt')
        results.remove_earlier()
        results.remove_others()
    assert (tmp_path / 'a.txt').read_text() == 'mine'
    with pytest.raises(OutputError):  # it was not written after all
        write(tmp_path, 'result')


def test_commands_share_a_folder(tmp_path):
    with Results(tmp_path, 'decode') as one, Results(tmp_path, 'localize') as other:
        one.path('a.txt').write_text('a')
        other.path('b.txt').write_text('b')
    assert {name: list(each) for name, each in json.loads(
        (tmp_path / NOTE).read_text()).items()} == {'decode': ['a.txt'], 'localize': ['b.txt']}
    write(tmp_path, 'aa')
    write(tmp_path, 'bb', command='localize', name='b.txt')


@pytest.mark.parametrize(('text', 'error'), [
    ('[', FileError), ('[]', FileError), ('{"decode": 1}', OutputError)])
def test_a_damaged_note_is_told(tmp_path, text, error):
    (tmp_path / NOTE).write_text(text)
    with pytest.raises(error, match=r'\.pmcl_results\.json'):
        write(tmp_path, 'result')


def test_a_note_that_names_a_file_elsewhere_removes_nothing(tmp_path):
    (tmp_path / 'mine').write_text('x')
    folder = tmp_path / 'results'
    folder.mkdir()
    (folder / '.pmcl_results.json').write_text('{"scenes": {"../mine": null}}')
    with Results(folder, 'scenes') as out, pytest.raises(
            OutputError, match=r'names \.\./mine, which is not in its folder: delete'):
        out.remove_others()
    assert (tmp_path / 'mine').read_text() == 'x'
