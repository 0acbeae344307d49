"""The gateway's HTTP server: its address, and a thread for each connection."""

import ipaddress
import logging
import socket
import sys
import time
from http.server import ThreadingHTTPServer
from socketserver import TCPServer
from typing import Any

from pmcl_ros.camera.gateway.connections import MAX_CONNECTIONS, Connections
from pmcl_ros.camera.gateway.handler import Handler
from pmcl_ros.camera.gateway.service import Service
from pmcl_ros.runtime.errors import SettingsError

_LOG = logging.getLogger(__name__)


class GatewayServer(ThreadingHTTPServer):
    """Serves a `Service` over HTTP at one address.

    token: required in 'Authorization: Bearer ...'. Without a token only loopback addresses are
    allowed (SettingsError), since anybody in the network could take and see pictures.
    """

    daemon_threads = True
    block_on_close = False
    request_queue_size = MAX_CONNECTIONS

    def __init__(self, service: Service, host: str, port: int, token: str | None = None) -> None:
        self.service, self.token = service, token
        self.connections = Connections()
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
        """Start a thread for a connection, where there is room."""
        if self.connections.opened(request, str(client_address[0])):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection, in its thread."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self.connections.closed(request)

    def service_actions(self) -> None:
        """End connections that exceed their time limit; called several times a second."""
        self.connections.end(time.monotonic())

    def server_close(self) -> None:
        """End all connections."""
        super().server_close()
        self.connections.end_all()

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002
        """Log the end of a connection; only errors beside network errors get a traceback."""
        error = sys.exc_info()[1]
        if isinstance(error, OSError):
            _LOG.debug('connection of %s: %s', client_address, error)
        else:
            _LOG.exception('connection of %s', client_address)
