"""The simulated camera in a process of its own, as `pmcl camera serve` starts it."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pmcl_ros.camera.lytro.settings import Address
from pmcl_ros.runtime.errors import CameraError

READY = 'camera at '  # what the process prints before its address


@contextmanager
def served(pictures: Path | str, *options: str
           ) -> Iterator[tuple[Address, 'subprocess.Popen[str]']]:
    """Serve on any free ports of this machine; its address and the process.

    options: of `pmcl camera serve`. Raises CameraError when the process does not come up.
    """
    command = [sys.executable, '-m', 'pmcl_ros.cli', 'camera', 'serve', '--pictures',
               str(pictures), '--port', '0', '--callback-port', '0', *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            if not line.startswith(READY):
                raise CameraError(f'{" ".join(command)} did not start; it printed {line!r}')
            yield Address.parse(line.removeprefix(READY).split()[0]), process
        finally:
            process.terminate()
