"""What a Fetch needs to pick the object up: grasp_node's grasps as fields of moveit_msgs/Grasp.

Run it beside grasp_node: `python3 fetch_pick.py`. It waits for the grasps of one capture, prints
them as YAML, the best first, and ends; with --forever it goes on. Copy `moveit_grasp` into a
pipeline: where moveit_msgs is installed, the dictionaries have its names, nothing to be converted.
It needs rclpy and common messages, nothing of pmcl_ros.
"""

import argparse
import sys

import rclpy
import yaml
from geometry_msgs.msg import PoseArray
from rclpy.node import Node
from std_msgs.msg import Float32MultiArray

FINGERS = ['l_gripper_finger_joint', 'r_gripper_finger_joint']
EFFORT = 20.0  # N: glass breaks; a Fetch closes with up to 60
APPROACH, RETREAT, LEAST = 0.10, 0.10, 0.08  # m: straight ways; `approach` of grasp_node


def moveit_grasp(number, header, pose, details):
    """A moveit_msgs/Grasp, field by field.

    pose: of wrist_roll_link, the parent of the end effector in the Fetch's SRDF, as MoveIt wants
    it; not of the fingers. details: score, probability, width, opening.
    """
    position, orientation = pose.position, pose.orientation

    def posture(gap, effort):
        return {'joint_names': FINGERS,
                'points': [{'positions': [gap / 2, gap / 2], 'effort': [effort, effort],
                            'time_from_start': {'sec': 2, 'nanosec': 0}}]}

    def way(frame, axis, distance):
        vector = {each: float(each == axis) for each in 'xyz'}
        return {'direction': {'header': {'frame_id': frame}, 'vector': vector},
                'desired_distance': distance, 'min_distance': LEAST}

    return {
        'id': f'grasp_{number}',
        'pre_grasp_posture': posture(details['opening'], EFFORT),
        'grasp_posture': posture(0.0, EFFORT),  # until it holds
        'grasp_pose': {
            'header': {'stamp': {'sec': header.stamp.sec, 'nanosec': header.stamp.nanosec},
                       'frame_id': header.frame_id},
            'pose': {'position': {each: getattr(position, each) for each in 'xyz'},
                     'orientation': {each: getattr(orientation, each) for each in 'xyzw'}}},
        'grasp_quality': details['score'],
        'pre_grasp_approach': way('wrist_roll_link', 'x', APPROACH),
        'post_grasp_retreat': way(header.frame_id, 'z', RETREAT),
        'max_contact_force': EFFORT,
        'allowed_touch_objects': [],
    }


class FetchPick(Node):
    """Joins `grasps` and `grasps/details` of one capture, by their stamp."""

    def __init__(self):
        super().__init__('fetch_pick')
        self.grasps, self.details, self.answered = {}, {}, False
        self.create_subscription(PoseArray, 'grasps', self.on_grasps, 10)
        self.create_subscription(Float32MultiArray, 'grasps/details', self.on_details, 10)

    def on_grasps(self, message):
        """Poses, best first; none where the object is lost or no grasp is safe."""
        stamp = message.header.stamp
        self.grasps = {stamp.sec * 10**9 + stamp.nanosec: message}
        self.join()

    def on_details(self, message):
        """A row for each pose: the second dimension's label names the columns."""
        rows, columns = message.layout.dim
        names = columns.label.split(',')
        values = [message.data[k:k + len(names)] for k in range(0, len(message.data), len(names))]
        self.details = {int(rows.label.partition('stamp=')[2]):
                        [dict(zip(names, map(float, each), strict=True)) for each in values]}
        self.join()

    def join(self):
        """Pick, once both have come."""
        for stamp in self.grasps.keys() & self.details.keys():
            grasps = self.grasps.pop(stamp)
            rows = zip(grasps.poses, self.details.pop(stamp), strict=True)
            self.pick([moveit_grasp(number, grasps.header, *row)
                       for number, row in enumerate(rows)])

    def pick(self, grasps):
        """Here a pipeline plans and moves: MoveIt tries the grasps in this order."""
        if not grasps:
            self.get_logger().warning('no grasp for this capture; grasp_node says why')
            return
        sys.stdout.write(yaml.safe_dump({'grasps': grasps}, sort_keys=False) + '---\n')
        sys.stdout.flush()
        self.answered = True


def main():
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--forever', action='store_true', help='go on after the first grasps')
    options = parser.parse_args(rclpy.utilities.remove_ros_args(sys.argv)[1:])
    rclpy.init(args=sys.argv)
    node = FetchPick()
    try:
        while rclpy.ok() and (options.forever or not node.answered):
            rclpy.spin_once(node, timeout_sec=0.5)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
