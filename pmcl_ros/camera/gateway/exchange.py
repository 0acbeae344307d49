"""A request and its answer that end: at a limit of them as a whole, or by another thread.

The timeouts of requests are for each read alone: an answer that drips has no end by them.
"""

import contextlib
import socket
import threading
from collections.abc import Iterator
from contextvars import ContextVar
from typing import Any

from requests.adapters import HTTPAdapter
from urllib3 import HTTPConnectionPool, HTTPSConnectionPool
from urllib3.connection import HTTPConnection, HTTPSConnection


class Exchange:
    """A request and its answer, over one socket.

    ended: by `end`, or as it exceeded its limit [s]; what waits for the socket fails then.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._timer: threading.Timer | None = None
        self.ended = False
        self.limit = 0.0

    def set_limit(self, seconds: float) -> None:
        """End `seconds` from now, in place of any limit before, unless it has ended."""
        with self._lock:
            if self.ended:
                return
            if self._timer is not None:
                self._timer.cancel()
            self.limit = seconds
            self._timer = threading.Timer(seconds, self.end)
            self._timer.daemon = True
            self._timer.start()

    def answers(self, silence: float, limit: float) -> None:
        """The answer has begun: longest time until its next bytes, and until its end [s]."""
        with self._lock, contextlib.suppress(OSError):
            if self._socket is not None:
                self._socket.settimeout(silence)  # urllib3 sets it anew for each answer
        self.set_limit(limit)

    def uses(self, connected: socket.socket) -> None:
        """Set the socket of the exchange; it is shut down if the exchange has ended."""
        with self._lock:
            self._socket = connected
            if self.ended:
                _shut_down(connected)

    def end(self) -> None:
        """Shut the socket down; usable from any thread."""
        with self._lock:
            self.ended = True
            if self._socket is not None:
                _shut_down(self._socket)

    def release(self) -> None:
        """Leave the socket to the next exchange."""
        with self._lock:
            self._socket = None
        if self._timer is not None:
            self._timer.cancel()


class Exchanges:
    """The exchanges of a session that are under way; usable from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: set[Exchange] = set()

    @contextlib.contextmanager
    def begin(self, limit: float) -> Iterator[Exchange]:
        """The exchange of this thread's next request. limit: seconds until it ends."""
        exchange = Exchange()
        with self._lock:
            self._open.add(exchange)
        before = _CURRENT.set(exchange)
        exchange.set_limit(limit)
        try:
            yield exchange
        finally:
            _CURRENT.reset(before)
            exchange.release()
            with self._lock:
                self._open.remove(exchange)

    def end_all(self) -> None:
        """End those that are under way."""
        with self._lock:
            for exchange in self._open:
                exchange.end()


class ExchangeAdapter(HTTPAdapter):
    """Of a session whose requests are all made within `Exchanges.begin`."""

    def init_poolmanager(self, *args: Any, **options: Any) -> None:
        """Make the pools of connections."""
        super().init_poolmanager(*args, **options)
        self.poolmanager.pool_classes_by_scheme = {'http': _Pool, 'https': _SecurePool}


_CURRENT: ContextVar[Exchange] = ContextVar('_CURRENT')


class _Connection(HTTPConnection):
    def getresponse(self) -> Any:
        # The request is sent: from here on the other side decides how long it takes.
        _CURRENT.get().uses(self.sock)
        return super().getresponse()


class _SecureConnection(_Connection, HTTPSConnection):
    pass


class _Pool(HTTPConnectionPool):
    ConnectionCls = _Connection


class _SecurePool(HTTPSConnectionPool):
    ConnectionCls = _SecureConnection


def _shut_down(connected: socket.socket) -> None:
    with contextlib.suppress(OSError):  # it has ended by itself
        # Not the method of a TLS socket, which changes it under the thread that reads from it.
        socket.socket.shutdown(connected, socket.SHUT_RDWR)
