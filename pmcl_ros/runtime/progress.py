"""Types of the functions that report progress."""

from collections.abc import Callable

# Called with the part that is done, 0 to 1. Returns whether to go on.
Progress = Callable[[float], bool]
# Called with a stage's name and the part of it that is done, 0 to 1.
StageProgress = Callable[[str, float], object]
# Called with the bytes that have come, and those in all.
BytesProgress = Callable[[int, int], None]
