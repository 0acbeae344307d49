"""Takes many captures from the simulated camera, over a link that drops at random."""

import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pmcl_ros.camera.lytro.address import Address
from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.camera.simulated.server import served
from pmcl_ros.evaluation.bench.decode import camera_text
from pmcl_ros.runtime.errors import CameraError
from pmcl_ros.runtime.usage import Usage

_SOURCES = 3  # captures that are served in turn


@dataclass(frozen=True)
class DriverBench:
    """captures: taken; frames: distinct pictures that arrived; intact: with all bytes right.

    megabytes_per_second: median of downloads, over a `clean` link, over the `dropping` one.
    memory_growth, descriptor_growth: of the client's and of the camera's process, from a tenth of
    the captures (at least six) to the end, MB and number.
    """

    captures: int
    frames: int
    intact: int
    seconds: float
    megabytes_per_second: dict[str, float]
    memory_growth: dict[str, float]
    descriptor_growth: dict[str, int]

    def lines(self) -> list[str]:
        """The lines to print."""
        rates = ', '.join(f'{rate:.0f} MB/s over a {link} link'
                          for link, rate in self.megabytes_per_second.items())
        return [f'{self.captures} captures in {self.seconds:.1f} s: {self.frames} pictures, '
                f'{self.intact} with all bytes right', f'download: {rates}',
                *(f'{name}: memory grew by {self.memory_growth[name]:.2f} MB, '
                  f'{self.descriptor_growth[name]} more descriptors' for name in
                  self.memory_growth)]


def bench_driver(captures: int = 200, drop: str = '5MB', seed: int = 0, side: int = 3280
                 ) -> DriverBench:
    """Take and fetch `captures` pictures of `side` x `side` pixels.

    drop: each connection is cut after so many bytes on average. The camera is another process.
    """
    with tempfile.TemporaryDirectory() as folder:
        raws = _write_captures(Path(folder), side, seed)
        with served(folder, '--empty', '--delay', '0') as (address, _), \
                LytroClient(address) as client:
            clean = [_rate(client, raws[each % _SOURCES]) for each in range(3 * _SOURCES)]
        with served(folder, '--empty', '--delay', '0', '--fault',
                    f'drop-random={drop}:{seed}') as (address, process):
            return _run(address, process.pid, raws, captures, float(np.median(clean)))


def _run(address: Address, pid: int, raws: list[bytes], captures: int, clean: float
         ) -> DriverBench:
    processes = {'client': os.getpid(), 'camera': pid}
    identities: set[str] = set()
    intact, rates = 0, []
    began = time.perf_counter()
    with LytroClient(address) as client:
        for number in range(captures):
            if number == min(max(2 * _SOURCES, captures // 10), captures - 1):
                before = {name: Usage.from_pid(each) for name, each in processes.items()}
            identity, raw, rate = _next(client)
            rates.append(rate)
            identities.add(identity)
            intact += raw == raws[number % len(raws)]
        after = {name: Usage.from_pid(each) for name, each in processes.items()}
    return DriverBench(
        captures, len(identities), intact, time.perf_counter() - began,
        {'clean': clean, 'dropping': float(np.median(rates))},
        {name: after[name].memory - before[name].memory for name in processes},
        {name: after[name].descriptors - before[name].descriptors for name in processes})


def _next(client: LytroClient) -> tuple[str, bytes, float]:
    """Take a picture: its id, its bytes, the rate of its download [MB/s]."""
    picture = client.capture()
    started = time.perf_counter()
    raw, _ = client.fetch(picture)
    return picture.id, raw, len(raw) / 1e6 / (time.perf_counter() - started)


def _rate(client: LytroClient, expected: bytes) -> float:
    """The rate of the next download [MB/s]; CameraError for other bytes than expected."""
    identity, raw, rate = _next(client)
    if raw != expected:
        raise CameraError(f'{identity} arrived with wrong bytes')
    return rate


def _write_captures(folder: Path, side: int, seed: int) -> list[bytes]:
    """Noise pictures, in which any wrong byte shows."""
    rng = np.random.default_rng(seed)
    raws = [rng.bytes(side * side * 3 // 2) for _ in range(_SOURCES)]
    for number, raw in enumerate(raws):
        (folder / f'{number}.RAW').write_bytes(raw)
        (folder / f'{number}.TXT').write_text(camera_text(side))
    return raws
