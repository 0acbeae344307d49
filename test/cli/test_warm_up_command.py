"""Kernels are compiled ahead, on all cores, with a line that says what and how far; each once.

What `pmcl warm-up` compiles is what a localisation needs: that of a shipped bag.
"""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest
from command_line import pmcl_process

from pmcl_ros.cli import main
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.runtime import kernels
from pmcl_ros.simulation.warm_up import LABELS, RAW_PICTURES, RENDER
from pmcl_ros.warm_up.chain import CHAIN, OTHER_MODES
from pmcl_ros.warm_up.raw import light_stages

ROOT = Path(__file__).parents[2]
BAG = ROOT / 'bags' / 'wine_glass'
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
from pmcl_ros.runtime import kernels
from pmcl_ros.warm_up import chain
for stages in chain.SEARCH, chain.CHAIN:
    print(kernels.progress(tuple(name for stage in stages for name in stage.kernels))[1])
"""
# Each command in a process of its own, forked once all is imported, which takes the time.
COMMANDS = """
import json, os, sys
import click
from pmcl_ros.cli import main
from pmcl_ros.runtime import kernels
for name in main.list_commands(click.Context(main)):
    main.get_command(click.Context(main), name)
for number, arguments in enumerate(json.loads(sys.argv[1])):
    if not os.fork():
        os.dup2(os.open(f'{number}.out', os.O_WRONLY | os.O_CREAT), 1)
        os.dup2(os.open(f'{number}.err', os.O_WRONLY | os.O_CREAT), 2)
        late = []
        kernels.report_to(late.append)
        try:
            main(arguments)
        finally:
            print('compiled late:', *late, file=sys.stderr)
    os.wait()
"""
LACKING = {f'pmcl.render.gauss_newton.{name}' for name in ('_expand', '_slopes', '_motion')}


@pytest.fixture(scope='module')
def compiled_kernels():
    """The folder that all kernels are in."""
    pmcl_process('warm-up', '--all')
    return kernels.cache_folder()


@pytest.fixture(scope='module')
def needed():
    """How many kernels each of the stages has, by its name."""
    # Not here: other tests of this process have imported kernels that programs do not.
    done = subprocess.run([sys.executable, '-c', COUNTED], check=True, capture_output=True,
                          text=True)
    return dict(zip(('SEARCH', 'CHAIN'), map(int, done.stdout.split()), strict=True))


@pytest.fixture
def cache(compiled_kernels, tmp_path, monkeypatch):
    """A function (patterns) that lets programs have a copy of that folder, without some files."""
    def without(*patterns):
        folder = tmp_path / 'cache' / 'kernels'
        monkeypatch.setenv('NUMBA_CACHE_DIR', str(folder.parent))
        return shutil.copytree(compiled_kernels, folder,
                               ignore=shutil.ignore_patterns('*.complete', '*.lock', *patterns))
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
    for stage in (*CHAIN, *OTHER_MODES, *light_stages(), *RENDER, *RAW_PICTURES, *LABELS):
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
        stages, stream, arguments, result, cache, needed, tmp_path):
    cache('gauss_newton.*')
    if arguments[-1] == '--out':
        arguments = *arguments, tmp_path / 'out'
    first = started(*arguments)
    lines = [each for each in first[stream].splitlines() if 'compil' in each]
    *progress, summary = lines
    assert progress
    for line in progress:
        count, total, name = re.fullmatch(r'compiling kernels: (\d+) of (\d+), (\S+)',
                                          line).groups()
        assert int(total) == needed[stages]
        assert 0 < int(count) < int(total)
        assert name in LACKING
    assert re.fullmatch(rf'compiled {len(LACKING)} kernels in \d+ s', summary)
    assert 'compil' not in first[1 - stream]
    assert result in first[0]
    second = started(*arguments)
    assert 'compil' not in ''.join(second)
    assert result in second[0]


@pytest.fixture
def commands(tmp_path):
    """Commands, and the kernels that each needs and those before do not.

    Some end with an error as soon as they read their data.
    """
    white = ROOT / 'config' / 'cameras' / 'demo_white'
    for suffix in ('.RAW.xz', '.TXT'):
        shutil.copy(white.with_suffix(suffix), tmp_path)
    for capture in (tmp_path / kind / 'glass' for kind in ('bare', 'posed')):
        capture.mkdir(parents=True)
        shutil.copy(BAG / 'truth.json', capture)
        shutil.copy(ROOT / 'models' / 'wine_glass.obj', capture / 'model.obj')
    pose = np.eye(4).tolist()
    views = Path('posed') / 'glass' / 'views.yaml'
    (tmp_path / views).write_text(json.dumps(
        {'cameras': {'wrist': {'width': 64, 'height': 48, 'fx': 60, 'cx': 31, 'cy': 23}},
         'views': [{'file': f'{each}.png', 'camera': 'wrist', 'camera_to_reference': pose}
                   for each in (1, 2)]}))
    return {
        ('localize', views, '--object', 'bare/glass/model.obj', '--depths', '0.3', '0.9',
         '--mode', 'faithful'): [],  # which needs a light field
        ('lattice', 'demo_white.RAW.xz', '-o', 'lattice'): ['packing._unpack'],
        ('scenes', 'sequence', '--frames', '1', '--occluded', '0', '--size', '64',
         '-o', 'sequence'): ['numba_renderer._draw_all'],
        ('profile', views, '--box', '0', '1', '1', '8', '8', '-o', 'a.yaml'): [
            'energies._judge'],
        ('evaluate', 'posed', '--trials', '1', '--processes', '1'): ['gauss_newton._expand'],
        ('learn', 'bare'): ['edges._differentiate']}


def test_other_commands_compile_what_they_need_before_they_begin(commands, cache, tmp_path,
                                                                 monkeypatch):
    cache(*(f'{name}-*' for names in commands.values() for name in names))
    monkeypatch.chdir(tmp_path)
    subprocess.run([sys.executable, '-c', COMMANDS, json.dumps(list(commands), default=str)],
                   check=True)
    for number, (arguments, names) in enumerate(commands.items()):
        said = Path(f'{number}.err').read_text(encoding='utf-8')
        *lines, late = [each for each in said.splitlines() if 'compil' in each]
        summary = re.sub(r'\d+ s$', 's', lines[-1]) if lines else ''
        assert summary == (f'compiled {len(names)} kernels in s' if names else ''), arguments
        assert late == 'compiled late:', arguments
        assert 'Traceback' not in said, arguments
    assert 'needs a light field' in Path('0.err').read_text(encoding='utf-8')
