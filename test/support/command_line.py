"""`pmcl ...` as users call it: in the tests' own process, or in one that imports all libraries."""

import subprocess
import sys
import traceback

from click.testing import CliRunner

from pmcl_ros.cli import main


def pmcl(*arguments, status=0):
    """What was printed (stdout, stderr), after it ended with `status` and no traceback."""
    done = CliRunner().invoke(main, [str(each) for each in arguments])
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
