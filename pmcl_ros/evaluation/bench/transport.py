"""A volume's way to another process by its topic, beside the copies that this takes."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pmcl_ros.runtime.errors import PmclError

_PROFILE = Path('config') / 'fastdds_shm.xml'
_VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'


class BenchError(PmclError):
    """The bench could not be run."""


@dataclass(frozen=True)
class Transport:
    """sent, received, equal: messages, those that came, and those that came as they were.

    ms: medians, by `topic` from a volume to a numpy view of what came, and of the `copies` of its
    data that this takes, in the same two processes. ratio: of the two.
    """

    megabytes: float
    sent: int
    received: int
    equal: int
    ms: dict[str, float]
    ratio: float


@dataclass(frozen=True)
class TransportBench:
    """As Fast DDS is by default, and with the shipped profile for shared memory."""

    default: Transport
    shared_memory: Transport

    def lines(self) -> list[str]:
        """What to print."""
        return [f'{name}: {each.received} of {each.sent} volumes of {each.megabytes:.1f} MB came, '
                f'{each.equal} as they were; {each.ms["topic"]:.0f} ms, {each.ratio:.1f} times '
                f'the {each.ms["copies"]:.0f} ms of the copies'
                for name, each in (('default', self.default),
                                   ('config/fastdds_shm.xml', self.shared_memory))]


def bench_transport(messages: int = 200) -> TransportBench:
    """Send `messages` volumes of 328x328x75 each way; BenchError without ROS."""
    bare = {name: value for name, value in os.environ.items() if name != _VARIABLE}
    bare.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    profile = Path(__file__).parents[3] / _PROFILE
    if not profile.is_file():
        raise BenchError(f'there is no {profile}: run the bench from the source tree')
    return TransportBench(_run(messages, bare), _run(messages, bare | {_VARIABLE: str(profile)}))


def _run(messages: int, environment: Mapping[str, str]) -> Transport:
    # As a program: only nodes know ROS, and the profile is read when it starts.
    process = subprocess.run(
        [sys.executable, '-m', 'pmcl_ros.evaluation.bench.volume_transport', '--messages',
         str(messages)],
        stdout=subprocess.PIPE, text=True, env=environment, check=False)
    if process.returncode:
        raise BenchError('the volumes were not sent, as the lines above say; it needs ROS 2')
    return Transport(**json.loads(process.stdout))
