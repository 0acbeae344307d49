"""The gateway's HTTP server: its address, the number of connections, their time limits."""

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

MAX_CONNECTIONS = 32

_LOG = logging.getLogger(__name__)


class GatewayServer(ThreadingHTTPServer):
    """Serves a `Service` over HTTP at one address.

    token: required in 'Authorization: Bearer ...'. Without a token only loopback addresses are
    allowed (SettingsError), since anybody in the network could take and see pictures.
    """

    daemon_threads = True
    block_on_close = False
    request_queue_size = MAX_CONNECTIONS
    request_timeout = 60.0  # s from an answer, or the connection, to the end of the next request

    def __init__(self, service: Service, host: str, port: int, token: str | None = None) -> None:
        self.service, self.token = service, token
        self._slots = threading.BoundedSemaphore(MAX_CONNECTIONS)
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
        """Address of the gateway."""
        host, port = self.server_address[:2]
        return f'http://[{host!s}]:{port}' if ':' in str(host) else f'http://{host!s}:{port}'

    def server_bind(self) -> None:
        """Bind without a query to a name server."""
        TCPServer.server_bind(self)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Start a thread for a connection, up to MAX_CONNECTIONS."""
        if self._slots.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            _LOG.warning('%d connections are open, one more was refused', MAX_CONNECTIONS)
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection, in its thread."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._deadlines.pop(request, None)
            self._slots.release()

    def reading(self, connection: socket.socket, begins: bool) -> None:
        """Start or end the time limit for reading a request."""
        deadline = time.monotonic() + self.request_timeout if begins else math.inf
        self._deadlines[connection] = deadline

    def service_actions(self) -> None:
        """End connections that exceed the time limit; called several times a second."""
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
        """Log the end of a connection; only errors beside network errors get a traceback."""
        error = sys.exc_info()[1]
        if isinstance(error, OSError):
            _LOG.debug('connection of %s: %s', client_address, error)
        else:
            _LOG.exception('connection of %s', client_address)
