"""The simulated camera on the network: its ports, mDNS announcement and process."""

import asyncio
import contextlib
import logging
import socket
import struct
import subprocess
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from zeroconf import Error, ServiceInfo, Zeroconf

from pmcl_ros.camera.lytro.address import CALLBACK_PORT, SERVICE, Address
from pmcl_ros.camera.lytro.events import HEARTBEAT, Event
from pmcl_ros.camera.lytro.protocol import HEADER_LENGTH, Header
from pmcl_ros.camera.simulated.camera import SimulatedCamera
from pmcl_ros.runtime.errors import CameraError, ProtocolError

READY = 'camera at '  # printed by the process before its address

_USUAL = Address()
_TICK = 0.1  # seconds between heartbeats when nothing else is said
_LARGEST_PAYLOAD = 2**20  # bytes of a request; those of clients have less than 100
_MOST_CONNECTIONS = 64
# Bytes of a payload that are sent in one segment with the header: some clients expect a small
# reply in one piece.
_TOGETHER = 4096

_LOG = logging.getLogger(__name__)


@contextmanager
def announced(address: Address, serial: str) -> Iterator[None]:
    """Announce a camera; CameraError when this machine cannot, or `address` names no interface."""
    name = f'lytro-{serial}'
    properties = ({} if address.callback_port == _USUAL.callback_port
                  else {CALLBACK_PORT: str(address.callback_port).encode()})
    try:
        host = socket.inet_aton(address.host)
        if not any(host):
            raise OSError('no single address; give --host the one to announce')
        info = ServiceInfo(SERVICE, f'{name}.{SERVICE}', address.port, properties=properties,
                           server=f'{name}.local.', addresses=[host])
        network = Zeroconf(interfaces=[address.host])
    except (OSError, Error) as error:
        raise CameraError(f'cannot announce {address} by mDNS: {error}') from None
    try:
        network.register_service(info)
        yield
    except Error as error:
        raise CameraError(f'cannot announce {name} by mDNS: {error!r}') from None
    finally:
        network.close()


class CameraServer:
    """Serves a camera until it is closed; bound when it is made.

    port, callback_port: 0 for any free one. second_port: another port for commands, or None.
    Raises CameraError when a port cannot be had.
    """

    def __init__(self, camera: SimulatedCamera, host: str = '127.0.0.1', port: int = 5678,
                 callback_port: int = 5677, second_port: int | None = None) -> None:
        self._camera = camera
        self._tasks: set[asyncio.Task[None]] = set()
        self._callbacks: set[socket.socket] = set()
        with contextlib.ExitStack() as opened:
            self._commands = [opened.enter_context(_bind(host, each))
                              for each in (port, second_port) if each is not None]
            self._events = opened.enter_context(_bind(host, callback_port))
            opened.pop_all()
        self.address = Address(host=host, port=self._commands[0].getsockname()[1],
                               callback_port=self._events.getsockname()[1])

    async def run(self) -> None:
        """Serve until cancelled."""
        loops = [self._accept(each, self._serve_commands) for each in self._commands]
        loops.append(self._accept(self._events, self._serve_callbacks))
        try:
            await asyncio.gather(*loops)
        finally:
            self._camera.close()
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)
            for listening in (*self._commands, self._events):
                listening.close()

    async def _accept(self, listening: socket.socket,
                      serve: Callable[[socket.socket], Awaitable[None]]) -> None:
        loop = asyncio.get_running_loop()
        while True:
            connected, peer = await loop.sock_accept(listening)
            connected.setblocking(False)
            if len(self._tasks) == _MOST_CONNECTIONS:
                _LOG.warning('refused %s: there are %d connections', peer, _MOST_CONNECTIONS)
                connected.close()
                continue
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            task = asyncio.create_task(self._one(connected, serve))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _one(self, connected: socket.socket,
                   serve: Callable[[socket.socket], Awaitable[None]]) -> None:
        with connected:
            try:
                await serve(connected)
            except ProtocolError as error:
                _LOG.warning('connection closed: %s', error)
            except OSError as error:
                _LOG.info('connection lost: %s', error)

    async def _serve_commands(self, connected: socket.socket) -> None:
        camera, faults = self._camera, self._camera.faults
        incoming, outgoing = _Incoming(connected), _Outgoing(connected, self._camera)
        try:
            while True:
                header = Header.decode(await incoming.exactly(HEADER_LENGTH))
                if header.has_payload and header.length > _LARGEST_PAYLOAD:
                    raise ProtocolError(f'a request announces {header.length} bytes of payload')
                payload = b''
                if header.has_payload:
                    payload = await incoming.exactly(header.length)
                if faults.unanswered():
                    continue
                reply = await camera.answer(header, payload)
                _LOG.debug('%04X %s: %d bytes', header.code, header.parameters.hex(), len(reply))
                await outgoing.send(faults.header(header.reply(len(reply)).encode()), reply)
        except _DroppedError:
            self._drop(connected)

    async def _serve_callbacks(self, connected: socket.socket) -> None:
        loop, queue = asyncio.get_running_loop(), self._camera.listen()
        tick = Event(HEARTBEAT, ('tick',))
        self._callbacks.add(connected)
        try:
            while True:
                try:
                    event = await asyncio.wait_for(queue.get(), _TICK)
                except (TimeoutError, asyncio.TimeoutError):  # two classes until Python 3.11
                    event = tick
                await loop.sock_sendall(connected, event.encode())
        finally:
            self._callbacks.discard(connected)
            self._camera.ignore(queue)

    def _drop(self, connected: socket.socket) -> None:
        """Cut a connection in the manner of the fault."""
        rng = self._camera.faults.rng
        if self._camera.faults.drop_random is None:
            return
        if rng.random() < 0.5:  # a reset: bytes in transit are lost
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
        if rng.random() < 0.5:
            for each in self._callbacks:
                with contextlib.suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)


