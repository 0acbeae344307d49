"""Nodes of one name in one domain: two graphs that answer each other's topics and services."""

import time

from rclpy.node import Node

# s: what another node that was killed has left is forgotten after 20 s (the lease of Fast DDS).
PATIENCE = 30.0


class Namesakes:
    """Counts the nodes of a node's name. patience: how long they must be there [s]."""

    def __init__(self, node: Node, patience: float) -> None:
        self._node, self._patience = node, patience
        self._alone = time.monotonic()  # when it was so for the last time
        self._warned = False

    def count(self) -> int:
        """How many have been there all the time, with the node itself; the log says it once."""
        own = self._node.get_name(), self._node.get_namespace()
        count = self._node.get_node_names_and_namespaces().count(own)
        now = time.monotonic()
        if count <= 1:
            self._alone, self._warned = now, False
        if now < self._alone + self._patience:
            return 1
        if count > 1 and not self._warned:
            self._warned = True
            self._node.get_logger().warning(
                f'{count} nodes are named {self._node.get_fully_qualified_name()}: they get each '
                "other's pictures and calls; end the others, or give them another ROS_DOMAIN_ID "
                'or namespace')
        return count
