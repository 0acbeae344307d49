"""The open connections of a gateway: how many, for how long, and which one makes room."""

import contextlib
import logging
import math
import socket
import threading
import time
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass

MAX_CONNECTIONS = 32  # each has a thread
MAX_OF_ONE_ADDRESS = 16  # half of them: no address keeps all others out

_LOG = logging.getLogger(__name__)


@dataclass
class _State:
    """admitted: it has made a request with the right token. since: when it began to wait [s]."""

    address: str
    since: float
    deadline: float
    admitted: bool = False
    answered: bool = False


class Connections:
    """Connections by socket; usable from several threads.

    A new one is always taken in while another one waits for a request: that is ended. Where its
    address has its share, it is one of the same address. Those that have shown no token go first,
    then those of the address with the most, then the one that waits longest.
    """

    request_timeout = 10.0  # s from the connection to the end of its first admitted request
    idle_timeout = 60.0  # s from an answer to the end of the next request

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: dict[socket.socket, _State] = {}

    def opened(self, connection: socket.socket, address: str) -> bool:
        """Take in a connection; False where there is no room."""
        now = time.monotonic()
        with self._lock:
            counts = Counter(each.address for each in self._open.values())
            share = counts[address] >= MAX_OF_ONE_ADDRESS
            room = not share and len(self._open) < MAX_CONNECTIONS
            if not room:
                room = self._make_room({address} if share else counts.keys(), counts)
            if room:
                self._open[connection] = _State(address, now, now + self.request_timeout)
        if not room:
            _LOG.warning('%d connections are open, %d of %s: one more was refused',
                         counts.total(), counts[address], address)
        return room

    def reads(self, connection: socket.socket) -> None:
        """Record that a connection waits for its next request."""
        with self._lock:
            state = self._of(connection)
            state.answered = False
            if state.admitted:
                state.since = time.monotonic()
                state.deadline = state.since + self.idle_timeout

    def answers(self, connection: socket.socket) -> None:
        """Record that an admitted request is answered: the connection is not ended meanwhile."""
        with self._lock:
            state = self._of(connection)
            state.admitted = state.answered = True
            state.deadline = math.inf

    def closed(self, connection: socket.socket) -> None:
        """Forget a connection."""
        with self._lock:
            self._open.pop(connection, None)

    def end(self, now: float) -> None:
        """End the connections whose time has run out."""
        with self._lock:
            for connection in [each for each, state in self._open.items()
                               if now >= state.deadline]:
                self._end(connection)

    def end_all(self) -> None:
        """End every connection."""
        with self._lock:
            for connection in list(self._open):
                self._end(connection)

    def _of(self, connection: socket.socket) -> _State:
        state = self._open.get(connection)
        if state is None:
            raise ConnectionError('ended to make room, or too slow')
        return state

    def _make_room(self, addresses: Collection[str], counts: Mapping[str, int]) -> bool:
        """End a connection that waits, of one of the addresses; False where there is none."""
        waiting = {connection: (state.admitted, -counts[state.address], state.since)
                   for connection, state in self._open.items()
                   if state.address in addresses and not state.answered}
        if waiting:
            self._end(min(waiting, key=waiting.__getitem__))
        return bool(waiting)

    def _end(self, connection: socket.socket) -> None:
        del self._open[connection]
        with contextlib.suppress(OSError):  # it has ended by itself
            connection.shutdown(socket.SHUT_RDWR)
