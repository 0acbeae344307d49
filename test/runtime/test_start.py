"""Entry points where something is missing: one message, with the command that installs it."""

import os
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import pytest

from pmcl_ros.runtime import requirements
from pmcl_ros.runtime.requirements import install_command, installed
from pmcl_ros.runtime.start import MODULES

ROOT = Path(__file__).parents[2]

# A machine without some packages, as Ubuntu 24.04's own Python: their files, and what pip knows.
WITHOUT = """
import sys, importlib.metadata as metadata
missing, old = {missing!r}, {old!r}
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in missing:
            raise ModuleNotFoundError('No module named ' + repr(name), name=name)
sys.meta_path.insert(0, Missing())
found = metadata.version
def version(name):
    if name in missing:
        raise metadata.PackageNotFoundError(name)
    return old.get(name) or found(name)
metadata.version = version
sys.argv = {words!r}
from pmcl_ros.runtime.start import {name}
sys.exit({name}())
"""


def run(words, missing=(), **old):
    name = words.split()[0]
    script = WITHOUT.format(missing=missing, old=old, words=words.split(), name=name)
    return subprocess.run([sys.executable, '-c', script], capture_output=True, text=True,
                          check=False, cwd=ROOT)


@pytest.mark.parametrize('words', ['pmcl localize --help', 'dlv_node', 'pmcl_bringup --help'])
def test_every_entry_point_names_what_is_missing_and_the_command(words):
    done = run(words, ('numba', 'pydantic'), rich='1.0')
    assert done.returncode == 1
    name, *_ = words.split()
    told, advice = done.stderr.splitlines()
    assert told == (f'{name}: not installed, or too old: numba>=0.61, pydantic>=2.7, '
                    'rich>=13.7 (here is 1.0)')
    assert advice.endswith("-m pip install 'numba>=0.61' 'pydantic>=2.7' 'rich>=13.7'")


@pytest.fixture
def old_pydantic(tmp_path):
    """The environment of a Python that finds a pydantic without the names of version 2."""
    (tmp_path / 'pydantic').mkdir()
    (tmp_path / 'pydantic' / '__init__.py').write_text(''.join(
        f'class {name}: pass\n' for name in ('BaseModel', 'ConfigDict', 'ValidationError')))
    info = tmp_path / 'pydantic-1.10.14.dist-info'
    info.mkdir()
    (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: pydantic\nVersion: 1.10.14\n')
    return os.environ | {'PYTHONPATH': f'{tmp_path}:{ROOT}'}


@pytest.mark.parametrize('name', MODULES)
def test_every_entry_point_says_that_ubuntu_s_pydantic_is_too_old(old_pydantic, name):
    script = f'import sys; from pmcl_ros.runtime.start import {name}; sys.exit({name}())'
    command = ['localize'] if name == 'pmcl' else []  # its help needs no package
    done = subprocess.run([sys.executable, '-c', script, *command], capture_output=True,
                          text=True, check=False, env=old_pydantic)
    assert (done.returncode, done.stdout) == (1, '')
    told, advice = done.stderr.splitlines()
    assert told == f'{name}: not installed, or too old: pydantic>=2.7 (here is 1.10.14)'
    assert advice.endswith("-m pip install 'pydantic>=2.7'")


@pytest.fixture
def without_ros(tmp_path):
    """The environment of a Python that finds no rclpy."""
    (tmp_path / 'sitecustomize.py').write_text("import sys\nsys.modules['rclpy'] = None\n")
    return os.environ | {'PYTHONPATH': f'{tmp_path}:{ROOT}'}


@pytest.mark.parametrize('words', [
    *(['-c', f'import sys; from pmcl_ros.runtime.start import {name}; sys.exit({name}())']
      for name in MODULES if name != 'pmcl'),
    ['-m', 'pmcl_ros.nodes.demo'], ['-m', 'pmcl_ros.nodes.runtime.loopback'],
    ['-m', 'pmcl_ros.cli', 'bench', 'graph']])
def test_every_program_that_needs_ros_says_so_in_one_line(without_ros, words):
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False,
                          env=without_ros)
    assert (done.returncode, done.stdout) == (1, '')
    told, = done.stderr.splitlines()
    assert told.removeprefix('Error: ') == (
        "ROS 2 is not there (no rclpy): pip install '.[ros]' in the source tree, or source the "
        'setup.bash of a full ROS 2 Jazzy; pmcl works without it')


