"""The log of work on many captures: which one a message is of."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def log_named(name: str) -> Iterator[None]:
    """Messages that are logged meanwhile, in any thread, begin with a name, as of a capture."""
    make = logging.getLogRecordFactory()

    def named(*args: Any, **options: Any) -> logging.LogRecord:
        record = make(*args, **options)
        record.msg, record.args = f'{name}: {record.getMessage()}', ()
        return record

    logging.setLogRecordFactory(named)
    try:
        yield
    finally:
        logging.setLogRecordFactory(make)
