"""A drawing of a report with its caption."""

from typing import NamedTuple

from markupsafe import Markup


class Figure(NamedTuple):
    """A drawing and its caption. wide: as wide as the page lets it be."""

    drawing: Markup
    caption: str
    wide: bool = False
