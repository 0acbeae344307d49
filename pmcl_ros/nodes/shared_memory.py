"""What is wrong with the Fast DDS profile that the environment names: Fast DDS hardly says."""

import os
import shutil
from pathlib import Path
from xml.etree import ElementTree

VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'  # Fast DDS 2.14, as in Jazzy, reads no other
_MEMORY = '/dev/shm'


def problem(profile: str, memory: str = _MEMORY) -> str:
    """What keeps a profile (its path) from being used, and what to do; '' if nothing does.

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


def problem_here() -> str:
    """The `problem` of the profile that is set here, if one is."""
    profile = os.environ.get(VARIABLE, '')
    return problem(profile) if profile else ''
