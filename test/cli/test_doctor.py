"""`pmcl doctor` says what is true of this machine, and of machines made worse."""

import os
import socket
import subprocess
import sys
from pathlib import Path

from pmcl_ros.cli import doctor

PMCL = Path(sys.executable).with_name('pmcl')


def run(*arguments, **environment):
    return subprocess.run([PMCL, 'doctor', *arguments], capture_output=True, text=True,
                          env=os.environ | environment, timeout=300)


def test_nothing_is_wrong_where_the_tests_run():
    with socket.create_server(('127.0.0.1', 0)) as camera:
        done = run('--camera', f'127.0.0.1:{camera.getsockname()[1]}')
    assert done.returncode == 0, done.stdout + done.stderr
    lines = [line for line in done.stdout.splitlines() if not line.startswith(' ')]
    assert [line[6:].split(':')[0] for line in lines] == [
        'Python', 'packages', 'numba', 'OpenGL', 'memory', 'shared memory', 'ROS 2', 'camera']
    assert 'rmw_fastrtps_cpp' in done.stdout


def test_what_is_wrong_is_told_with_a_remedy():
    done = run('--camera', '127.0.0.1:1', RMW_IMPLEMENTATION='rmw_of_nobody')
    assert done.returncode == 1
    wrong = [line for line in done.stdout.splitlines() if line.startswith('WRONG')]
    assert [line[6:].split(':')[0] for line in wrong] == ['ROS 2', 'camera']
    assert 'RMW_IMPLEMENTATION must name a middleware' in done.stdout
    assert 'its Wi-Fi switched on' in done.stdout


def test_a_full_or_missing_shared_memory_is_a_note(tmp_path):
    assert doctor.shared_memory(tmp_path / 'none').verdict == 'note'
    full = doctor.shared_memory(tmp_path, 2**60)
    assert full.verdict == 'note'
    assert '--shm-size' in full.advice


def test_without_libegl_the_processor_draws():
    # the loader finds no vendor's driver
    script = ('from pmcl_ros.cli.doctor import opengl; found = opengl(); '
              'print(found.verdict, found.advice)')
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True,
                          env=os.environ | {'__EGL_VENDOR_LIBRARY_DIRS': '/nowhere',
                                            '__EGL_VENDOR_LIBRARY_FILENAMES': '/nowhere.json'})
    assert done.stdout.startswith('note no headless OpenGL 4.3 context'), done.stderr
    assert 'apt-get install libegl1' in done.stdout
