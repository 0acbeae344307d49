"""What a soak reads of processes."""

import mmap
import os
import subprocess
import sys
from pathlib import Path
from tempfile import NamedTemporaryFile

from pmcl_ros.runtime.usage import files_shared_without, shared_files

SHARE = """import mmap, sys
with open(sys.argv[1], 'r+b') as file:
    held = mmap.mmap(file.fileno(), 0)
print('mapped', flush=True)
sys.stdin.read()"""


def test_what_another_process_shares_is_told_from_ones_own():
    with (NamedTemporaryFile(dir='/dev/shm') as theirs, NamedTemporaryFile(dir='/dev/shm') as own):
        for each in (theirs, own):
            os.truncate(each.fileno(), 4096)
        held = mmap.mmap(own.fileno(), 0)
        with subprocess.Popen([sys.executable, '-c', SHARE, theirs.name], text=True,
                              stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
            assert other.stdout.readline() == 'mapped\n'
            assert Path(own.name) in shared_files(os.getpid())
            assert Path(theirs.name) in shared_files(other.pid)
            assert Path(theirs.name) in files_shared_without([])
            assert Path(theirs.name) not in files_shared_without([other.pid])
            assert Path(own.name) not in files_shared_without([])
            other.stdin.close()
        held.close()
        assert Path(theirs.name) not in files_shared_without([])
