"""Waits until the object's pose is sure, and says what MoveIt's Task Constructor is to do then.

Run it beside pmcl_node and grasp_node: `python3 pick_when_sure.py --sigma 0.002`. The first pose
whose position has a standard deviation of at most --sigma [m] in every direction, and that has
grasps, is printed as the stages of a task, YAML, and the program ends. `pick` is what a pipeline
replaces, by a goal of its action, say. It needs rclpy, numpy and common messages, nothing of
pmcl_ros, and no MoveIt.
"""

import argparse
import sys

import numpy as np
import rclpy
import yaml
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from rclpy.node import Node


class PickWhenSure(Node):
    """Joins `pose_with_covariance`, `pre_grasps` and `grasps` of one capture, by their stamp."""

    def __init__(self, options):
        super().__init__('pick_when_sure')
        self.options, self.came, self.done = options, {}, False
        for kind, topic in ((PoseWithCovarianceStamped, 'pose_with_covariance'),
                            (PoseArray, 'pre_grasps'), (PoseArray, 'grasps')):
            self.create_subscription(
                kind, topic, lambda message, topic=topic: self.on_message(topic, message), 10)

    def on_message(self, topic, message):
        """Pick, once all three of a capture have come and the pose is sure."""
        self.came[topic] = message
        if len(self.came) < 3 or len({str(each.header.stamp) for each in self.came.values()}) > 1:
            return
        covariance = np.reshape(self.came['pose_with_covariance'].pose.covariance, (6, 6))[:3, :3]
        sigma = np.sqrt(np.linalg.eigvalsh(covariance)[-1])
        self.get_logger().info(f'{1e3 * sigma:.1f} mm, {len(self.came["grasps"].poses)} grasps')
        if sigma <= self.options.sigma and self.came['grasps'].poses:
            self.pick(self.came['grasps'], self.came['pre_grasps'])

    def pick(self, grasps, pre_grasps):
        """The stages for the best grasp."""
        thing, link, frame = self.options.object, self.options.link, grasps.header.frame_id
        before, there = (place(frame, each.poses[0]) for each in (pre_grasps, grasps))
        stages = [{'Connect': 'the state before with the pre-grasp'},
                  {'ComputeIK': {'GeneratePose': before, 'ik_frame': link}},
                  {'ModifyPlanningScene': {'allow_collisions': [thing, 'the links of the hand']}},
                  {'MoveTo': {'goal': there, 'ik_frame': link}}, {'MoveTo': {'goal': 'closed'}},
                  {'ModifyPlanningScene': {'attach_object': [thing, link]}},
                  {'MoveRelative': {'frame': frame, 'direction': [0.0, 0.0, 0.1]}}]
        sys.stdout.write(yaml.safe_dump({'stages': stages}, sort_keys=False))
        self.done = True


def place(frame, pose):
    """A PoseStamped, field by field."""
    return {'frame': frame, 'position': [getattr(pose.position, each) for each in 'xyz'],
            'orientation': [getattr(pose.orientation, each) for each in 'xyzw']}


def main():
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--sigma', type=float, default=0.002, help='that is sure enough [m]')
    parser.add_argument('--object', default='wine_glass', help='its id in the planning scene')
    parser.add_argument('--link', default='wrist_roll_link', help='parent_link of the grasps')
    options = parser.parse_args(rclpy.utilities.remove_ros_args(sys.argv)[1:])
    rclpy.init(args=sys.argv)
    node = PickWhenSure(options)
    try:
        while rclpy.ok() and not node.done:
            rclpy.spin_once(node, timeout_sec=0.5)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
