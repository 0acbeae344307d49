"""Runs commands each in a process of its own, and says how much time and memory they took.

The time is the processor's: other tests run beside them, and the clock runs meanwhile.
The processes are forked from one that has imported the commands: a start takes milliseconds.
"""

import multiprocessing
import os
import re
import resource
import sys
from pathlib import Path
from typing import NamedTuple

from pmcl_ros.cli import main

_CONTEXT = multiprocessing.get_context('forkserver')
_CONTEXT.set_forkserver_preload([__name__, 'pmcl_ros.cli.bag', 'pmcl_ros.cli.decode',
                                 'pmcl_ros.cli.grasps', 'pmcl_ros.cli.localize'])
SECONDS, MEGABYTES = 5, 1000


class Outcome(NamedTuple):
    """How a command ended. text: all that it wrote."""

    status: int
    text: str
    seconds: float
    megabytes: float


def outcome(folder, *arguments, spare=None):
    """The outcome of `pmcl ARGUMENTS`; folder: for what it writes. spare: memory it gets [MB]."""
    log, (receiver, sender) = folder / 'log', _CONTEXT.Pipe(duplex=False)
    process = _CONTEXT.Process(target=_run, args=(
        sender, log, [str(each) for each in arguments], spare))
    process.start()
    process.join(4 * SECONDS)
    if process.exitcode is None:
        process.kill()
        process.join()
        raise AssertionError(f'{arguments} did not end')
    status, seconds, megabytes = receiver.recv()
    return Outcome(status, log.read_text(), seconds, megabytes)


def refused(folder, *arguments):
    """The one line of a command that fails soon, in little memory."""
    found = outcome(folder, *arguments)
    assert found.status == 1, found
    assert found.seconds < SECONDS
    assert found.megabytes < MEGABYTES
    line, = found.text.strip().splitlines()  # a progress bar leaves an empty one
    assert line.startswith('Error: ')
    return line


def _run(sender, log, arguments, spare):
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for each in (1, 2):
        os.dup2(file, each)
    before, status = _seconds(), 0
    if spare is not None:
        most = int(_of_process('VmSize') + 1e6 * spare)
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
    try:
        main(arguments)
    except SystemExit as end:
        status = end.code
    sys.stdout.flush()
    sys.stderr.flush()
    sender.send((status, _seconds() - before, 1e-6 * _of_process('VmHWM')))


def _seconds():
    """Of the processor, all threads."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _of_process(name):
    """Bytes."""
    found = re.search(rf'{name}:\s*(\d+) kB', Path('/proc/self/status').read_text())
    return 1024 * int(found[1])
