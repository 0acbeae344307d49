"""Machine code is kept, made anew when something it depends on changes, and made once."""

import io
import logging
import multiprocessing
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path

import numba
import numpy as np
import pytest
from dlv_fields import make_grid, noise_field

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evidence.edges import build_edges
from pmcl_ros.runtime import kernels
from pmcl_ros.runtime.kernels import compiled

RUNTIME = Path(kernels.__file__).parent
_FORK = multiprocessing.get_context('fork')
CALLER = """
import sys
from typing import NamedTuple
from pmcl_ros.inner import inner
from pmcl_ros.runtime import kernels

class Size(NamedTuple):
    width: float
    height: float

@kernels.compiled()
def outer(x, size):
    return inner(x) + size.width

names = []
with kernels.reporting(names.append):
    print(outer(1.0, Size(0.0, 5.0)), *names, sep=',')
"""
INNER = """
from pmcl_ros.constant import SUMMAND
from pmcl_ros.runtime import kernels

@kernels.compiled()
def inner(x):
    return x + SUMMAND
"""


def package_in(folder):
    """A package of this name with `kernels`, its threads and files of the test alone."""
    package = folder / 'pmcl_ros'
    (package / 'runtime').mkdir(parents=True)
    (package / '__init__.py').touch()
    for name in 'kernels.py', 'kernel_threads.py':
        shutil.copy(RUNTIME / name, package / 'runtime')
    (package / 'outer.py').write_text(CALLER)
    (package / 'inner.py').write_text(INNER)
    (package / 'constant.py').write_text('SUMMAND = 1\n')
    return package


@pytest.fixture
def package(tmp_path):
    """It, with nothing compiled."""
    return package_in(tmp_path)


@pytest.fixture(scope='module')
def used_package(tmp_path_factory):
    package = package_in(tmp_path_factory.mktemp('used'))
    assert outer(package) == (2, ['outer.outer', 'inner.inner'])
    return package


@pytest.fixture
def compiled_package(used_package, tmp_path):
    """A copy of it, with the machine code beside the source."""
    return shutil.copytree(used_package, tmp_path / 'pmcl_ros')


def start(package, **environment):
    """A process that imports the caller: forked, as importing numba takes longer than all else."""
    receiver, sender = _FORK.Pipe(duplex=False)
    _FORK.Process(target=_import, args=(package, environment, sender), daemon=True).start()
    sender.close()
    return receiver


def _import(package, environment, sender):
    """Import the package's caller in place of this process's own package of that name."""
    for name in [each for each in sys.modules if each.partition('.')[0] == 'pmcl_ros']:
        del sys.modules[name]
    for logger in (logging.root, logging.getLogger('pmcl_ros')):
        logger.handlers.clear()  # as in a new process: warnings go to stderr
    sys.path.insert(0, str(package.parent))
    sys.dont_write_bytecode = True  # it would outlive an edit within the same second
    os.environ.update({'NUMBA_CACHE_DIR': ''} | environment)
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as log:
        import_module('pmcl_ros.outer')
    sender.send((out.getvalue(), log.getvalue()))


def finish(process):
    """What the kernel gives, the names of what was compiled, and what was logged."""
    assert process.poll(120)
    out, log = process.recv()
    value, *names = out.strip().split(',')
    return float(value), names, log


def outer(package, **environment):
    value, names, log = finish(start(package, **environment))
    assert not log
    return value, names


def rename(path, old, new):
    path.write_text(path.read_text().replace(old, new))


def test_what_is_on_disk_is_not_compiled(compiled_package):
    assert outer(compiled_package) == (2, [])


@pytest.mark.parametrize(('file', 'old', 'new', 'value', 'compiled'), [
    ('inner.py', 'x + SUMMAND', 'x + 2 * SUMMAND', 3, 2),
    ('constant.py', '1', '4', 5, 2),  # though it holds no kernel
    ('outer.py', 'inner(x) +', '3 * inner(x) +', 6, 1),  # not what it calls
    ('outer.py', '    width: float\n    height: float', '    height: float\n    width: float',
     7, 1),
    ('outer.py', 'Size', 'Extent', 2, 1),
    ('inner.py', '    return', '    """Says what it does."""\n    return', 2, 0),
    ('outer.py', 'import sys\n', 'import sys\nLATER = 1\n\n', 2, 0),
])
def test_an_edit_recompiles_what_depends_on_it(compiled_package, file, old, new, value, compiled):
    rename(compiled_package / file, old, new)
    found, names = outer(compiled_package)
    assert (found, len(names)) == (value, compiled)


def test_what_was_compiled_before_an_edit_is_found_when_the_edit_is_undone(compiled_package):
    rename(compiled_package / 'constant.py', '1', '2')
    outer(compiled_package)
    rename(compiled_package / 'constant.py', '2', '1')
    assert outer(compiled_package) == (2, [])


