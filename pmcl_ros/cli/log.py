"""The log of the commands, on the terminal."""

import logging

from rich.text import Text

from pmcl_ros.cli.base import STDERR


class TerminalLog(logging.Handler):
    """Prints each record as one line, which only the terminal wraps: it can be copied whole."""

    def __init__(self) -> None:
        super().__init__()
        self.setFormatter(logging.Formatter('%(asctime)s %(levelname)-7s %(message)s', '%X'))

    def emit(self, record: logging.LogRecord) -> None:
        """Print it above the bars of progress."""
        line = Text(self.format(record))
        line.highlight_words([record.levelname], f'logging.level.{record.levelname.lower()}')
        STDERR.print(line, soft_wrap=True)
