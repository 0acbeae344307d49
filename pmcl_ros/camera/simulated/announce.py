"""The simulated camera's mDNS announcement, as a real one's (lytro_f01.md, A1)."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager

from zeroconf import Error, ServiceInfo, Zeroconf

from pmcl_ros.camera.lytro.discovery import CALLBACK_PORT, SERVICE
from pmcl_ros.camera.lytro.settings import Address
from pmcl_ros.runtime.errors import CameraError

_USUAL = Address()


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
