"""Runs commands each on a full disk, in a namespace of mounts of its own: `unshare -Urm`.

Reads a JSON object: of each name a folder, for the disk, and the arguments of `pmcl`. Writes one:
of each name the exit status and what was told on stderr.
"""

import json
import subprocess
import sys
from pathlib import Path

from command_line import Runner

from pmcl_ros.cli import main

PAGE = bytes(4096)


def on_a_full_disk(folder, arguments):
    """(exit status, stderr) of a command that finds no room in the folder."""
    subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=4k,nr_inodes=20', 'none', folder],
                   check=True)
    (Path(folder) / 'fill').write_bytes(PAGE)
    done = Runner().invoke(main, arguments)
    assert isinstance(done.exception, SystemExit | None), done.exc_info
    return done.exit_code, done.stderr


if __name__ == '__main__':
    json.dump({name: on_a_full_disk(*each) for name, each in json.load(sys.stdin).items()},
              sys.stdout)
