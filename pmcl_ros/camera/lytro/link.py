"""The command connection: requests, replies and downloads that survive lost connections."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from pmcl_ros.camera.client import Pace, retry
from pmcl_ros.camera.lytro.address import Address, LinkSettings
from pmcl_ros.camera.lytro.buffer_lock import buffer_lock
from pmcl_ros.camera.lytro.protocol import (
    CHUNK,
    CONTENT_LENGTH,
    HEADER_LENGTH,
    Header,
    Request,
    decode_length,
    download,
)
from pmcl_ros.runtime.errors import CameraError, LinkError, ProtocolError
from pmcl_ros.runtime.progress import BytesProgress

LARGEST = 64 * 2**20  # bytes; a picture has 16,137,600; larger files are refused

_SLOWEST = 10_000  # bytes per second: slower replies have stalled
_COMPARED = 4096  # bytes, the first ones of a file
_PICTURE = 16_137_600  # bytes
_ANOTHER_CLIENT = 'does another client use the camera?'

T = TypeVar('T')


def dial(host: str, port: int, timeout: float) -> socket.socket:
    """Connect; LinkError with advice when nobody answers."""
    try:
        connected = socket.create_connection((host, port), timeout)
    except (OSError, UnicodeError) as error:  # UnicodeError: an impossible host name
        raise LinkError(
            f'no camera answers at {host}:{port} ({_reason(error)}): is it on, its Wi-Fi switched '
            'on, and this machine in its network lytro.camera.NNN? Only one machine can be in it'
        ) from None
    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connected


def peer_of(connected: socket.socket) -> tuple[str, int]:
    """IP address and port of the other end; LinkError where it has gone already."""
    try:
        host, port, *_ = connected.getpeername()
    except OSError as error:
        connected.close()
        raise LinkError(f'the camera closed the connection at once ({_reason(error)})') from None
    return host, port


class Connection:
    """One request in flight at a time; any error closes the connection.

    timeout: seconds to wait for the connection, and for the next bytes of a reply. peer: IP
    address and port of the camera.
    Raises LinkError, or ProtocolError when the reply is not one to the request.
    """

    def __init__(self, address: Address, timeout: float) -> None:
        self._address, self._timeout = address, timeout
        self._socket = dial(address.host, address.port, timeout)
        self.peer = peer_of(self._socket)
        self._header = bytearray(HEADER_LENGTH)

    def exchange(self, request: Request) -> bytes:
        """Send `request`; the payload of the reply."""
        with self._closed_on_error(request):
            payload = bytearray(self._ask(request))
            self._receive(memoryview(payload))
            return bytes(payload)

    def download(self, offset: int, into: memoryview, landed: Callable[[int], None]) -> int:
        """Download the transfer buffer from byte `offset` into `into`; the bytes received.

        The size of `into` is the requested one. `landed` is called with the number of each new
        bytes.
        """
        request = download(offset, len(into))
        with self._closed_on_error(request):
            length = self._ask(request)
            self._receive(into[:length], landed)
            return length

    def abort(self) -> None:
        """End the connection, also while another thread waits for a reply."""
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
        """Close the connection after an error: the rest of the stream has no meaning."""
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


class Link:
    """Requests and downloads; safe to use from several threads.

    One request is in flight at a time. Other requests may go between two pieces of a download,
    except loads, of any program of this machine: the camera has a single transfer buffer.
    """

    def __init__(self, address: Address, settings: LinkSettings) -> None:
        self.last_exchange = time.monotonic()
        self.made = 0  # connections so far
        self._address, self._settings = address, settings
        self._wire, self._buffer = threading.Lock(), threading.Lock()
        self._connection: Connection | None = None
        self._closed = threading.Event()

    def open(self) -> None:
        """Connect, trying once; LinkError when nobody answers."""
        self.with_connection(lambda _: None)

    def ask(self, request: Request) -> bytes:
        """The reply's payload; only for requests that may be sent twice."""
        return self._retry(lambda: self.ask_once(request))

    def ask_once(self, request: Request) -> bytes:
        """The reply's payload; LinkError when the connection is lost, or cannot be made."""
        return self.with_connection(lambda connection: connection.exchange(request))

    def load(self, request: Request, what: str, expected: int | None = None,
             progress: BytesProgress | None = None, *, grows: bool = False) -> bytes:
        """Load `what` into the transfer buffer and download all of it.

        After a lost connection it is loaded again and the download resumes where it stopped, for
        as long as it is not slower than `slowest` on the whole.
        expected: its length, if known. grows: its length may change between loads; then the
        download starts again. Raises CameraError when the camera does not have it, or when it is
        too large, of another length than expected, or too slow.
        """
        peer = self._retry(lambda: self.with_connection(lambda connection: connection.peer))
        # As long as another program may take for a picture.
        longest = self._settings.patience + max(expected or 0, _PICTURE) / self._settings.slowest
        with self._buffer, buffer_lock(peer, longest, self._closed):
            pace = Pace(what, self._settings.patience, self._settings.slowest)
            download = _Download(self, request, what, expected, progress, grows, pace)
            self._retry(download.run, lambda: download.got)
            return bytes(download.data)

    def close(self) -> None:
        """End the connection; calls that wait in other threads raise LinkError."""
        self._closed.set()
        connection = self._connection
        if connection is not None:
            connection.abort()

    def with_connection(self, step: Callable[[Connection], T]) -> T:
        """Run `step` once with the connection, which is made if there is none."""
        with self._wire:
            if self._closed.is_set():
                raise LinkError(f'the connection to {self._address} is closed')
            if self._connection is None:
                self._connection = Connection(self._address, self._settings.timeout)
                self.made += 1
                if self._closed.is_set():  # `close` did not see this connection
                    self._connection.abort()
            try:
                result = step(self._connection)
            except BaseException:
                self._connection = None  # it has closed itself
                raise
            self.last_exchange = time.monotonic()
            return result

    def _retry(self, step: Callable[[], T], received: Callable[[], int] = lambda: 0) -> T:
        return retry(step, LinkError, self._settings.patience, self._closed, received)


