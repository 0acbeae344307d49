"""How far another machine's clock is ahead, from the times that its answers carry."""

from dataclasses import dataclass

_DRIFT = 100e-6  # two quartzes, at worst


@dataclass(frozen=True)
class ClockDifference:
    """The other clock less ours: between `low_ns` and `high_ns`, as found at `found_ns`.

    0 as long as nothing says otherwise: two clocks that NTP holds together differ by less than an
    answer takes.
    """

    low_ns: float = float('-inf')
    high_ns: float = float('inf')
    found_ns: int = 0

    @property
    def ahead_ns(self) -> int:
        """The best guess."""
        if self.low_ns <= 0 <= self.high_ns:
            return 0
        return round((self.low_ns + self.high_ns) / 2)

    def heard(self, asked_ns: int, told_ns: int, now_ns: int) -> 'ClockDifference':
        """What is known once, between `asked_ns` and `now_ns` by our clock, the other told its.

        The narrower interval counts, the older one less with time.
        """
        new = ClockDifference(told_ns - now_ns, told_ns - asked_ns, now_ns)
        loss = _DRIFT * abs(now_ns - self.found_ns)
        set_anew = new.low_ns > self.high_ns + loss or new.high_ns < self.low_ns - loss
        if set_anew or now_ns - asked_ns <= self.high_ns - self.low_ns + 2 * loss:
            return new
        return self
