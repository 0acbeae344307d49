"""Which part of a file a request asks for (RFC 9110, section 14)."""

import re

_RANGE = re.compile(r'bytes=(?:([0-9]{1,15})-([0-9]{1,15})?|-([0-9]{1,15}))')


class UnsatisfiableError(ValueError):
    """No byte of the file is asked for."""


def selected(header: str | None, size: int) -> range | None:
    """The bytes that a Range header asks for, of a file of `size` bytes; None: all of it.

    What is not understood, as several ranges at once, is ignored, as RFC 9110 has it. Raises
    UnsatisfiableError when the range lies beyond the file.
    """
    found = _RANGE.fullmatch(header.replace(' ', '')) if header else None
    if found is None:
        return None
    first, last, suffix = (None if each is None else int(each) for each in found.groups())
    if first is None:
        wanted = range(max(0, size - (suffix or 0)), size)
    else:
        if last is not None and last < first:
            return None
        wanted = range(first, size if last is None else min(last + 1, size))
    if not wanted:
        raise UnsatisfiableError
    return wanted
