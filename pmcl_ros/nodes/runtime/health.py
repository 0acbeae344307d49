"""The health of a node, for /diagnostics."""

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from pmcl_ros.messages.header import time_to_message

_WINDOW = 10.0  # s: in which results are counted for their rate


@dataclass
class Health:
    """Counts and the state of the last piece of work of one node, since it was activated.

    back_end: what the work runs on, a renderer or a device. hardware_id: the camera's serial
    number. extra, counts: further values and counters of a node. lock: held while what belongs to
    one result is set, so that no report has a part of it.
    """

    frames_in: int = 0
    frames_out: int = 0
    dropped: int = 0
    errors: int = 0
    last_error: str = ''
    latency_ms: float = 0
    back_end: str = ''
    hardware_id: str = ''
    level: bytes = DiagnosticStatus.OK
    message: str = 'active'
    extra: dict[str, object] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    clock: Callable[[], float] = time.monotonic
    lock: threading.RLock = field(default_factory=threading.RLock, repr=False)
    _awaited: tuple[bytes, str] | None = None
    _results: deque[float] = field(default_factory=lambda: deque(maxlen=1000))

    def __post_init__(self) -> None:
        self._began = self.clock()

    @property
    def state(self) -> tuple[bytes, str]:
        """Level and message that /diagnostics show."""
        with self.lock:
            own = self.level, self.message
            return own if self._awaited is None or self._awaited[0] < own[0] else self._awaited

    @property
    def rate(self) -> float:
        """Results per second in the last ten, or since the beginning."""
        now = self.clock()
        recent = sum(each > now - _WINDOW for each in list(self._results))
        return recent / min(_WINDOW, max(now - self._began, 1.0))

    def count(self, what: str, number: int = 1) -> None:
        """One more of `what`, or several."""
        with self.lock:
            self.counts[what] = self.counts.get(what, 0) + number

    def done(self, latency: float, message: str = 'active') -> None:
        """A result was published `latency` seconds after its input had come."""
        with self.lock:
            self._results.append(self.clock())
            self.frames_out += 1
            self.latency_ms = 1000 * latency
            self.level, self.message = DiagnosticStatus.OK, message
            self._awaited = None

    def warn(self, message: str) -> None:
        """The input was good, the result is not: say so until the next result."""
        with self.lock:
            self.level, self.message = DiagnosticStatus.WARN, message
            self._awaited = None

    def awaits(self, message: str, level: bytes) -> None:
        """Something does not come: say so, but for what is worse, until it or a result comes."""
        with self.lock:
            self._awaited = level, message

    def came(self) -> None:
        """What was awaited has come, or is awaited no more; the state is as it was without."""
        with self.lock:
            self._awaited = None

    def failed(self, message: str) -> None:
        """An input could not be used: say so until the next result."""
        with self.lock:
            self.errors += 1
            self.last_error = message
            self.level, self.message = DiagnosticStatus.ERROR, message

    def recovered(self) -> None:
        """What had failed works again, though there is no result yet."""
        with self.lock:
            self.level, self.message = DiagnosticStatus.OK, 'active'

    def to_message(self, stamp_ns: int, name: str) -> DiagnosticArray:
        """All of it as a message for /diagnostics."""
        with self.lock:
            values = {
                'frames in': self.frames_in, 'frames out': self.frames_out,
                'dropped': self.dropped, 'errors': self.errors, 'last error': self.last_error,
                'last latency [ms]': f'{self.latency_ms:.1f}', 'back end': self.back_end,
                'rate [Hz]': f'{self.rate:.2f}', **self.counts, **self.extra}
            level, message = self.state
            status = DiagnosticStatus(
                level=level, name=name, message=message, hardware_id=self.hardware_id,
                values=[KeyValue(key=key, value=str(value)) for key, value in values.items()])
        return DiagnosticArray(header=Header(stamp=time_to_message(stamp_ns)), status=[status])
