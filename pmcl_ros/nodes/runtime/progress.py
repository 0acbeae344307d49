"""How far a program is, on standard error: a line now and then, for people and for logs."""

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
        """A line, when the last is long enough ago."""
        if time.monotonic() >= self._next:
            self.print(text())
            self._next = time.monotonic() + _EVERY

    def print(self, text: str) -> None:
        """A line."""
        sys.stderr.write(f'{self._program}: {text}\n')
