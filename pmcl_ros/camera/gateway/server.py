"""The gateway's sockets: which address, how many connections, how slow they may be."""

import contextlib
import ipaddress
import logging
import math
import socket
import sys
import threading
import time
from http.server import ThreadingHTTPServer
from socketserver import TCPServer
from typing import Any

from pmcl_ros.camera.gateway.handler import Handler
from pmcl_ros.camera.gateway.service import Service
from pmcl_ros.runtime.errors import SettingsError

_MOST_CONNECTIONS = 32
_READING = 60.0  # seconds from one answer, or the connection, to the end of the next request

_log = logging.getLogger(__name__)


class GatewayServer(ThreadingHTTPServer):
    """Serves a `Service` over HTTP at one address.

    token: what 'Authorization: Bearer ...' has to show. Without one only a loopback address is
    served, as anybody in reach could take pictures and see them: SettingsError otherwise.
    """

    daemon_threads = True
    block_on_close = False
    request_queue_size = _MOST_CONNECTIONS

    def __init__(self, service: Service, host: str, port: int, token: str | None = None) -> None:
        self.service, self.token = service, token
        self._slots = threading.BoundedSemaphore(_MOST_CONNECTIONS)
        self._deadlines: dict[socket.socket, float] = {}  # of the connections that are open
        try:
            if not host:
                raise ValueError('say which of the addresses of this machine')
            family, _, _, _, address = socket.getaddrinfo(
                host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
            loopback = ipaddress.ip_address(str(address[0]).partition('%')[0]).is_loopback
            if token is None and not loopback:
                raise SettingsError(
                    f'{host} can be reached from other machines: give a token (--token-file), so '
                    'that not everybody can take pictures and see them; or serve 127.0.0.1')
            self.address_family = family
            super().__init__((str(address[0]), port), Handler)
        except (OSError, ValueError, OverflowError) as error:
            raise SettingsError(f'cannot serve at {host}, port {port}: {error}') from None
        self.local_only = loopback

    @property
    def url(self) -> str:
        """Where it is served."""
        host, port = self.server_address[:2]
        return f'http://[{host!s}]:{port}' if ':' in str(host) else f'http://{host!s}:{port}'

    def server_bind(self) -> None:
        """Without asking a name server who we are."""
        TCPServer.server_bind(self)

    def process_request(self, request: Any, client_address: Any) -> None:
        """A thread for a connection, while there are not too many."""
        if self._slots.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            _log.warning('%d connections are open, one more was refused', _MOST_CONNECTIONS)
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """In the thread of a connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._deadlines.pop(request, None)
            self._slots.release()

    def reading(self, connection: socket.socket, begins: bool) -> None:
        """A request is awaited on this connection, or was read."""
        self._deadlines[connection] = time.monotonic() + _READING if begins else math.inf

    def service_actions(self) -> None:
        """Several times a second: end connections that send a request byte by byte."""
        self._end(time.monotonic())

    def server_close(self) -> None:
        """End all connections."""
        super().server_close()
        self._end(math.inf)

    def _end(self, now: float) -> None:
        for connection, deadline in list(self._deadlines.items()):
            if now >= deadline:
                with contextlib.suppress(OSError):  # it has ended by itself
                    connection.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002
        """Connections end in many ways; only what is no network's fault gets a traceback."""
        error = sys.exc_info()[1]
        if isinstance(error, OSError):
            _log.debug('connection of %s: %s', client_address, error)
        else:
            _log.exception('connection of %s', client_address)
