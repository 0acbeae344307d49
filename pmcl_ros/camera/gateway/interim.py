"""Interim answers: that a request is being worked on, before its final answer."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

# A client of HTTP/1.1 skips them (RFC 9110, 15.2), but may refuse very many. Of all the interim
# answers only this one is skipped by all versions of Python's http.client.
_CONTINUE = b'HTTP/1.1 100 Continue\r\n\r\n'


@contextlib.contextmanager
def interim_answers(write: Callable[[bytes], Any], pause: float) -> Iterator[None]:
    """Send one every `pause` seconds within the block, and none after it.

    write: sends bytes to the client; its OSErrors are left to the final answer.
    """
    done = threading.Event()

    def send() -> None:
        with contextlib.suppress(OSError):
            while not done.wait(pause):
                write(_CONTINUE)

    sending = threading.Thread(target=send, name='interim answers', daemon=True)
    sending.start()
    try:
        yield
    finally:
        done.set()
        sending.join()