def test_without_ros_a_file_of_tests_that_needs_it_is_an_error_and_others_run(
        without_ros, tmp_path):
    (tmp_path / 'test_a.py').write_text('import pmcl_ros.nodes.graph\n')
    (tmp_path / 'test_b.py').write_text('def test():\n    pass\n')
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '--rootdir', tmp_path,
         '--continue-on-collection-errors', tmp_path],
        capture_output=True, text=True, check=False, env=without_ros)
    assert done.returncode == 1
    assert '1 passed, 1 error' in done.stdout
    assert 'INTERNALERROR' not in done.stdout


def test_an_opencv_of_the_distribution_which_pip_does_not_know_counts(monkeypatch):
    def unknown(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(requirements, 'version', unknown)
    assert installed('opencv-python-headless>=4.6.0')
    assert not installed('opencv-python-headless>=999')
    assert not installed('no-such-package>=1')
    monkeypatch.setitem(sys.modules, 'cv2', None)  # as where it cannot be imported
    assert not installed('opencv-python-headless>=4.6.0')


def test_the_doctor_works_without_them():
    done = run('pmcl doctor', ('numba', 'pydantic', 'moderngl', 'zeroconf'))
    assert done.returncode == 1
    wrong, advice = done.stdout.splitlines()[1:]
    assert wrong.startswith('WRONG packages: missing or too old: numba>=0.61')
    assert advice.strip().endswith("'zeroconf>=0.131'")
    assert done.stderr == ''


def test_where_nothing_is_missing_they_start_and_other_errors_are_raised():
    done = run('pmcl --version')
    assert (done.returncode, done.stdout.split()[-1]) == (0, version('pmcl_ros'))
    done = run('pmcl localize --help', ('pmcl_ros.cli.localization', 'json'))
    assert "No module named 'json'" in done.stderr


def test_the_systems_python_is_left_alone(monkeypatch):
    monkeypatch.setattr(sys, 'prefix', sys.base_prefix)
    assert ' -m venv --system-site-packages ' in install_command(['numba>=0.61'])


def test_setup_names_each_of_them():
    text = (ROOT / 'setup.py').read_text()
    assert all(f"'{name}'" in text for name in MODULES)


@pytest.mark.parametrize(('requirement', 'there'), [
    ('numpy>=1.26', True), ('numpy>=999', False), ('no-such-package>=1', False),
    ('numpy', True), (f'numpy=={version("numpy")}', True), *(
        (each, True) for each in requires('pmcl_ros') if 'extra' not in each)])
def test_packages_are_compared_by_version(requirement, there):
    assert installed(requirement) is there


def test_an_interrupt_among_the_imports_ends_without_a_trace(tmp_path):
    for name, library in (('pmcl', 'click'), ('dlv_node', 'numpy')):
        (tmp_path / f'{library}.py').write_text(
            'import signal, time; signal.raise_signal(signal.SIGINT); time.sleep(60)\n')
        done = subprocess.run(
            [sys.executable, '-c', f'import signal, sys\nsys.path.insert(0, {str(tmp_path)!r})\n'
             # Jobs in the background begin with it ignored.
             'signal.signal(signal.SIGINT, signal.default_int_handler)\n'
             f'from pmcl_ros.runtime.start import start\nsys.exit(start({name!r}))'],
            capture_output=True, text=True, check=False, cwd=ROOT)
        assert (done.returncode, done.stderr) == (130, '')


@pytest.mark.parametrize('words', [[], ['dlv_nod', '--ros-args']])
def test_a_name_that_is_no_entry_point_is_told_in_one_line(words):
    done = subprocess.run([sys.executable, '-m', 'pmcl_ros.runtime.start', *words],
                          capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 1
    told, = done.stderr.splitlines()
    assert told.startswith('expected one of lytro_driver, subaperture_node, ')
    assert told.endswith(f'given: {" ".join(words) or "nothing"}')


def test_an_entry_point_is_started_by_its_name():
    done = subprocess.run([sys.executable, '-m', 'pmcl_ros.runtime.start', 'pmcl', '--help'],
                          capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert 'calibrate-camera' in done.stdout


def test_the_name_of_a_file_that_is_no_utf_8_is_printed_as_it_is(tmp_path):
    """As in most locales, where Python's standard output takes UTF-8 alone."""
    out = os.fsencode(tmp_path) + b'/f\xe9.yaml'
    done = subprocess.run(
        [sys.executable, '-m', 'pmcl_ros.cli', 'sweep', 'plan', '--distance', '1', '--resolution',
         '0.01', '--fx', '500', '-o', out], capture_output=True, check=False, cwd=ROOT,
        env=os.environ | {'PYTHONIOENCODING': 'utf-8:strict'})
    assert done.returncode == 0, done.stderr
    assert out in done.stdout
    assert Path(os.fsdecode(out)).is_file()
