"""The head of an HTTP request, read with limits and strictly: who asks is not known yet."""

import re
from http import HTTPStatus
from io import BufferedIOBase

LONGEST_HEAD = 16_384  # bytes of all header lines
MOST_LINES = 64  # a browser sends less than 20

# A name, a colon at once, a value in one line (RFC 9112, 5.1). What others read in another way is
# refused: two readers of one connection would disagree where a request ends.
_LINE = re.compile(rb"[!#$%&'*+.^_`|~0-9A-Za-z-]+:[\t\x20-\x7e]*\r?\n")
_ENDS = b'\r\n', b'\n'


class HeadError(Exception):
    """A head that is refused, with the status of the answer."""

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        super().__init__(reason)
        self.status = status


def read_head(stream: BufferedIOBase) -> bytes:
    """The header lines after a request line, and the empty line that ends them.

    Raises HeadError where they are too long, too many, cut short, or no header lines.
    """
    lines: list[bytes] = []
    left = LONGEST_HEAD
    while True:
        line = stream.readline(left + 1)
        left -= len(line)
        if left < 0 or len(lines) > MOST_LINES:
            raise HeadError(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE,
                            f'a request has at most {MOST_LINES} header lines of together '
                            f'{LONGEST_HEAD} bytes here')
        lines.append(line)
        if line in _ENDS:
            return b''.join(lines)
        if not _LINE.fullmatch(line):
            raise HeadError(HTTPStatus.BAD_REQUEST, 'a header line is NAME: VALUE, in ASCII, '
                            'without a space before the colon')
