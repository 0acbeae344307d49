"""Progress of a program on standard error: at most a line a second."""

import sys
import time
from collections.abc import Callable

_EVERY = 1.0  # s: at most so often, however many messages there are


class Progress:
    """Lines that begin with `program`."""

    def __init__(self, program: str) -> None:
        self._program = program
        self._next = time.monotonic()

    def report(self, text: Callable[[], str]) -> None:
        """Print a line, if the last one is long enough ago."""
        if time.monotonic() >= self._next:
            self.print(text())
            self._next = time.monotonic() + _EVERY

    def print(self, text: str) -> None:
        """Print a line."""
        sys.stderr.write(f'{self._program}: {text}\n')
