"""Which cameras announce themselves on this machine's networks (lytro_f01.md, A1: mDNS)."""

import threading
from dataclasses import dataclass

from zeroconf import Error, ServiceBrowser, ServiceStateChange, Zeroconf

from pmcl_ros.camera.lytro.settings import Address
from pmcl_ros.runtime.errors import CameraError, LinkError

SERVICE = '_lytro._tcp.local.'
CALLBACK_PORT = b'callback_port'  # in the TXT record, empty in a real camera


@dataclass(frozen=True)
class Announcement:
    """A camera that announces itself; name: as in lytro-A000000001."""

    name: str
    address: Address


def find_camera(text: str) -> Address:
    """The address that `Address.parse` reads, or for 'mdns' that of the camera announced.

    Raises SettingsError when it is none, LinkError when no camera is announced, CameraError when
    several are.
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
    """Wait until a camera is announced, at most `timeout` seconds; all that are, by name.

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
        any_found.wait(timeout)
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
