"""Faults of the simulated camera, and when they happen."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from random import Random

from pmcl_ros.runtime.errors import SettingsError

HELP = """\
drop-after=SIZE[:once]   each connection (once: only the first) is cut after
                         SIZE bytes
drop-random=SIZE[:SEED]  each connection is cut after SIZE bytes on average,
                         half of the times by a reset, half with the callbacks
slow=SIZE/s              no connection is faster than that
short-chunks[=SIZE]      at most SIZE bytes (64kB) come per download request
garbage-header[=N]       every Nth reply (10) has a random header
silence[=N]              every Nth request (1) is never answered
busy[=N]                 the first N commands (1) to take a picture are
                         answered and ignored
card-full[=N]            room for N more pictures (0); then commands to take
                         one are answered and ignored
SIZE is in bytes, kB, MB, KiB or MiB. --fault may be given several times."""
_FORM = re.compile(r'^[a-z]\S+', re.MULTILINE)  # of a fault, in HELP

_UNITS = {'': 1, 'B': 1, 'kB': 1000, 'MB': 10**6, 'KiB': 2**10, 'MiB': 2**20}


@dataclass
class Faults:
    """Sizes in bytes, rates in bytes per second; None: no such fault.

    It contains the counters of requests and replies: one `Faults` belongs to one server.
    """

    drop_after: int | None = None
    drop_once: bool = False
    drop_random: int | None = None
    slow: int | None = None
    short_chunks: int | None = None
    garbage_header: int | None = None
    silence: int | None = None
    busy: int = 0
    room: int | None = None  # pictures that still fit on the card
    rng: Random = field(default_factory=lambda: Random(0))
    _replies: int = 0
    _requests: int = 0

    @classmethod
    def parse(cls, texts: Iterable[str]) -> 'Faults':
        """Parse faults in the form of `HELP`; SettingsError for anything else."""
        faults = cls()
        for text in texts:
            name, _, value = text.partition('=')
            value, _, option = value.partition(':')
            try:
                faults._set(name, value, option)
            except (KeyError, ValueError):
                possible = ', '.join(_FORM.findall(HELP))
                raise SettingsError(f'no fault: {text!r}; possible are {possible}; what they do '
                                    'says `pmcl camera serve --help`') from None
        return faults

    def _set(self, name: str, value: str, option: str) -> None:
        if option and name not in ('drop-after', 'drop-random'):
            raise ValueError
        match name:
            case 'drop-after':
                self.drop_after, self.drop_once = _size(value), {'once': True, '': False}[option]
            case 'drop-random':
                self.drop_random = _size(value)
                self.rng.seed(int(option or 0))
            case 'slow':
                self.slow = _size(value.removesuffix('/s'))
            case 'short-chunks':
                self.short_chunks = _size(value or '64kB')
            case 'garbage-header':
                self.garbage_header = _count(value or '10')
            case 'silence':
                self.silence = _count(value or '1')
            case 'busy':
                self.busy = _count(value or '1')
            case 'card-full':
                self.room = int(value or 0)
            case _:
                raise KeyError

    def budget(self) -> int | None:
        """Bytes after which a new connection is cut; None: never."""
        if self.drop_random is not None:
            return round(self.rng.expovariate(1 / self.drop_random))
        budget = self.drop_after
        if self.drop_once:
            self.drop_after = None
        return budget

    def unanswered(self) -> bool:
        """Whether to ignore this request."""
        self._requests += 1
        return self.silence is not None and self._requests % self.silence == 0

    def header(self, header: bytes) -> bytes:
        """The header to send instead of `header`."""
        self._replies += 1
        if self.garbage_header is not None and self._replies % self.garbage_header == 0:
            return self.rng.randbytes(len(header))
        return header

    def refused(self) -> bool:
        """Whether to ignore this capture command."""
        if self.busy:
            self.busy -= 1
            return True
        if self.room is None:
            return False
        self.room -= 1
        if self.room < 0:
            self.room = 0
            return True
        return False

    def deleted(self) -> None:
        """Record that a picture was deleted."""
        if self.room is not None:
            self.room += 1


def _size(text: str) -> int:
    found = re.fullmatch(r'(\d+(?:\.\d+)?)\s*([kKMiB]*)', text)
    if not found:
        raise ValueError
    size = round(float(found[1]) * _UNITS[found[2]])
    if size < 1:
        raise ValueError
    return size


def _count(text: str) -> int:
    if (count := int(text)) < 1:
        raise ValueError
    return count
