"""Addresses and time limits of a camera, and its discovery by mDNS (lytro_f01.md, A1)."""

import re
import threading
import time
from dataclasses import dataclass

from pydantic import Field
from zeroconf import Error, ServiceBrowser, ServiceStateChange, Zeroconf

from pmcl_ros.runtime.errors import CameraError, LinkError, SettingsError
from pmcl_ros.runtime.settings import Settings

SERVICE = '_lytro._tcp.local.'
_OTHERS = 1.0  # s: within which other cameras answer; mDNS asks for 20 to 120 ms (RFC 6762, 6)
CALLBACK_PORT = b'callback_port'  # in the TXT record, empty in a real camera


class Address(Settings):
    """Address of a camera; default: a Lytro in its own network."""

    host: str = Field('10.100.1.1', min_length=1, description='name or address of the camera')
    port: int = Field(5678, ge=1, le=65535, description='TCP port for commands')
    callback_port: int = Field(5677, ge=1, le=65535, description='TCP port for callbacks')

    @classmethod
    def parse(cls, text: str) -> 'Address':
        """Read HOST[:PORT[:CALLBACK_PORT]]; an IPv6 host stands in brackets.

        Raises SettingsError for anything else.
        """
        found = re.fullmatch(r'(?:\[([^][]+)\]|([^][:]+))(?::(\d{1,5})(?::(\d{1,5}))?)?', text)
        if not found:
            raise SettingsError(f'no address of a camera: {text!r}; expected HOST, HOST:PORT or '
                                'HOST:PORT:CALLBACK_PORT, as in 10.100.1.1')
        names = ('host', 'port', 'callback_port')
        given = (found[1] or found[2], found[3], found[4])
        return cls.make({name: value for name, value in zip(names, given, strict=True) if value},
                        text)

    @property
    def text(self) -> str:
        """The address in the form that `parse` reads."""
        return f'{self}:{self.callback_port}'

    def __str__(self) -> str:
        host = f'[{self.host}]' if ':' in self.host else self.host
        return f'{host}:{self.port}'


class LinkSettings(Settings):
    """Time limits of the connections to a camera."""

    timeout: float = Field(5.0, gt=0, le=600, description='longest wait for a connection, a '
                           'reply or its next bytes [s]')
    patience: float = Field(20.0, gt=0, le=3600, description='retry after lost connections until '
                            'nothing was received for this time [s]')
    slowest: float = Field(50_000.0, gt=0, description='slowest download on the whole: one that '
                           'takes longer, and `patience` beside, has failed [bytes/s]')
    picture_timeout: float = Field(30.0, gt=0, le=3600, description='longest time from the '
                                   'capture command until the picture is available [s]')
    watchdog: float = Field(5.0, gt=0, le=600, description='longest silence of the callback '
                            'connection, which ticks every 0.1 s [s]')
    keep_alive: float = Field(25.0, gt=0, le=240, description='query the battery after this time '
                              'without requests: after 300 s the camera turns its Wi-Fi off '
                              '[s]')


@dataclass(frozen=True)
class Announcement:
    """A camera announced by mDNS; name: as in lytro-A000000001."""

    name: str
    address: Address


def find_camera(text: str) -> Address:
    """The address in `text` (see `Address.parse`), or for 'mdns' that of the announced camera.

    Raises SettingsError for an invalid address, LinkError when no camera is announced, CameraError
    when several are.
    """
    if text != 'mdns':
        return Address.parse(text)
    cameras = discover()
    if len(cameras) > 1:
        names = ', '.join(f'{each.name} at {each.address.text}' for each in cameras)
        raise CameraError(f'{len(cameras)} cameras announce themselves: {names}; give the address '
                          'of one')
    return cameras[0].address


def discover(timeout: float = 5.0) -> list[Announcement]:
    """All announced cameras, by name; waits for the first at most `timeout` seconds.

    Raises LinkError when there is none, or when this machine cannot send to multicast addresses.
    """
    advice = 'give its address, which is 10.100.1.1 in its own network lytro.camera.NNN'
    try:
        network = Zeroconf()
    except (OSError, RuntimeError) as error:  # RuntimeError: no network at all
        raise LinkError(f'cannot look for a camera by mDNS ({error}); {advice}') from None
    try:
        names: set[str] = set()
        any_found = threading.Event()

        def changed(name: str, state_change: ServiceStateChange, **_: object) -> None:
            if state_change is not ServiceStateChange.Removed:
                names.add(name)
                any_found.set()

        ServiceBrowser(network, SERVICE, [changed])
        if any_found.wait(timeout):
            time.sleep(_OTHERS)
        cameras = [each for name in sorted(names)
                   if (each := _ask(network, name, timeout)) is not None]
    except (OSError, Error) as error:
        raise LinkError(f'cannot look for a camera by mDNS ({error}); {advice}') from None
    finally:
        network.close()
    if not cameras:
        raise LinkError(f'no camera announced itself by mDNS within {timeout:g} s: is its Wi-Fi '
                        f'switched on, and this machine in its network? Or {advice}')
    return cameras


def _ask(network: Zeroconf, name: str, timeout: float) -> Announcement | None:
    info = network.get_service_info(SERVICE, name, round(1000 * timeout))
    if info is None or not info.port or not (hosts := info.parsed_addresses()):
        return None
    values = {'host': hosts[0], 'port': info.port}
    port = info.properties.get(CALLBACK_PORT)
    if port is not None and port.isdigit():
        values['callback_port'] = int(port)
    return Announcement(name.removesuffix('.' + SERVICE), Address.make(values, name))