def test_what_one_version_of_numba_compiled_outlives_another_in_the_same_folder(
        compiled_package, monkeypatch):
    monkeypatch.setattr(numba, '__version__', '0.1')
    assert outer(compiled_package) == (2, ['outer.outer', 'inner.inner'])
    monkeypatch.undo()
    assert outer(compiled_package) == (2, [])


def test_the_same_sources_in_another_folder_need_no_compiling(package, tmp_path):
    cache = str(tmp_path / 'cache')
    outer(package, NUMBA_CACHE_DIR=cache)
    moved = shutil.copytree(package, tmp_path / 'elsewhere' / 'pmcl_ros',
                            ignore=shutil.ignore_patterns('__pycache__'))
    os.utime(moved / 'inner.py', (0, 0))
    assert outer(moved, NUMBA_CACHE_DIR=cache) == (2, [])


def test_processes_that_start_together_compile_each_kernel_once(package):
    both = [start(package) for _ in range(4)]
    compiled = [name for each in both for name in finish(each)[1]]
    assert sorted(compiled) == ['inner.inner', 'outer.outer']
    assert not list(package.rglob('*.lock'))


def test_the_folder_that_is_asked_for_is_used(package, tmp_path):
    folder = tmp_path / 'mine'
    outer(package, NUMBA_CACHE_DIR=str(folder))
    assert list(folder.rglob('*.nbc'))
    assert not list(package.rglob('*.nbc'))


def test_without_a_folder_everything_works_and_it_is_said_once(package):
    for _ in range(2):
        value, names, log = finish(start(package, NUMBA_CACHE_DIR='/proc/nowhere'))
        assert (value, len(names)) == (2, 2)
        assert log.count('/proc/nowhere cannot be written') == 1


def test_a_full_disk_is_reported_and_the_result_is_right(package, tmp_path):
    folder = tmp_path / 'cache'
    (folder / 'kernels').mkdir(parents=True)
    limited = f'ulimit -f 0; exec {sys.executable} -c "import pmcl_ros.outer"'
    done = subprocess.run(['bash', '-c', limited], cwd=package.parent, capture_output=True,
                          text=True, env=os.environ | {'PYTHONPATH': '',
                                                       'NUMBA_CACHE_DIR': str(folder)})
    assert done.stdout.startswith('2.0,')
    assert 'cannot keep the compiled kernel inner.inner' in done.stderr


def test_a_function_without_a_file_is_compiled():
    names = {'__name__': 'nowhere'}
    exec('def twice(x): return 2 * x', names)
    assert compiled()(names['twice'])(21) == 42


def test_an_inner_kernel_is_for_kernels_only_and_is_compiled_once_for_all_literals():
    @compiled(inner=True)
    def times(x, factor):
        return x * factor

    @compiled()
    def outer(x):
        return times(x, 2) + times(x, 3) + times(x, len('four'))

    for _ in range(2):
        with pytest.raises(TypeError, match='times is for other kernels only'):
            times(5, 2)
        assert outer(5) == 45
    assert len(times.signatures) == 1


def test_progress_counts_what_is_on_disk():
    count, total = kernels.progress()

    @compiled()
    def thrice(x):
        return 3 * x

    assert kernels.progress()[1] == total + 1
    assert thrice(5) == 15
    assert kernels.progress()[0] == count + 1


def test_two_threads_may_build_at_once():
    fields = [noise_field(make_grid((3, 3), (40, 32), 0.006), seed) for seed in range(4)]
    options = DlvSettings(labels=9, views=3, edge_labels=3, truncate=True)

    def build(field):
        return build_volume(field, options).likelihood, build_edges(field, options).tensor

    alone = [build(field) for field in fields]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(build, fields))
    for one, other in zip(alone, together, strict=True):
        for here, there in zip(one, other, strict=True):
            np.testing.assert_array_equal(here, there)


PLAIN = """
import numpy as np
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer, tiny_scene
scene, edges = tiny_scene()
poses = np.tile(np.eye(4), (3, 1, 1))
print(NumbaRenderer().depths(scene, poses).sum())
with NumbaRenderer().contour_score(scene, edges, ContourProfile.contrast()) as score:
    print(*score.evaluate(poses).ravel())
"""


def test_kernels_can_be_stepped_through_as_plain_python():
    with redirect_stdout(io.StringIO()) as here:
        exec(PLAIN, {})
    elsewhere = subprocess.run([sys.executable, '-c', PLAIN], check=True, capture_output=True,
                               text=True, env=os.environ | {'NUMBA_DISABLE_JIT': '1'}).stdout
    compiled_ones, plain = (np.array(each.split(), float)
                            for each in (here.getvalue(), elsewhere))
    assert compiled_ones.any()
    np.testing.assert_allclose(plain, compiled_ones, rtol=1e-5)
