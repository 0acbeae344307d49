"""What pmcl_node and grasp_node publish of captures, for the examples that pick by it."""

import time

import numpy as np
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.pose import estimate_to_messages, poses_to_messages
from pmcl_ros.nodes.runtime.base import SMALL
from pmcl_ros.pmcl.estimate import PoseEstimate

SECOND, START = 10**9, 1_700_000_000 * 10**9
BACK = np.zeros((4, 4))
BACK[0, 3] = -0.1  # m: pre-grasps lie so far back along x of base_link
SURE = 0.001, 0.001, 0.001  # m: standard deviations of a position
TURN = np.array([[0.0, -1, 0, 0.5], [1, 0, 0, 0.1], [0, 0, 1, 0.7], [0, 0, 0, 1]])


class GraspedCaptures:
    """Publishes captures, each with a stamp of its own."""

    def __init__(self, user):
        self._user, self._stamps = user, iter(range(START, START + 1000 * SECOND, SECOND))
        self._spreads, self._before, self._there = (
            user.node.create_publisher(kind, topic, SMALL) for kind, topic in (
                (PoseWithCovarianceStamped, 'pose_with_covariance'), (PoseArray, 'pre_grasps'),
                (PoseArray, 'grasps')))

    def send(self, sigmas, grasps, grasped=None):
        """Send a capture: sigmas (3,) [m], grasps (4, 4) each. grasped: another stamp of these."""
        stamp = next(self._stamps)
        estimate = PoseEstimate(Header(stamp, 'base_link'), np.eye(4),
                                np.diag(np.square([*sigmas, 1, 1, 1])), np.eye(4)[None],
                                np.zeros(1), 1.0, False, 'default')
        self._spreads.publish(estimate_to_messages(estimate).with_covariance)
        header = header_to_message(Header(grasped or stamp, 'base_link'))
        for publisher, shift in ((self._before, BACK), (self._there, np.zeros((4, 4)))):
            publisher.publish(PoseArray(header=header, poses=(
                poses_to_messages(np.stack(grasps) + shift) if grasps else [])))

    def send_until(self, told, *capture):
        """Send it until `told()`: DDS may tell the example of a publisher late."""
        while not told():
            self.send(*capture)
            until = time.monotonic() + 0.5
            self._user.wait(lambda until=until: told() or time.monotonic() > until, 'the example')
