"""What running processes use of the machine (Linux)."""

import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_SHARED = '/dev/shm/'


@dataclass(frozen=True)
class Usage:
    """Of one process: resident memory [MB], open descriptors, threads."""

    memory: float
    descriptors: int
    threads: int

    @classmethod
    def from_pid(cls, pid: int) -> 'Usage':
        """As it is now."""
        process = Path('/proc') / str(pid)
        pages = int((process / 'statm').read_text().split()[1])
        return cls(pages * os.sysconf('SC_PAGE_SIZE') / 1e6, len(list((process / 'fd').iterdir())),
                   len(list((process / 'task').iterdir())))


def cpu_seconds(pid: int) -> float:
    """The processor's time that a process has used, with its threads."""
    fields = (Path('/proc') / str(pid) / 'stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def shared_files(pid: int) -> set[Path]:
    """The files in /dev/shm that a process has mapped."""
    maps = (Path('/proc') / str(pid) / 'maps').read_text().splitlines()
    return {Path(line[line.index(_SHARED):].removesuffix(' (deleted)'))
            for line in maps if _SHARED in line}


def files_shared_without(pids: Iterable[int]) -> set[Path]:
    """The files in /dev/shm that other processes have mapped, but this one and those of `pids`.

    Fast DDS opens ports from 7000 on that programs of all domains have in common.
    """
    ours, others = {os.getpid(), *pids}, set[Path]()
    for process in Path('/proc').glob('[0-9]*'):
        if int(process.name) not in ours:
            # One that has ended since, or is another user's.
            with suppress(FileNotFoundError, ProcessLookupError, PermissionError):
                others |= shared_files(int(process.name))
    return others
