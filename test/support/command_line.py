"""`pmcl ...` as users call it: in the tests' own process, or in one that imports all libraries."""

import subprocess
import sys
import traceback
from inspect import signature

from click.testing import CliRunner, Result

from pmcl_ros.cli import main


class Runner(CliRunner):
    """As of click 8.2: stdout and stderr apart, and both as the output. 8.1 must be told."""

    def __init__(self):
        self._mixes = 'mix_stderr' in signature(CliRunner).parameters
        super().__init__(**({'mix_stderr': False} if self._mixes else {}))

    def invoke(self, *arguments, **options):
        done = super().invoke(*arguments, **options)
        if self._mixes:
            done.__class__ = _Both
        return done


class _Both(Result):
    """Both streams, one after the other."""

    @property
    def output(self):
        return self.stdout + self.stderr


def pmcl(*arguments, status=0):
    """What was printed (stdout, stderr), after it ended with `status` and no traceback."""
    done = Runner().invoke(main, [str(each) for each in arguments])
    assert isinstance(done.exception, SystemExit | None), traceback.format_tb(done.exc_info[2])
    assert done.exit_code == status, done.output
    return done


def pmcl_process(*arguments, status=0):
    """The same as a process."""
    done = subprocess.run([sys.executable, '-m', 'pmcl_ros.cli', *map(str, arguments)],
                          capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stderr
    assert 'Traceback' not in done.stderr
    return done
