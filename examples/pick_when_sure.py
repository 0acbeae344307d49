"""Waits until the object's pose is sure, and prints the grasps for it, the best first.

Run it beside pmcl_node and grasp_node: `python3 pick_when_sure.py --sigma 0.002`. The grasps of
the first pose whose position has a standard deviation of at most --sigma [m] in every direction,
and that has grasps, are printed as YAML, and the program ends. `pick_by_action.py` and
`pick_by_task_constructor.py` beside it pick by them. It needs rclpy, numpy and common messages,
nothing of pmcl_ros, and no MoveIt.
"""

import argparse
import sys

import numpy as np
import rclpy
import yaml
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from rclpy.node import Node


class PickWhenSure(Node):
    """Joins `pose_with_covariance`, `pre_grasps` and `grasps` of one capture, by their stamp."""

    def __init__(self, sigma):
        super().__init__('pick_when_sure')
        self.sigma, self.came, self.ranked = sigma, {}, []
        for kind, topic in ((PoseWithCovarianceStamped, 'pose_with_covariance'),
                            (PoseArray, 'pre_grasps'), (PoseArray, 'grasps')):
            self.create_subscription(
                kind, topic, lambda message, topic=topic: self.on_message(topic, message), 10)

    def on_message(self, topic, message):
        """Take the grasps, once all three of a capture have come and the pose is sure.

        The last capture counts, and its loss: the object may have been moved.
        """
        self.came[topic] = message
        if topic == 'grasps' and not message.poses:
            self.ranked = []
        if len(self.came) < 3 or len({str(each.header.stamp) for each in self.came.values()}) > 1:
            return
        covariance = np.reshape(self.came['pose_with_covariance'].pose.covariance, (6, 6))[:3, :3]
        sigma = np.sqrt(np.linalg.eigvalsh(covariance)[-1])
        grasps, before = self.came['grasps'], self.came['pre_grasps']
        self.get_logger().info(f'{1e3 * sigma:.1f} mm, {len(grasps.poses)} grasps')
        if sigma <= self.sigma:
            self.ranked = [tuple(PoseStamped(header=grasps.header, pose=pose) for pose in pair)
                           for pair in zip(before.poses, grasps.poses, strict=True)]

    def wait(self):
        """(pre-grasp, grasp) PoseStamped of `parent_link`, the best first; at least one."""
        while not self.ranked:
            self.spin()
        return self.ranked

    def spin(self):
        """Handle what comes, for a moment."""
        rclpy.spin_once(self, timeout_sec=0.1)


def argument_parser(text):
    """The options that say when it is sure."""
    parser = argparse.ArgumentParser(description=text)
    parser.add_argument('--sigma', type=float, default=0.002, help='that is sure enough [m]')
    return parser


def as_data(pose):
    """A PoseStamped, field by field."""
    place, turn = pose.pose.position, pose.pose.orientation
    return {'frame': pose.header.frame_id, 'position': [place.x, place.y, place.z],
            'orientation': [turn.x, turn.y, turn.z, turn.w]}


def main():
    """Entry point."""
    options = argument_parser(__doc__).parse_args(rclpy.utilities.remove_ros_args(sys.argv)[1:])
    rclpy.init(args=sys.argv)
    node = PickWhenSure(options.sigma)
    try:
        sys.stdout.write(yaml.safe_dump(
            {'grasps': [{'pre_grasp': as_data(before), 'grasp': as_data(there)}
                        for before, there in node.wait()]}, sort_keys=False))
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
