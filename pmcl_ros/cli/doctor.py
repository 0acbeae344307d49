"""`pmcl doctor`: checks this machine for what the package needs, and advises."""

import os
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import click
from rich.console import Console

from pmcl_ros.runtime.errors import PmclError, RenderError
from pmcl_ros.runtime.requirements import described, install_command, lacking

Verdict = Literal['ok', 'note', 'wrong']

_SIGNS = {'ok': '[green]ok   [/]', 'note': '[yellow]note [/]', 'wrong': '[red]WRONG[/]'}
_PYTHONS = (3, 10), (3, 13)  # the first and the last that the wheels are made for
_SHARED = 128 << 20  # bytes: a volume and its edges, in the segments of the nodes that share them
_MEMORY = 3 << 30  # bytes that the four nodes take together, with room
_ROS_PATIENCE = 60.0  # s


@dataclass(frozen=True)
class Finding:
    """The result of one check.

    verdict: 'note': something works less well, or is needed by some users only.
    advice: what to do; empty where all is well.
    """

    what: str
    verdict: Verdict
    found: str
    advice: str = ''


@click.command()
@click.option('--camera', metavar='ADDRESS',
              help='Look for a Lytro too: HOST, HOST:PORT, or mdns.')
@click.pass_context
def doctor(context: click.Context, camera: str | None) -> None:
    """Check this machine: Python, packages, OpenGL, memory, ROS, and with --camera a camera.

    Exit status 1 when something is wrong; a note does not stop anything.
    """
    console = Console(highlight=False, soft_wrap=True)
    wrong = 0
    for finding in examine(camera):
        console.print(f'{_SIGNS[finding.verdict]} {finding.what}: ', end='')
        console.print(finding.found, markup=False)
        if finding.advice:
            console.print(f'      {finding.advice}', markup=False)
        wrong += finding.verdict == 'wrong'
    context.exit(int(wrong > 0))


def examine(camera: str | None = None) -> Iterator[Finding]:
    """Make all checks in turn; without its packages the rest cannot be checked.

    camera: HOST[:PORT[:CALLBACK_PORT]] or 'mdns'; None: no check of a camera.
    """
    yield python()
    needed = packages()
    yield needed
    if needed.verdict == 'wrong':
        return
    checks: list[Callable[[], Finding]] = [kernels, opengl, memory, shared_memory, ros]
    for check in checks:
        yield check()
    if camera is not None:
        yield lytro(camera)


def python() -> Finding:
    """Whether wheels exist for this Python."""
    found = '{}.{}.{}'.format(*sys.version_info)
    first, last = ('{}.{}'.format(*each) for each in _PYTHONS)
    if _PYTHONS[0] <= sys.version_info[:2] <= _PYTHONS[1]:
        return Finding('Python', 'ok', found)
    return Finding('Python', 'wrong', found, f'use one of {first} to {last}')


def packages() -> Finding:
    """Whether all requirements are installed, and new enough."""
    try:
        missing = lacking()
    except PackageNotFoundError:
        return Finding('packages', 'wrong', 'pmcl_ros itself is not installed',
                       'make venv, or pip install .')
    if missing:
        return Finding('packages', 'wrong', f'missing or too old: {described(missing)}',
                       install_command(missing))
    return Finding('packages', 'ok', 'all')


def kernels() -> Finding:
    """Whether the machine code of kernels can be kept on disk."""
    from pmcl_ros.runtime.kernels import cache_folder
    cores = len(os.sched_getaffinity(0))
    if cache_folder() is None:
        return Finding('numba', 'note', f'{cores} cores; no folder to keep machine code in',
                       'set NUMBA_CACHE_DIR to a folder that may be written, or every process '
                       'compiles anew')
    return Finding('numba', 'ok', f'{cores} cores')


def opengl() -> Finding:
    """Whether there is a headless OpenGL, and its renderer."""
    from pmcl_ros.runtime.gl import GlContext
    try:
        context = GlContext()
    except RenderError as error:
        return Finding('OpenGL', 'note', 'none: the processor draws', str(error))
    renderer = context.renderer
    context.close()
    return Finding('OpenGL', 'ok', renderer)


def memory() -> Finding:
    """Whether the nodes fit into the free memory."""
    text = Path('/proc/meminfo').read_text()
    found = re.search(r'MemAvailable: *(\d+) kB', text)
    free = 1024 * int(found[1]) if found else 0
    if free < _MEMORY:
        return Finding('memory', 'note', f'{free / 2**30:.1f} GiB free',
                       f'the nodes take up to {_MEMORY / 2**30:.0f} GiB together: end something, '
                       'or set crop and stride of dlv_node')
    return Finding('memory', 'ok', f'{free / 2**30:.1f} GiB free')


def shared_memory(folder: Path = Path('/dev/shm'), least: int = _SHARED) -> Finding:
    """Whether processes can hand volumes over by shared memory, of `least` bytes."""
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        return Finding('shared memory', 'note', f'{folder}: {error.strerror}',
                       'messages go by the loopback network')
    if free < least:
        return Finding('shared memory', 'note', f'{free / 2**20:.0f} MiB free in {folder}',
                       f'volumes want {least >> 20} MiB: in Docker --shm-size=512m or '
                       f'--ipc=host; else delete what dead processes left ({folder}/fastrtps_*)')
    return Finding('shared memory', 'ok', f'{free / 2**20:.0f} MiB free in {folder}')


def ros() -> Finding:
    """Whether two nodes hear each other."""
    if find_spec('rclpy') is None:
        return Finding('ROS 2', 'note', 'none: `pmcl` works, the nodes do not',
                       '. /opt/ros/jazzy/setup.bash, or without ROS on this machine: '
                       "pip install '.[ros]'")
    command = [sys.executable, '-m', 'pmcl_ros.nodes.runtime.loopback']
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_ROS_PATIENCE)
    except subprocess.TimeoutExpired:
        return Finding('ROS 2', 'wrong', f'no answer within {_ROS_PATIENCE:g} s', _MULTICAST)
    said = (done.stdout.strip() or done.stderr.strip()).splitlines() or ['no output']
    if done.returncode == 0:
        return Finding('ROS 2', 'ok', said[-1])
    if done.stdout:
        return Finding('ROS 2', 'wrong', f'no message arrives ({said[-1]})', _MULTICAST)
    return Finding('ROS 2', 'wrong', said[-1], 'RMW_IMPLEMENTATION must name a middleware that is '
                   'installed; Python and ROS must be of one kind (Jazzy: 3.12 on Ubuntu 24.04)')


def lytro(text: str) -> Finding:
    """Whether a camera takes connections; it gets no command."""
    from pmcl_ros.camera.lytro.address import find_camera
    try:
        address = find_camera(text)
        socket.create_connection((address.host, address.port), 3).close()
    except PmclError as error:
        return Finding('camera', 'wrong', 'not found', str(error))
    except OSError as error:
        return Finding('camera', 'wrong', f'{address}: {error.strerror or error}',
                       'is it on, its Wi-Fi switched on, and this machine in its network '
                       'lytro.camera.NNN?')
    return Finding('camera', 'ok', f'answers at {address}')


_MULTICAST = ('is multicast allowed on the loopback (ip link set lo multicast on), and no '
              'firewall between? Look at ROS_LOCALHOST_ONLY, FASTRTPS_DEFAULT_PROFILES_FILE and '
              'ROS_DOMAIN_ID too')
