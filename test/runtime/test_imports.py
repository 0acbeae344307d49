"""Imports do not look for garbage among what stays; nor does what comes after them."""

import gc
import subprocess
import sys

import pytest

from pmcl_ros.runtime.imports import imported

# Enough for Python to look for garbage again and again.
MANY = 'kept = [[each] for each in range(100_000)]\n'
PROGRAM = """
import atexit, gc, sys
from pmcl_ros.runtime.start import start
oldest = []
gc.callbacks.append(lambda phase, of: oldest.append(phase) if of['generation'] == 2 else None)
atexit.register(lambda: print(gc.get_freeze_count(), len(gc.get_objects()), len(oldest)))
sys.argv = sys.argv[1:]
sys.exit(start(sys.argv[0]))
"""


@pytest.fixture
def collections(monkeypatch):
    """A list that grows with each collection."""
    seen = []

    def note(phase, info):
        seen.append(phase)

    gc.callbacks.append(note)
    yield seen
    gc.callbacks.remove(note)


def test_a_module_is_imported_without_collections_and_is_not_looked_at_later(
        tmp_path, monkeypatch, collections):
    for name in ('plain_module', 'frozen_module'):
        (tmp_path / f'{name}.py').write_text(MANY)
    monkeypatch.syspath_prepend(tmp_path)
    import plain_module
    assert collections
    assert gc.is_tracked(plain_module.kept)
    collections.clear()
    module = imported('frozen_module')
    assert not collections
    assert gc.isenabled()
    assert len(module.kept) == 100_000
    assert not any(each is module.kept for each in gc.get_objects())
    before = gc.get_freeze_count()
    made = [[each] for each in range(10)]
    assert imported('frozen_module') is module
    assert gc.get_freeze_count() == before
    assert any(each is made for each in gc.get_objects())


@pytest.mark.parametrize('enabled', [True, False])
def test_collections_go_on_as_before_where_a_module_is_wrong(tmp_path, monkeypatch, enabled):
    (tmp_path / 'wrong_module.py').write_text('1 / 0')
    monkeypatch.syspath_prepend(tmp_path)
    if not enabled:
        gc.disable()
    try:
        with pytest.raises(ZeroDivisionError):
            imported('wrong_module')
        assert gc.isenabled() is enabled
    finally:
        gc.enable()


@pytest.mark.parametrize(('arguments', 'status'), [
    (['pmcl', 'localize', '--help'], 0),
    (['dlv_node', '--ros-args', '--params-file', 'none.yaml'], 1)])
def test_nearly_all_there_is_when_a_program_starts_is_not_looked_at(arguments, status):
    if arguments[0] != 'pmcl':
        pytest.importorskip('rclpy')
    done = subprocess.run([sys.executable, '-c', PROGRAM, *arguments], capture_output=True,
                          text=True, check=False)
    assert done.returncode == status, done.stderr
    frozen, others, oldest = map(int, done.stdout.splitlines()[-1].split())
    assert frozen > 10 * others
    assert oldest == 0
