"""A fork server: programs of the package, each forked from a process that has imported all.

They are processes as any other, but for the imports, which took most of the time of many.
"""

import atexit
import gc
import inspect
import json
import os
import runpy
import signal
import subprocess
import sys
import time
from functools import lru_cache
from importlib import import_module
from pathlib import Path

from numba.core.registry import cpu_target

from pmcl_ros.runtime.start import MODULES

ROOT = Path(__file__).parents[2]
PROGRAMS = {each for each in MODULES.values() if each.startswith('pmcl_ros.nodes.')}


class Forked:
    """What a test does with a `subprocess.Popen`, of a program that the fork server forks.

    log: file that takes all it writes. arguments: strings. environment: of the program.
    """

    def __init__(self, module, arguments, log, environment):
        self.pid = _answer({'module': module, 'arguments': arguments, 'log': str(log),
                            'environment': dict(environment)})
        self._status = None  # until it has been asked for, the pid is not used again

    def send_signal(self, number):
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self):
        self.send_signal(signal.SIGKILL)

    def poll(self):
        """The exit status; None as long as it runs."""
        if self._status is None:
            self._status = _answer({'status': self.pid})
        return self._status

    def wait(self, timeout):
        """The exit status."""
        deadline = time.monotonic() + timeout
        while self.poll() is None:
            if time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            time.sleep(0.01)
        return self._status


@lru_cache
def _server():
    """The process that forks; it ends with this one."""
    process = subprocess.Popen([sys.executable, __file__], cwd=ROOT, stdin=subprocess.PIPE,
                               stdout=subprocess.PIPE, text=True, bufsize=1,
                               env=os.environ | {'NUMBA_NUM_THREADS': '1'})  # it is read early
    atexit.register(process.communicate)
    return process


def _answer(question):
    server = _server()
    server.stdin.write(json.dumps(question) + '\n')
    return json.loads(server.stdout.readline())


def _serve():
    """Fork what is asked for; in the forked process return what to run there."""
    gc.disable()
    for each in PROGRAMS:
        import_module(each)
    # What takes the first kernel of a process, and the first line of its log, most of a second.
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
    inspect.getmodule(inspect.currentframe())
    for each in [each for each in sys.modules if each.startswith('pmcl_ros.nodes')]:
        del sys.modules[each]  # each process has its own: one notes signals in a socket it makes
    # Else each would look through all that when it ends, and so copy it, which takes a second.
    gc.collect()
    gc.freeze()
    gc.enable()
    for line in sys.stdin:
        question = json.loads(line)
        if 'status' in question:
            ended, status = os.waitpid(question['status'], os.WNOHANG)
            answer = os.waitstatus_to_exitcode(status) if ended else None
        elif not (answer := os.fork()):
            return question
        sys.stdout.write(f'{json.dumps(answer)}\n')
        sys.stdout.flush()
    sys.exit()


def _run(module, arguments, log, environment):
    """What `python -m MODULE ARGUMENTS` does there, with all its output in `log`."""
    os.environ.clear()
    os.environ.update(environment)
    null, file = os.open(os.devnull, os.O_RDONLY), os.open(log, os.O_WRONLY | os.O_APPEND)
    for number, each in enumerate((null, file, file)):
        os.dup2(each, number)
    sys.argv[1:] = arguments  # the first becomes the module's file
    runpy.run_module(module, run_name='__main__', alter_sys=True)


if __name__ == '__main__':
    _run(**_serve())
