"""Cameras that announce themselves; where multicast does not work, that is said."""

import contextlib
import socket
import subprocess
import sys

import pytest

from pmcl_ros.camera.lytro.address import Address, discover, find_camera
from pmcl_ros.camera.simulated.server import announced
from pmcl_ros.runtime.errors import CameraError, LinkError


def multicast_works():
    """Whether this machine can send to the group of mDNS on its loopback."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF,
                          socket.inet_aton('127.0.0.1'))
        sender.sendto(b'', ('224.0.0.251', 5353))
        return True
    return False


@pytest.mark.skipif(not multicast_works(), reason='no multicast on this loopback')
@pytest.mark.parametrize('callback_port', [5677, 4242])
def test_a_camera_that_announces_itself_is_found(callback_port):
    address = Address(host='127.0.0.1', port=4241, callback_port=callback_port)
    with announced(address, f'A{callback_port:09d}'):
        found = {each.name: each.address for each in discover(5)}
    assert found[f'lytro-A{callback_port:09d}'] == address


@pytest.mark.skipif(not multicast_works(), reason='no multicast on this loopback')
def test_of_two_cameras_none_is_taken():
    addresses = [Address(host='127.0.0.1', port=port) for port in (4241, 4243)]
    with announced(addresses[0], 'A1'), announced(addresses[1], 'A2'), pytest.raises(
            CameraError, match=r'\d+ cameras announce.*127\.0\.0\.1:4241.*127\.0\.0\.1:4243'):
        find_camera('mdns')


def test_no_camera_is_told():
    with pytest.raises(LinkError, match=r'mDNS.* 10\.100\.1\.1'):
        discover(0.1)


@pytest.mark.skipif(subprocess.run(['unshare', '-rn', 'true'], check=False).returncode != 0,
                    reason='no network namespaces here')
def test_a_machine_without_a_network_is_told():
    done = subprocess.run(
        ['unshare', '-rn', sys.executable, '-c',
         'from pmcl_ros.camera.lytro.address import discover; discover(0.1)'],
        capture_output=True, text=True, check=False)
    assert 'LinkError: cannot look for a camera by mDNS' in done.stderr
    assert '10.100.1.1' in done.stderr


@pytest.mark.parametrize('host', ['0.0.0.0', 'nonsense', '::1'])
def test_an_address_that_cannot_be_announced(host):
    with pytest.raises(CameraError, match='cannot announce'), announced(Address(host=host), 'A1'):
        pass
