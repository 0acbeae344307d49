"""Looks at an object until its pose is sure, picks it up, and puts it upright on a tray.

Run it beside sweep_driver (collect: rest), pmcl_node (source: posed_views) and grasp_node:
`python3 pick_from_water.py --aim 0.65 0 0.65 --tray 0.52 0.43 0.77`. It asks a robot for plans
(`robot/plan`, nav_msgs/GetPlan: the link is start.header.frame_id; tolerance 0: straight), has
them done (`robot/execute`) and grips (`robot/grip`). It looks from the sides that the arm reaches,
then from where pmcl_node expects to learn most. It never grasps at a pose that is lost or not
sure. Status 0: done; 1: not, the last line says why. `Robot` is what a pipeline replaces. It needs
rclpy, numpy and common messages, nothing of pmcl_ros.
"""

import argparse
import itertools
import sys
import time

import numpy as np
import rclpy
from geometry_msgs.msg import Pose, PoseArray, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.srv import GetPlan
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

BASE, CAMERA, WRIST = 'base_link', 'wrist_camera_optical_frame', 'wrist_roll_link'
# Where to look from: turn about the vertical, from the robot's side [deg], and height [deg].
LOOKS = ((0, 60), (75, 55), (-75, 55), (35, 45), (-35, 45), (110, 60), (-110, 60), (0, 80))
NEARER = 0.0, 0.06, 0.12, 0.18, 0.24  # m
SPINS = np.linspace(0, 2 * np.pi, 12, endpoint=False)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class GivenUp(Exception):  # noqa: N818 -- an answer, no defect
    """It cannot be done; the text says why."""


class Robot:
    """Plans and motions, by services."""

    def __init__(self, node, timeout):
        self.node, self.timeout = node, timeout
        self.plans = node.create_client(GetPlan, 'robot/plan')

    def plan(self, link, goal, straight=False):
        """Whether a link can come to a pose (4, 4) in BASE; what `execute` then does."""
        request = GetPlan.Request(tolerance=0.0 if straight else 10.0)
        request.start.header.frame_id, request.goal.header.frame_id = link, BASE
        request.goal.pose = pose_of(goal)
        return bool(self.node.answer(self.plans, request, self.timeout).plan.poses)

    def execute(self):
        """Do the last plan; returns whether it was done."""
        return self.node.call(Trigger, 'robot/execute', Trigger.Request(), self.timeout)

    def move(self, link, goal, straight=False):
        """Plan and do it; returns whether it was done."""
        return self.plan(link, goal, straight) and self.execute()

    def grip(self, close):
        """Close or open; returns whether it then holds, or not, as was wanted."""
        return self.node.call(SetBool, 'robot/grip', SetBool.Request(data=close), self.timeout)

    def holds(self):
        """Whether something is between the fingers."""
        return self.node.call(Trigger, 'robot/holds', Trigger.Request(), self.timeout)


