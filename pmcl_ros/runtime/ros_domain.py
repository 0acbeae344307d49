"""The part of the network that ROS nodes started here talk to."""

import os


def own_domain() -> None:
    """Keep other ROS nodes of this machine and of the network out, unless the user chose."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
