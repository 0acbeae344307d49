"""A line that is logged again and again: the first at once, then one in ten seconds."""

import re
import time
from collections.abc import Callable
from threading import Lock

# Stamps [ns], of simulated time too; what was measured; a running number.
_NUMBER = re.compile(r'\d{10,}|\d+\.\d+|(?<=\bframe )\d+')
_PERIOD = 10.0  # s: between two lines of one text
_MOST = 100  # texts that are remembered


class RepeatedLines:
    """What is to be logged of lines that come again and again. Any thread may ask."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, Lock()
        self._logged: dict[str, float] = {}  # when each was logged, the oldest first
        self._silent: dict[str, int] = {}  # how often it came since

    def __call__(self, line: str) -> str:
        """The line, if it is to be logged now, and how often it came since the last time.

        Lines that differ in stamps, decimal fractions or numbers of frames alone are one.
        """
        text = _NUMBER.sub('', line)
        with self._lock:
            now = self._clock()
            if now < self._logged.get(text, -_PERIOD) + _PERIOD:
                self._silent[text] = self._silent.get(text, 0) + 1
                return ''
            self._logged.pop(text, None)
            self._logged[text] = now
            if len(self._logged) > _MOST:
                oldest = next(iter(self._logged))
                del self._logged[oldest]
                self._silent.pop(oldest, None)
            count = self._silent.pop(text, 0)
        return f'{line} ({count} times more since the last such line)' if count else line