class PickFromWater(Node):
    """Joins what the nodes say of one capture, by its stamp."""

    def __init__(self, options):
        super().__init__('pick_from_water')
        self.options, self.came, self.clients_of = options, {}, {}
        self.robot = Robot(self, options.timeout)
        for kind, topic, qos in (
                (MarkerArray, 'objects', LATCHED), (PoseArray, 'pre_grasps', 10),
                (PoseArray, 'grasps', 10), (PoseStamped, 'next_view', 10),
                (PoseWithCovarianceStamped, 'pose_with_covariance', 10)):
            self.create_subscription(
                kind, topic, lambda message, topic=topic: self.came.update({topic: message}), qos)

    # looking

    def run(self):
        """Look, pick, place; GivenUp where one of them fails."""
        for _ in range(1 + self.options.retries):
            pose, pairs = self.find()
            if self.pick(pose, pairs):
                return
            self.get_logger().warning('it slipped: looking again')
        raise GivenUp('slip')

    def find(self):
        """The pose (4, 4) that is sure enough, and (pre-grasp, grasp) poses of WRIST for it."""
        self.ask('pmcl_node/reset')
        self.ask('sweep_driver/start')
        self.came.clear()
        sides, taken, state = list(self.options.sides or LOOKS), 0, 'not found'
        while taken < self.options.looks:
            if not self.look(sides, state == 'not sure' and taken >= self.options.least):
                break
            taken += 1
            if taken < 2:  # no pose is looked for in one view
                continue
            found = self.result()
            if found is None:
                state = 'not found'
                continue
            sigma = np.sqrt(np.linalg.eigvalsh(
                np.reshape(found.pose.covariance, (6, 6))[:3, :3])[-1])
            grasps = self.of_stamp(found.header.stamp, 'grasps', 'pre_grasps')
            count = len(grasps[0].poses)
            self.get_logger().info(f'{taken} looks: {1e3 * sigma:.1f} mm, {count} grasps')
            state = 'not sure'
            if sigma <= self.options.sigma and count and taken >= self.options.least:
                return matrix_of(found.pose.pose), [
                    (matrix_of(before), matrix_of(there))
                    for there, before in zip(grasps[0].poses, grasps[1].poses, strict=True)]
        raise GivenUp(f'{state} after {taken} looks')

    def look(self, sides, best):
        """Take a picture: where most is learned, or from the next side that the arm reaches."""
        self.came.pop('objects', None)
        if best:
            self.came.pop('next_view', None)
            if self.call(Trigger, 'pmcl_node/next_view', Trigger.Request(), self.options.timeout):
                self.wait(lambda: 'next_view' in self.came, 'the next view')
                if self.robot.move(CAMERA, matrix_of(self.came['next_view'].pose)):
                    return True
        while sides:
            turn, height = np.deg2rad(sides.pop(0))
            if any(self.robot.move(CAMERA, self.from_side(turn, height, roll))
                   for roll in (0, np.pi / 2, -np.pi / 2, np.pi)):
                return True
        return False

    def from_side(self, turn, height, roll):
        """A camera (4, 4) that looks at the aim; turned about its axis by `roll`."""
        aim = np.array(self.options.aim)
        back = np.array([-np.cos(height) * np.cos(turn), -np.cos(height) * np.sin(turn),
                         np.sin(height)])
        right = np.cross(-back, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        down = np.cross(-back, right)
        c, s = np.cos(roll), np.sin(roll)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([c * right + s * down, c * down - s * right, -back], axis=1)
        pose[:3, 3] = aim + self.options.distance * back
        return pose

    def result(self):
        """The pose of the newest capture; None: it is lost."""
        self.wait(lambda: 'objects' in self.came, 'the search')
        marker = self.came['objects'].markers[0]
        if 'lost' in marker.text:
            return None
        return self.of_stamp(marker.header.stamp, 'pose_with_covariance')[0]

    def of_stamp(self, stamp, *topics):
        """Messages of one capture."""
        self.wait(lambda: all(each in self.came and self.came[each].header.stamp == stamp
                              for each in topics), ' and '.join(topics))
        return [self.came[each] for each in topics]

    # picking

    def pick(self, pose, pairs):
        """Whether it stands on the tray, or is lifted; GivenUp where there is no way."""
        for before, there in pairs:
            places = [] if self.options.lift_only else self.places(pose, there)
            if not (places or (self.options.lift_only and self.lifted(there))):
                continue
            if not self.robot.move(WRIST, before):
                continue
            if not self.robot.move(WRIST, there, straight=True):
                continue
            break
        else:
            raise GivenUp(f'no reachable grasp of {len(pairs)}')
        if not self.robot.grip(True):
            self.robot.grip(False)
            return self.back(before)
        for straight, goal in itertools.product((True, False), self.lifted(there)):
            if self.robot.move(WRIST, goal, straight):
                break
        else:
            if self.options.lift_only:
                raise GivenUp('no reachable grasp: no way up with the object')
        if not self.robot.holds():
            return self.back(None)
        return self.options.lift_only or self.place(places)

    def lifted(self, wrist):
        """Poses of WRIST that the arm reaches: straight above, then nearer to the robot."""
        goals = [raised(wrist, self.options.lift) for _ in NEARER]
        for goal, nearer in zip(goals, NEARER, strict=True):
            goal[0, 3] -= nearer
        return [goal for goal in goals if self.robot.plan(WRIST, goal)]

    def places(self, pose, wrist):
        """Poses of WRIST that put the object upright on the tray and that the arm reaches."""
        there = []
        for spin in SPINS:
            upright = np.eye(4)
            c, s = np.cos(spin), np.sin(spin)
            upright[:2, :2] = [[c, -s], [s, c]]
            upright[:3, 3] = self.options.tray
            upright[2, 3] += self.options.gap - self.options.bottom
            goal = upright @ np.linalg.inv(pose) @ wrist
            if self.robot.plan(WRIST, raised(goal, 0.05)):
                there.append(goal)
            if len(there) == 3:
                break
        return there

    def place(self, places):
        """Whether it was put down; GivenUp where there is no way."""
        for goal in places:
            if self.robot.move(WRIST, raised(goal, 0.05)):
                if not self.robot.holds():
                    return self.back(None)
                if not self.robot.move(WRIST, goal, straight=True):
                    continue  # the hand stays closed above the tray
                self.robot.grip(False)
                self.back(behind(goal, 0.1))
                return True
        raise GivenUp('no reachable grasp: no way to the tray with the object')

    def back(self, goal):
        """Away from where it was tried; False."""
        if goal is None:
            self.robot.grip(False)
        else:
            self.robot.move(WRIST, goal, straight=True)
        return False

    # services

    def wait(self, condition, what):
        """Until it holds."""
        deadline = time.monotonic() + self.options.timeout
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError(f'waited {self.options.timeout:g} s for {what}')
            rclpy.spin_once(self, timeout_sec=0.1)

    def ask(self, service):
        """Call a Trigger; GivenUp where it refuses."""
        if not self.call(Trigger, service, Trigger.Request(), self.options.timeout):
            raise GivenUp(f'{service} refuses')

    def call(self, kind, service, request, timeout):
        """Whether a service succeeds."""
        if service not in self.clients_of:
            self.clients_of[service] = self.create_client(kind, service)
        answer = self.answer(self.clients_of[service], request, timeout)
        self.get_logger().info(f'{service}: {answer.message}')
        return answer.success

    def answer(self, client, request, timeout):
        """What a service answers; TimeoutError where it does not."""
        if not client.wait_for_service(timeout):
            raise TimeoutError(f'nobody offers {client.srv_name}')
        future = client.call_async(request)
        rclpy.spin_until_future_complete(self, future, timeout_sec=timeout)
        if not future.done():
            raise TimeoutError(f'{client.srv_name} does not answer')
        return future.result()


def raised(pose, height):
    """A pose (4, 4), higher."""
    pose = pose.copy()
    pose[2, 3] += height
    return pose


def behind(pose, distance):
    """A pose (4, 4), back along its x axis."""
    pose = pose.copy()
    pose[:3, 3] -= distance * pose[:3, 0]
    return pose


def matrix_of(pose):
    """(4, 4) of a Pose."""
    q, p = pose.orientation, pose.position
    w, x, y, z = np.array([q.w, q.x, q.y, q.z]) / np.linalg.norm([q.w, q.x, q.y, q.z])
    matrix = np.eye(4)
    matrix[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                      [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                      [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    matrix[:3, 3] = p.x, p.y, p.z
    return matrix


def pose_of(matrix):
    """A Pose of (4, 4): the quaternion is the largest column of its projector."""
    r = matrix[:3, :3]
    k = np.array([[r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
                  [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
                  [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0],
                  [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)]])
    q = np.linalg.eigh(k)[1][:, -1]
    pose = Pose()
    for name, value in zip('xyz', matrix[:3, 3], strict=True):
        setattr(pose.position, name, float(value))
    for name, value in zip('xyzw', q, strict=True):
        setattr(pose.orientation, name, float(value))
    return pose


def main():
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--aim', type=float, nargs=3, required=True, metavar=('X', 'Y', 'Z'),
                        help='middle of where the object is, in base_link [m]')
    parser.add_argument('--distance', type=float, default=0.45, help='of the camera [m]')
    parser.add_argument('--from', dest='sides', type=float, nargs=2, action='append',
                        metavar=('TURN', 'HEIGHT'), help='look from there: turn about the '
                        "vertical, from the robot's side, and height [deg]; repeat it; default: "
                        'all around')
    parser.add_argument('--sigma', type=float, default=0.0025,
                        help='standard deviation of the position that is sure enough [m]')
    parser.add_argument('--least', type=int, default=3, help='views before a grasp')
    parser.add_argument('--looks', type=int, default=6, help='pictures at most')
    parser.add_argument('--tray', type=float, nargs=3, default=(0.5, 0.4, 0.75),
                        metavar=('X', 'Y', 'Z'), help='where to put it [m]')
    parser.add_argument('--bottom', type=float, default=0.0,
                        help="z of the object's underside in its own frame [m]")
    parser.add_argument('--gap', type=float, default=0.003, help='it is let go so far above [m]')
    parser.add_argument('--lift', type=float, default=0.17, help='out of the water [m]')
    parser.add_argument('--lift-only', action='store_true', help='do not put it down')
    parser.add_argument('--retries', type=int, default=1, help='after a slip')
    parser.add_argument('--timeout', type=float, default=60.0, help='for each answer [s]')
    options = parser.parse_args(rclpy.utilities.remove_ros_args(sys.argv)[1:])
    rclpy.init(args=sys.argv)
    node = PickFromWater(options)
    try:
        node.run()
    except (GivenUp, TimeoutError) as error:
        sys.stderr.write(f'pick_from_water: {error}\n')
        return 1 if isinstance(error, GivenUp) else 2
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    sys.stdout.write('done\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
