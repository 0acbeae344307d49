"""Times steps, and prints times and memory."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Bench:
    """The result of a bench.

    geometry: of the data. ms: per step, the least of several runs. ratio_to_reference: how many
    times faster than the plain form. mb: memory [10^6 bytes].
    """

    geometry: str
    ms: dict[str, float]
    ratio_to_reference: float
    mb: dict[str, float] = field(default_factory=dict)

    def lines(self) -> list[str]:
        """The lines to print."""
        figures = [(name, value, 'ms') for name, value in self.ms.items()]
        figures += [(name, value, 'MB') for name, value in self.mb.items()]
        return [self.geometry, *(f'{name:>16}: {value:9.1f} {unit}'
                                 for name, value, unit in figures),
                f'{self.ratio_to_reference:.0f} times as fast as the plain form']


def best_ms(step: Callable[[], object], repeats: int) -> float:
    """The least time of `repeats` runs of a step [ms]; what else the machine does adds to it."""
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        step()
        times.append(time.perf_counter() - started)
    return 1e3 * min(times)
