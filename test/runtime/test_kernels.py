"""Machine code is kept, and made anew when a function that a kernel calls has changed."""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from dlv_fields import make_grid, noise_field

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.runtime.kernels import compiled

PACKAGE = Path(__file__).parents[2] / 'pmcl_ros'
CALLER = """
from pmcl_ros.inner import inner
from pmcl_ros.runtime.kernels import compiled

@compiled()
def outer(x):
    return inner(x)

print(outer(1.0), sum(outer.stats.cache_hits.values()))
"""
INNER = """
from pmcl_ros.runtime.kernels import compiled

@compiled()
def inner(x):
    return x + {}
"""


@pytest.fixture
def package(tmp_path):
    """A package of this name that holds nothing but `kernels` and two files of the test."""
    package = tmp_path / 'pmcl_ros'
    package.mkdir()
    (package / '__init__.py').touch()
    shutil.copy(PACKAGE / 'kernels.py', package)
    (package / 'outer.py').write_text(CALLER)
    (package / 'inner.py').write_text(INNER.format(1))
    return package


def outer(package, **environment):
    """What the kernel gives, and how often it was found on disk."""
    done = subprocess.run([sys.executable, '-m', 'pmcl_ros.outer'], cwd=package.parent,
                          capture_output=True, text=True, env=os.environ | environment)
    assert not done.returncode, done.stderr
    value, hits = done.stdout.split()
    return float(value), int(hits)


def test_a_changed_callee_is_not_found_on_disk(package):
    assert outer(package) == (2, 0)
    assert outer(package) == (2, 1)
    (package / 'inner.py').write_text(INNER.format(2))
    assert outer(package) == (3, 0)
    (package / 'inner.py').write_text(INNER.format(1))
    assert outer(package)[0] == 2


def test_the_folder_that_is_asked_for_is_used(package, tmp_path):
    folder = tmp_path / 'mine'
    outer(package, NUMBA_CACHE_DIR=str(folder))
    assert list(folder.rglob('*.nbc'))
    assert not list(package.rglob('*.nbc'))


def test_without_a_folder_everything_works(package):
    assert outer(package, NUMBA_CACHE_DIR='/proc/nowhere') == (2, 0)
    assert outer(package, NUMBA_CACHE_DIR='/proc/nowhere') == (2, 0)


def test_compiles_where_nothing_can_be_cached():
    names = {}
    exec('def twice(x): return 2 * x', names)  # a function without a file has no cache
    assert compiled()(names['twice'])(21) == 42


def test_two_threads_may_build_at_once():
    fields = [noise_field(make_grid((3, 3), (40, 32), 0.006), seed) for seed in range(4)]
    options = DlvSettings(labels=9, views=3, edge_labels=3, truncate=True)
    alone = [build_volume(field, options).likelihood for field in fields]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda field: build_volume(field, options).likelihood, fields))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)
