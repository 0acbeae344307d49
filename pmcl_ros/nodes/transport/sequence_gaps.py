"""Messages that came and were never taken, as newer ones came before: DDS tells nobody of them."""


class SequenceGaps:
    """Counts them for one subscription, by the numbers that their publisher gave its messages.

    A history that keeps the last one overwrites what has not been taken. What was published before
    the first message was taken is not counted, nor is anything while there are several publishers,
    whose numbers cannot be told apart. (DDS counts one that was killed for up to 20 s.)
    """

    def __init__(self) -> None:
        self._last = self._publishers = 0

    def missed(self, number: int | None, publishers: int) -> int:
        """How many came between the last message taken and this one.

        number: rclpy's `publication_sequence_number`; None where the middleware knows none.
        """
        if number is None:
            return 0
        known = publishers == self._publishers == 1 and number > self._last > 0
        missed = number - self._last - 1 if known else 0
        self._last, self._publishers = number, publishers
        return missed