class _Download:
    """A download of the transfer buffer; `run` resumes where the last run was lost."""

    def __init__(self, link: Link, request: Request, what: str, expected: int | None,
                 progress: BytesProgress | None, grows: bool, pace: Pace) -> None:
        self._link, self._request, self._what, self._pace = link, request, what, pace
        self._expected, self._progress = expected, progress
        self._grows = grows
        self.data = bytearray()
        self.got = 0

    def run(self) -> None:
        """Load, then download the missing pieces."""
        found = self._link.ask_once(self._request)
        if self._request.payload is not None and not found:
            raise CameraError(f'the camera has no {self._what}')
        self._check_length()
        while self.got < len(self.data):
            asked = min(CHUNK, len(self.data) - self.got)
            came = self._link.with_connection(self._piece)
            if not came:
                raise ProtocolError(f'the camera sends no byte {self.got} of {len(self.data)} of '
                                    f'{self._what}; {_ANOTHER_CLIENT}')
            if came < asked:  # another client may have loaded a shorter file meanwhile
                self._check_length()
                self._check_bytes(self.got - came, came)
        if self.data:
            self._check_length()  # another client's load would have replaced the buffer
        if len(self.data) > CHUNK:
            self._check_bytes(0, _COMPARED)

    def _piece(self, connection: Connection) -> int:
        into = memoryview(self.data)[self.got:self.got + CHUNK]
        return connection.download(self.got, into, self._landed)

    def _check_bytes(self, first: int, count: int) -> None:
        """Check that the buffer holds what was received from there; else go back to `first`."""
        again = bytearray(count)
        if self._link.with_connection(
                lambda connection: connection.download(first, memoryview(again), lambda _: None)
        ) != count or again != self.data[first:first + count]:
            self.got = first
            raise ProtocolError(f'bytes {first} to {first + count} of {self._what} are not the '
                                f'same twice; {_ANOTHER_CLIENT}')

    def _check_length(self) -> None:
        length = decode_length(self._link.ask_once(CONTENT_LENGTH))
        expected = self._expected
        if expected is None:
            self._expected = expected = length
        if length > LARGEST:
            raise CameraError(f'{self._what} has {length} bytes, more than any file of the '
                              f'camera ({LARGEST})')
        if length != expected and self._grows:
            self._expected, self.data, self.got = None, bytearray(), 0
            raise ProtocolError(f'{self._what} had {expected} bytes and has {length} now')
        if length != expected:
            raise CameraError(f'{self._what} has {length} bytes, expected {expected}: the file is '
                              'damaged, or another client uses the camera too')
        if not self.data:
            self.data = bytearray(length)

    def _landed(self, count: int) -> None:
        self.got += count
        self._pace.check(self.got, len(self.data))
        if self._progress is not None:
            self._progress(self.got, len(self.data))
