"""What `pmcl warm-up` compiles is what a localisation needs."""

import subprocess
import sys
from pathlib import Path

from pmcl_ros.runtime import kernels

ROOT = Path(__file__).parents[2]
LOCALISE = """
import atexit, sys
from pmcl_ros.cli import main
from pmcl_ros.runtime import kernels
compiled = []
kernels.report_to(compiled.append)
atexit.register(lambda: print('compiled:', *compiled))
main(['report', sys.argv[1], '-o', sys.argv[2]])
"""


def pmcl(*arguments):
    done = subprocess.run([sys.executable, '-m', 'pmcl_ros.cli', *arguments], check=True,
                          capture_output=True, text=True)
    return done.stderr


def test_after_it_a_localisation_compiles_nothing(tmp_path):
    for complete in kernels.cache_folder().glob('*.complete'):
        complete.unlink()  # as on a machine where none ran to its end
    assert 'compiled' in pmcl('warm-up', '--all')
    assert not pmcl('warm-up', '--all')  # nothing is left to compile
    done = subprocess.run([sys.executable, '-c', LOCALISE, ROOT / 'bags' / 'wine_glass',
                           tmp_path / 'report.html'], check=True, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1].split() == ['compiled:']
