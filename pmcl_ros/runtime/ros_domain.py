"""The part of the network that ROS nodes started here talk to."""

import errno
import os
import socket

from pmcl_ros.runtime.errors import PmclError

_DOMAINS = 101  # from 1 on: those whose ports are free for everybody's use
_held: list[socket.socket] = []  # as long as this process lives


def own_domain() -> None:
    """Keep other ROS nodes of this machine and of the network out, unless the user chose.

    The domain is one that no other program that asks here has. Raises PmclError where each is
    taken.
    """
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    if 'ROS_DOMAIN_ID' not in os.environ:
        os.environ['ROS_DOMAIN_ID'] = str(_take_domain())


def _take_domain() -> int:
    for number in range(1, _DOMAINS + 1):
        # An abstract name is the network's, as the domain is, and vanishes with its owner.
        lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            lock.bind(f'\0pmcl_ros-domain-{number}')
        except OSError as error:
            lock.close()
            if error.errno != errno.EADDRINUSE:
                raise
        else:
            _held.append(lock)
            return number
    raise PmclError(f'ROS domains 1 to {_DOMAINS} are all taken by programs like this one: end '
                    'some, or set ROS_DOMAIN_ID')
