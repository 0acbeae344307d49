"""Checks the Fast DDS profile of the environment and the room in /dev/shm."""

import os
import shutil
from pathlib import Path
from xml.etree import ElementTree

VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'  # Fast DDS 2.14, as in Jazzy, reads no other
TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'  # where no profile is set
_MEMORY = '/dev/shm'
_LEAST = 1_000_000  # bytes: a segment of 0.5 MB, ports and their locks


def problem(profile: str, memory: str = _MEMORY) -> str:
    """Why a profile (its path) cannot be used, and what to do; '' if it can.

    memory: where shared memory lies.
    """
    if not Path(profile).is_file():
        return f'{VARIABLE} names {profile}, which is no file: Fast DDS goes on without it'
    try:
        root = ElementTree.parse(profile).getroot()
        needed = sum(int(each.text or 0) for each in root.iter()
                     if each.tag.rpartition('}')[2] == 'segment_size')
    except (ElementTree.ParseError, ValueError) as error:
        return f'{VARIABLE} names {profile}, which is no profile of Fast DDS: {error}'
    free = shutil.disk_usage(memory).free if needed and Path(memory).is_dir() else needed
    if free < needed:
        return (f'{profile} needs {needed / 1e6:.0f} MB of {memory} for each process, and '
                f'{free / 1e6:.0f} MB are free: messages go by UDP instead. Make it larger '
                '(docker run --shm-size=1g), or remove what ended programs left (fastdds shm '
                'clean)')
    return ''


def no_room() -> str:
    """Why shared memory is too small without a profile; '' if there is enough."""
    free = shutil.disk_usage(_MEMORY).free if Path(_MEMORY).is_dir() else 0
    if free >= _LEAST:
        return ''
    return (f'{_MEMORY} has {free / 1e6:.2f} MB free and Fast DDS needs {_LEAST / 1e6:.1f} MB for '
            'each process: messages go by UDP, which takes longer. Remove what ended programs '
            'left (fastdds shm clean), or make it larger (docker run --shm-size=1g)')


def standstill() -> str:
    """Why messages may not arrive: shared memory has become full; '' if it has room."""
    free = shutil.disk_usage(_MEMORY).free if Path(_MEMORY).is_dir() else _LEAST
    if free >= _LEAST:
        return ''
    return (f'{_MEMORY} has {free / 1e6:.2f} MB free: messages between processes may stand still '
            f'until there is room; remove what fills it, or set {TRANSPORTS}=UDPv4 for all nodes: '
            'their messages then need no shared memory, and take longer')


def problem_here() -> str:
    """The `problem` of the profile that is set here, or what is wrong without one."""
    profile = os.environ.get(VARIABLE, '')
    if profile:
        return problem(profile)
    return '' if os.environ.get(TRANSPORTS, '').startswith('UDP') else no_room()