class _DroppedError(Exception):
    """A fault ends the connection here."""


class _Incoming:
    """Received bytes in pieces of requested lengths."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket, self._rest = connected, bytearray()

    async def exactly(self, count: int) -> bytes:
        loop = asyncio.get_running_loop()
        while len(self._rest) < count:
            data = await loop.sock_recv(self._socket, 65536)
            if not data:
                raise ConnectionError('closed by the client')
            self._rest += data
        wanted = bytes(self._rest[:count])
        del self._rest[:count]
        return wanted


class _Outgoing:
    """Sent bytes, slowed down and cut off by the faults."""

    def __init__(self, connected: socket.socket, camera: SimulatedCamera) -> None:
        self._socket, self._slow = connected, camera.faults.slow
        self._left = camera.faults.budget()

    async def send(self, header: bytes, payload: bytes | memoryview) -> None:
        view = memoryview(payload)
        await self._send(memoryview(header + view[:_TOGETHER]))
        await self._send(view[_TOGETHER:])

    async def _send(self, data: memoryview) -> None:
        loop = asyncio.get_running_loop()
        dropped = self._left is not None and len(data) > self._left
        if self._left is not None:
            data = data[:self._left]
            self._left -= len(data)
        piece = len(data) if self._slow is None else max(1, self._slow // 20)
        while data:
            await loop.sock_sendall(self._socket, data[:piece])
            if self._slow is not None:
                await asyncio.sleep(len(data[:piece]) / self._slow)
            data = data[piece:]
        if dropped:
            raise _DroppedError


def _bind(host: str, port: int) -> socket.socket:
    try:
        family = socket.AF_INET6 if ':' in host else socket.AF_INET
        listening = socket.create_server((host, port), family=family)
    except OSError as error:
        raise CameraError(
            f'cannot listen at {host}:{port} ({error.strerror or error}): is another camera '
            'served there? --port and --callback-port choose others') from None
    listening.setblocking(False)
    return listening


@contextmanager
def served(pictures: Path | str, *options: str
           ) -> Iterator[tuple[Address, 'subprocess.Popen[str]']]:
    """Serve on any free ports of this machine; its address and the process.

    options: of `pmcl camera serve`. Raises CameraError when the process does not come up.
    """
    command = [sys.executable, '-m', 'pmcl_ros.cli', 'camera', 'serve', '--pictures',
               str(pictures), '--port', '0', '--callback-port', '0', *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            if not line.startswith(READY):
                raise CameraError(f'{" ".join(command)} did not start; it printed {line!r}')
            yield Address.parse(line.removeprefix(READY).split()[0]), process
        finally:
            process.terminate()
