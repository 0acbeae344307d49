"""The transfer buffer of a camera is used by one program of a machine at a time."""

import errno
import logging
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from pmcl_ros.runtime.errors import CameraError, LinkError

_LOG = logging.getLogger(__name__)
_PAUSE = 0.05  # s between two tries


@contextmanager
def buffer_lock(camera: tuple[str, int], longest: float, closed: threading.Event
                ) -> Iterator[None]:
    """Hold the transfer buffer of the camera at an IP address and port.

    A camera has one buffer for all connections, and its raw pictures are equally long: of two
    that are downloaded at once one would be made of parts of both, unseen. Only one machine can
    be in the camera's Wi-Fi, so the lock is of this machine: the name of a Unix socket, which
    ends with its process. Raises CameraError after `longest` seconds, LinkError when `closed`.
    """
    began, told = time.monotonic(), False
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as held:
        while not _bound(held, f'\0pmcl_ros lytro {camera[0]} {camera[1]}'):
            where = f'another program of this machine downloads from the camera at {camera[0]}'
            if not told:
                _LOG.warning('%s: waiting for it', where)
                told = True
            if time.monotonic() > began + longest:
                raise CameraError(f'{where} for {longest:.0f} s already; end it')
            if closed.wait(_PAUSE):
                raise LinkError(f'the connection to the camera at {camera[0]} is closed')
        yield


def _bound(held: socket.socket, name: str) -> bool:
    """Whether a socket has got a name, which another one may have."""
    try:
        held.bind(name)
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise
        return False
    return True
