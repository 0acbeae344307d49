"""What a printed board of any kind is told by: two counts, and the side of a square."""

import re

from pmcl_ros.runtime.errors import SettingsError


def counts_from(text: str, question: str) -> tuple[int, int]:
    """Columns and rows of COLUMNSxROWS, as 10x7; SettingsError with `question` for other text."""
    numbers = re.fullmatch(r'\s*(\d{1,4})\s*[xX]\s*(\d{1,4})\s*', text)
    if numbers is None:
        raise SettingsError(question)
    return int(numbers[1]), int(numbers[2])


def check_square(side: float) -> None:
    """SettingsError where no printed square has that side [m]."""
    if not 1e-4 < side < 1:
        raise SettingsError(f'squares of {side} m are impossible; give their side in metres')
