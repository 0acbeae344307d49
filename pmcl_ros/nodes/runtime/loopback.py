"""`python -m pmcl_ros.nodes.runtime.loopback`: does a message arrive by this machine's DDS?

Prints one line: the middleware and the domain. Exit status 1 when nothing arrives.
"""

import os
import sys
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.utilities import get_rmw_implementation_identifier
from std_msgs.msg import String

_PATIENCE = 10.0  # s; discovery takes up to 3


def main() -> None:
    """Send until it arrives."""
    rclpy.init()
    topic = f'/pmcl_doctor_{os.getpid()}'
    arrived: list[String] = []
    sender, receiver = rclpy.create_node('pmcl_doctor_a'), rclpy.create_node('pmcl_doctor_b')
    publisher = sender.create_publisher(String, topic, 1)
    receiver.create_subscription(String, topic, arrived.append, 1)
    executor = SingleThreadedExecutor()
    executor.add_node(receiver)
    deadline = time.monotonic() + _PATIENCE
    while not arrived and time.monotonic() < deadline:
        publisher.publish(String(data='?'))
        executor.spin_once(timeout_sec=0.1)
    rclpy.shutdown()
    domain = os.environ.get('ROS_DOMAIN_ID', '0')
    sys.stdout.write(f'{get_rmw_implementation_identifier()}, domain {domain}\n')
    sys.exit(not arrived)


if __name__ == '__main__':
    main()
