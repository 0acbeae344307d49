"""What is closed at the end of a `with` block."""

from typing import TypeVar

T = TypeVar('T', bound='Closing')


class Closing:
    """Holds something until it is closed; nothing, unless a subclass says what."""

    def close(self) -> None:
        """Let go of what is held."""

    def __enter__(self: T) -> T:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
