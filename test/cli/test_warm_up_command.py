"""Kernels are compiled ahead, on all cores, with a line that says what and how far; each once.

What `pmcl warm-up` compiles is what a localisation needs: that of a shipped bag.
"""

import re
import subprocess
import sys
from pathlib import Path
from shutil import copytree, ignore_patterns

import click
import numpy as np
import pytest
from command_line import pmcl_process

from pmcl_ros.cli import main
from pmcl_ros.cli.warm_up import scene_stages
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.runtime import kernels
from pmcl_ros.warm_up import CHAIN, OTHER_MODES

BAG = Path(__file__).parents[2] / 'bags' / 'wine_glass'
AFTERWARDS = """
import atexit, sys
from pmcl_ros.cli import main
from pmcl_ros.runtime import kernels
compiled = []
kernels.report_to(compiled.append)
atexit.register(lambda: print('compiled:', *compiled))
main(['warm-up', '--all'], standalone_mode=False)
print('warmed up')
main(['report', *sys.argv[1:]])
"""
COUNTED = """
from pmcl_ros import warm_up
from pmcl_ros.runtime import kernels
print(kernels.progress(tuple(name for stage in warm_up.{0} for name in stage.kernels))[1])
"""
LACKING = {f'pmcl.render.gauss_newton.{name}' for name in ('_expand', '_slopes', '_motion')}


@pytest.fixture(scope='module')
def compiled_kernels():
    """The folder that all kernels are in."""
    pmcl_process('warm-up', '--all')
    return kernels.cache_folder()


@pytest.fixture
def cache(compiled_kernels, tmp_path, monkeypatch):
    """A function (patterns) that lets programs have a copy of that folder, without some files."""
    def without(*patterns):
        folder = tmp_path / 'cache' / 'kernels'
        monkeypatch.setenv('NUMBA_CACHE_DIR', str(folder.parent))
        return copytree(compiled_kernels, folder,
                        ignore=ignore_patterns('*.complete', '*.lock', *patterns))
    return without


def text_of(page, name):
    return re.search(f'id="{name}">(.*?)<', page).group(1)


def test_after_it_a_bag_is_reported_on_by_its_name_and_nothing_is_compiled(tmp_path, cache):
    folder = cache()  # as on a machine where no warm-up ran to its end
    assert pmcl_process('warm-up', '--all').stderr == ''  # all is there, which it finds out
    assert list(folder.glob('*.complete'))
    out = tmp_path / 'new' / 'glass.html'
    done = subprocess.run([sys.executable, '-c', AFTERWARDS, BAG, '-o', out], check=True,
                          capture_output=True, text=True)
    first, *_, path, compiled = done.stdout.splitlines()
    assert first == 'warmed up'
    assert 'compil' not in done.stderr
    assert path == str(out)
    assert compiled.split() == ['compiled:']
    page = out.read_text(encoding='utf-8')
    assert text_of(page, 'verdict') == 'Found'
    position = [float(text_of(page, name).removesuffix(' mm')) for name in 'xyz']
    assert np.linalg.norm(position - 1e3 * Truth.load(BAG / 'truth.json').pose[:3, 3]) < 20
    for told in ('A000000001', 'lytro_optical_frame', '9 x 9 of 328 x 328 px'):
        assert told in page


def test_no_command_takes_for_missing_what_is_compiled(compiled_kernels):
    for name in main.list_commands(click.Context(main)):
        assert main.get_command(click.Context(main), name)  # imported, with kernels of its own
    for stage in (*CHAIN, *OTHER_MODES, *scene_stages()):
        assert stage.mark(compiled_kernels).exists()


def started(*arguments):
    """(stdout, stderr) of a program."""
    done = subprocess.run([sys.executable, '-m', *map(str, arguments)], capture_output=True,
                          text=True, check=False)
    return done.stdout, done.stderr


@pytest.mark.parametrize(('stages', 'stream', 'arguments', 'result'), [
    ('SEARCH', 1, ('pmcl_ros.cli', 'coverage', '--trials', 1, '--near'), 'median error'),
    ('CHAIN', 1, ('pmcl_ros.cli', 'warm-up'), ''),
    ('CHAIN', 0, ('pmcl_ros.nodes.demo', '--bag', 'nowhere', '--out'), 'the demo failed')],
    ids=['command', 'warm-up', 'demo'])
def test_the_first_start_compiles_with_a_line_that_says_what_and_how_far(
        stages, stream, arguments, result, cache, tmp_path):
    cache('gauss_newton.*')
    if arguments[-1] == '--out':
        arguments = *arguments, tmp_path / 'out'
    # Not here: other tests of this process have imported kernels that these programs do not.
    needed = int(subprocess.run([sys.executable, '-c', COUNTED.format(stages)], check=True,
                                capture_output=True, text=True).stdout)
    first = started(*arguments)
    lines = [each for each in first[stream].splitlines() if 'compil' in each]
    *progress, summary = lines
    assert progress
    for line in progress:
        count, total, name = re.fullmatch(r'compiling kernels: (\d+) of (\d+), (\S+)',
                                          line).groups()
        assert int(total) == needed
        assert 0 < int(count) < needed
        assert name in LACKING
    assert re.fullmatch(rf'compiled {len(LACKING)} kernels in \d+ s', summary)
    assert 'compil' not in first[1 - stream]
    assert result in first[0]
    second = started(*arguments)
    assert 'compil' not in ''.join(second)
    assert result in second[0]
