"""Gateways in front of simulated cameras, and connections that break: all real sockets."""

import socket
import struct
import threading
from contextlib import closing, contextmanager, suppress

from simulated_cameras import QUICK, serving

from pmcl_ros.camera.gateway.server import GatewayServer
from pmcl_ros.camera.gateway.service import Cache, Service
from pmcl_ros.camera.lytro.client import LytroClient


@contextmanager
def gateway_to(address, token=None, limit=1 << 29, host='127.0.0.1', settings=QUICK,
               cache=None):
    """A gateway in a thread of this process, to the camera at `address`."""
    service = Service(lambda: LytroClient(address, settings), Cache(cache, limit))
    with closing(service), GatewayServer(service, host, 0, token) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


@contextmanager
def gateway_of(folder, *faults, token=None, limit=1 << 29, settings=QUICK, cache=None,
               **options):
    """A gateway to a simulated camera of the pictures in `folder`."""
    with serving(folder, *faults, **options) as address, \
            gateway_to(address, token, limit, settings=settings, cache=cache) as server:
        yield server


def said(gateway, data):
    """All that is answered to these bytes."""
    with socket.create_connection(gateway.server_address[:2], timeout=30) as connection:
        try:
            connection.sendall(data)
            connection.shutdown(socket.SHUT_WR)
            answer = b''
            while block := connection.recv(65536):
                answer += block
        except TimeoutError:
            raise
        except OSError:  # closed by the other end: reset, or no longer connected
            return b''
    return answer


class CuttingProxy:
    """A TCP proxy that cuts its connections: the nth after cuts[n] bytes to the client.

    Later ones stay whole. reset: by RST, where what is on its way may be lost, else by FIN.
    """

    def __init__(self, port, cuts=(), reset=False):
        self.target, self._cuts, self._reset = port, list(cuts), reset
        self._listening = socket.create_server(('127.0.0.1', 0))
        self.port = self._listening.getsockname()[1]
        self.connections = self.to_client = 0
        self.requests = b''

    def __enter__(self):
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_):
        self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()

    def _accept(self):
        with suppress(OSError):
            while True:
                client, _ = self._listening.accept()
                left = self._cuts[self.connections] if self.connections < len(
                    self._cuts) else None
                self.connections += 1
                server = socket.create_connection(('127.0.0.1', self.target))
                for target, *arguments in ((self._requests, client, server),
                                           (self._answers, server, client, left)):
                    threading.Thread(target=target, args=arguments, daemon=True).start()

    def _requests(self, client, server):
        with suppress(OSError):
            while data := client.recv(65536):
                self.requests += data
                server.sendall(data)
        with suppress(OSError):
            server.shutdown(socket.SHUT_WR)

    def _answers(self, server, client, left):
        with suppress(OSError), server, client:
            while data := server.recv(65536):
                part = data if left is None else data[:left]
                client.sendall(part)
                self.to_client += len(part)
                if left is not None and len(data) >= left:
                    if self._reset:
                        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER,
                                          struct.pack('ii', 1, 0))
                    break
                left = None if left is None else left - len(part)
            with suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
