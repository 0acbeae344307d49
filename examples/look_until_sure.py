"""Looks at an object from where it tells most, until its position is known well enough.

Run it beside sweep_driver (collect: service) and pmcl_node (source: posed_views), when two
pictures have been taken: `python3 look_until_sure.py --sigma 0.0007`. Each turn it asks pmcl_node
where to look next, sends the camera there (`camera_goal`), asks sweep_driver for a picture and
waits for the better pose. It ends when the largest standard deviation of the position is at most
--sigma, with status 1 when that is not reached in --looks turns. `move` is what a pipeline
replaces. It needs rclpy, numpy and common messages, nothing of pmcl_ros.
"""

import argparse
import sys
import time

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger


class LookUntilSure(Node):
    """Asks for views until a pose is sure enough."""

    def __init__(self, options):
        super().__init__('look_until_sure')
        self.options, self.found, self.next_view = options, None, None
        self.create_subscription(PoseWithCovarianceStamped, 'pose_with_covariance',
                                 self.on_pose, 10)
        self.create_subscription(PoseStamped, 'next_view', self.on_next_view, 10)
        self.goals = self.create_publisher(PoseStamped, 'camera_goal', QoSProfile(
            depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))  # for who listens later, too

    def on_pose(self, message):
        """The pose by the views so far."""
        self.found = message

    def on_next_view(self, message):
        """Where to look: the camera's optical frame."""
        self.next_view = message

    def run(self):
        """The pose that is sure enough; None where it cannot be had."""
        self.call('pmcl_node/localize')
        for look in range(self.options.looks + 1):
            found = self.wait('found', 'a pose; where the object is lost, take a picture from '
                              'another side')
            sigma = self.sigma(found)
            self.get_logger().info(f'look {look}: {1e3 * sigma:.2f} mm')
            if sigma <= self.options.sigma:
                return found
            if look < self.options.looks:
                self.call('pmcl_node/next_view')
                self.move(self.wait('next_view', 'the next view'))
                self.found = None  # of the views before
                self.call('sweep_driver/take')
        return None

    @staticmethod
    def sigma(found):
        """Largest standard deviation of the position [m]."""
        covariance = np.reshape(found.pose.covariance, (6, 6))[:3, :3]
        return float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))

    def move(self, goal):
        """Here a pipeline moves the arm, and returns when the camera is at the goal, or near."""
        self.goals.publish(goal)
        time.sleep(self.options.settle)

    def wait(self, name, what):
        """The next message of a subscription."""
        deadline = time.monotonic() + self.options.timeout
        while getattr(self, name) is None:
            if time.monotonic() > deadline:
                raise TimeoutError(f'waited {self.options.timeout:g} s for {what}')
            rclpy.spin_once(self, timeout_sec=0.1)
        message = getattr(self, name)
        setattr(self, name, None)
        return message

    def call(self, service):
        """What a Trigger service does; RuntimeError with its reason where it does not."""
        client = self.create_client(Trigger, service)
        if not client.wait_for_service(self.options.timeout):
            raise TimeoutError(f'nobody offers {client.srv_name}: are the nodes active?')
        future = client.call_async(Trigger.Request())
        rclpy.spin_until_future_complete(self, future, timeout_sec=self.options.timeout)
        if not future.done():
            raise TimeoutError(f'{client.srv_name} does not answer')
        self.destroy_client(client)
        answer = future.result()
        if not answer.success:
            raise RuntimeError(f'{client.srv_name}: {answer.message}')
        self.get_logger().info(answer.message)


def main():
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--sigma', type=float, default=0.0007,
                        help='largest standard deviation of the position that is enough [m]')
    parser.add_argument('--looks', type=int, default=5, help='views at most')
    parser.add_argument('--settle', type=float, default=5.0,
                        help='time that the camera has to reach a goal [s]')
    parser.add_argument('--timeout', type=float, default=60.0, help='for each answer [s]')
    options = parser.parse_args(rclpy.utilities.remove_ros_args(sys.argv)[1:])
    rclpy.init(args=sys.argv)
    node = LookUntilSure(options)
    try:
        found = node.run()
    except (RuntimeError, TimeoutError) as error:
        sys.stderr.write(f'look_until_sure: {error}\n')
        return 2
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    if found is None:
        sys.stderr.write(f'look_until_sure: not sure to {1e3 * options.sigma:g} mm after '
                         f'{options.looks} looks\n')
        return 1
    place = found.pose.pose.position
    sys.stdout.write(f'at ({place.x:.4f}, {place.y:.4f}, {place.z:.4f}) m in '
                     f'{found.header.frame_id}\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
