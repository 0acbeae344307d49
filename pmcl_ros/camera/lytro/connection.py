"""One TCP connection to the command port: a request, its reply, the next request."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pmcl_ros.camera.lytro.frames import HEADER_LENGTH, Header, Request, download
from pmcl_ros.camera.lytro.settings import Address
from pmcl_ros.runtime.errors import LinkError, ProtocolError

_SLOWEST = 10_000  # bytes per second: a reply that comes slower than this has stalled


def dial(host: str, port: int, timeout: float) -> socket.socket:
    """Connect; LinkError says what to look at when nobody answers."""
    try:
        connected = socket.create_connection((host, port), timeout)
    except (OSError, UnicodeError) as error:  # UnicodeError: an impossible host name
        raise LinkError(
            f'no camera answers at {host}:{port} ({_reason(error)}): is it on, its Wi-Fi switched '
            'on, and this machine in its network lytro.camera.NNN? Only one machine can be in it'
        ) from None
    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connected


class Connection:
    """One request in flight at a time; whatever goes wrong closes the connection.

    timeout: seconds to wait for the connection, and for the next bytes of a reply.
    Raises LinkError, or ProtocolError when the reply is not one to the request.
    """

    def __init__(self, address: Address, timeout: float) -> None:
        self._address, self._timeout = address, timeout
        self._socket = dial(address.host, address.port, timeout)
        self._header = bytearray(HEADER_LENGTH)

    def exchange(self, request: Request) -> bytes:
        """Send `request`; the payload of the reply."""
        with self._closed_on_error(request):
            payload = bytearray(self._ask(request))
            self._receive(memoryview(payload))
            return bytes(payload)

    def download(self, offset: int, into: memoryview, landed: Callable[[int], None]) -> int:
        """Ask for the transfer buffer from byte `offset`; as many bytes as came in reply.

        They are written to the beginning of `into`, which is what there is room for; `landed` is
        told how many more are there, as they come.
        """
        request = download(offset, len(into))
        with self._closed_on_error(request):
            length = self._ask(request)
            self._receive(into[:length], landed)
            return length

    def abort(self) -> None:
        """End the connection, also under another thread that waits for a reply."""
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            return  # it has ended already
        finally:
            self._socket.close()

    def _ask(self, request: Request) -> int:
        self._socket.settimeout(self._timeout)
        self._socket.sendall(request.encode())
        self._receive(memoryview(self._header))
        return request.check(Header.decode(bytes(self._header)))

    def _receive(self, into: memoryview, landed: Callable[[int], None] | None = None) -> None:
        """Fill `into`."""
        deadline = time.monotonic() + self._timeout + len(into) / _SLOWEST
        while into:
            left = deadline - time.monotonic()
            if left <= 0:
                raise TimeoutError(f'less than {_SLOWEST} bytes came per second')
            self._socket.settimeout(min(left, self._timeout))
            count = self._socket.recv_into(into)
            if not count:
                raise ConnectionError('the camera closed the connection')
            into = into[count:]
            if landed is not None:
                landed(count)

    @contextmanager
    def _closed_on_error(self, request: Request) -> Iterator[None]:
        """What follows in the stream after an error is unknown."""
        try:
            yield
        except ProtocolError as error:
            self.abort()
            raise ProtocolError(f'{self._address}: {error}') from None
        except OSError as error:
            self.abort()
            raise LinkError(f'lost the camera at {self._address} during {request.command.name} '
                            f'({_reason(error)}): is it still on, and in reach?') from None
        except BaseException:
            self.abort()
            raise


def _reason(error: Exception) -> str:
    if isinstance(error, TimeoutError):
        return str(error) or 'time-out'
    return getattr(error, 'strerror', None) or str(error) or type(error).__name__
