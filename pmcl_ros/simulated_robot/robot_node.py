"""A simulated robot as a ROS node: a planner, an arm, a gripper and a camera at its wrist."""

import argparse
import itertools
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from numpy.typing import NDArray
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.se3 import inverse
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.pose import pose_from, pose_to_message
from pmcl_ros.nodes.runtime.base import SMALL
from pmcl_ros.nodes.runtime.running import pause, ros
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import PmclError, RenderError
from pmcl_ros.runtime.outputs import write_file
from pmcl_ros.simulated_robot.trial import Grip, ManipulationTrial, Picture
from pmcl_ros.simulated_robot.wrist_eyes import RENDERERS, keep_picture, wrist_eye
from pmcl_ros.simulation.described.object_description import load_object
from pmcl_ros.simulation.manipulation.camera_kinds import load_camera
from pmcl_ros.simulation.manipulation.film import Film
from pmcl_ros.simulation.manipulation.workcell import HOLD, Workcell
from pmcl_ros.simulation.manipulation.workplace import OBJECTS, draw_task
from pmcl_ros.simulation.manipulation.workplace_scene import WorkplaceLook
from pmcl_ros.simulation.manipulation.wrist_camera import MOUNT, WristCamera, read_joints
from pmcl_ros.simulation.scenes.poses import Pose

T = TypeVar('T')
BASE, CAMERA, WRIST = 'base_link', 'wrist_camera_optical_frame', 'wrist_roll_link'
_WRIST = GripperSettings().parent_pose  # in gripper_link, which the physics moves
_TIPS = {WRIST: _WRIST, CAMERA: _WRIST @ MOUNT}
_PERIOD = 0.05  # s: between poses that are published around a picture
_SEARCH = 8.0  # s: that pass during a search; the same in each, so that a seed repeats a trial
_FILM, _EVERY = (320, 240), 5  # px; of the calls of `Workcell.watch`


class SimulatedRobot(Node):
    """It does what it is commanded; what is true goes into `trial`, not into messages.

    `~/plan` (nav_msgs/GetPlan): can the link start.header.frame_id come to `goal`, in base_link?
    An empty path: no. tolerance 0: along a straight line; else anywhere. `~/execute` does the
    last plan; once the camera has been moved and is at rest, its `WristEye` publishes a picture,
    and the robot `camera_pose`. `~/grip`: true closes, and tells whether something is held.
    `~/holds`. Planning avoids the object where `pose` says it is, until it is gripped. Stamps are
    of the simulated time, which passes in motions; what floats drifts during a search too.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        super().__init__('robot')
        self._out = options.out
        self._rng = np.random.default_rng([options.seed, 1])
        self._model = ObjectModel.load(options.object)
        self._task = draw_task(np.random.default_rng(options.seed), options.place, self._model)
        self._cell = Workcell(self._task, self._model, options.mass,
                              np.random.default_rng([options.seed, 3]))
        self._cell.wait(0.5)  # a lying object comes to rest
        self._frames: list[NDArray[np.float64]] = []  # states of the film
        self._film = self._start_film()
        self._sensor = load_camera(options.camera).sensor(
            np.random.default_rng([options.seed, 2]))
        self._eye = wrist_eye(self, options.camera, self._rng, options.samples, options.renderer)
        self._wrist_camera = WristCamera.draw(self._rng)
        self._look = WorkplaceLook(self._task.place, load_object(options.object), options.seed)
        self._believed: Pose | None = None
        self._seen_at: NDArray[np.float64] | None = None
        self._planned: tuple[str, Pose, bool] | None = None
        self._gripped = False
        self._carried: Pose | None = None
        self._began, self._epoch = time.monotonic(), self.get_clock().now().nanoseconds
        self._spent = {'rendering': 0.0, 'physics': 0.0}
        self.trial = ManipulationTrial(seed=options.seed, place=options.place,
                                       stands=self._task.stands)
        self._pose = self.create_publisher(PoseStamped, 'camera_pose', SMALL)
        self.create_subscription(PoseStamped, 'pose', self._on_pose, SMALL)
        self.create_service(GetPlan, '~/plan', self._plan)
        self.create_service(Trigger, '~/execute', self._execute)
        self.create_service(SetBool, '~/grip', self._grip)
        self.create_service(Trigger, '~/holds', self._holds)

    # in

    def _on_pose(self, message: PoseStamped) -> None:
        header, pose = pose_from(message)
        if header.frame_id == BASE and not self._gripped:
            self._believed, self._seen_at = pose, self._cell.object_pose[:3, 3].copy()
            self._note(poses=(*self.trial.poses, self._error(pose)))
            if self._task.place.kind == 'tank':
                self._physics(lambda: self._cell.wait(_SEARCH))

    def _plan(self, request: GetPlan.Request, response: GetPlan.Response) -> GetPlan.Response:
        link, goal = request.start.header.frame_id, pose_from(request.goal)[1]
        self._planned = None
        if link not in _TIPS or request.goal.header.frame_id != BASE:
            self.get_logger().error(f'~/plan is for {", ".join(_TIPS)} in {BASE}')
            return response
        is_straight = request.tolerance == 0
        if self._cell.postures(goal, _TIPS[link], is_straight, **self._belief(is_straight)):
            self._planned = link, goal, is_straight
            response.plan.header.frame_id = BASE
            response.plan.poses = [request.goal]
        return response

    def _execute(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._planned is None:
            response.message = 'there is no plan: call ~/plan'
            return response
        (link, goal, is_straight), self._planned = self._planned, None
        try:
            self._physics(lambda: self._cell.move(
                goal, _TIPS[link], is_straight, **self._belief(is_straight)))
        except PmclError as error:
            response.message = str(error)
            return response
        if link == CAMERA:
            self._cell.wait(0.5)
            self._take_picture()
        response.success, response.message = True, f'{link} is there'
        return response

    def _grip(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data and not self.trial.grips:
            spent = sum(self._spent.values())
            self._note(times={'to the grasp': time.monotonic() - self._began - spent})
        reported = self._believed
        moved = None if self._seen_at is None else 1e3 * float(
            np.linalg.norm(self._cell.object_pose[:3, 3] - self._seen_at))
        gap = self._physics(lambda: self._cell.grip(request.data))
        self._gripped = request.data and self._cell.held
        self._carried = (inverse(self._cell.tool) @ self._believed
                         if self._gripped and self._believed is not None else None)
        if request.data:
            self._note(grips=(*self.trial.grips, Grip(
                gap=gap, held=self._gripped, moved=moved,
                off=self.trial.poses[-1] if self.trial.poses else None,
                pose=None if reported is None else tuple(reported.ravel().tolist()))),
                       largest_touch=float(self._cell.largest_touch))
        response.success = self._gripped == request.data
        response.message = f'gap {1e3 * gap:.1f} mm, ' + ('holds' if self._gripped else 'empty')
        return response

    def _holds(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._gripped = response.success = bool(self._cell.held)
        if not self._gripped:
            self._carried = None
        response.message = 'holds' if response.success else 'empty'
        return response

    # out

    def _take_picture(self) -> None:
        began, number = time.monotonic(), len(self.trial.pictures)
        wrist = self._cell.tool @ _WRIST
        camera = self._wrist_camera.seen_from(wrist)
        joints = read_joints(self._rng, self._cell.joints)
        reported = self._wrist_camera.reported(self._cell.forward(joints) @ _WRIST)
        scene = self._look.scene(camera, self._cell.object_pose, self._sensor, number)
        name, now = f'{number:03d}.png', self._epoch + round(1e9 * self._cell.time)
        self._eye.shoot(scene, Header(now, CAMERA), self._out / name)
        self._spent['rendering'] += time.monotonic() - began
        off = pose_error(reported, camera, Symmetry())
        self._note(pictures=(*self.trial.pictures, Picture(
            file=name, camera=tuple(reported.ravel().tolist()),
            error=(1e3 * off.translation, float(np.rad2deg(off.rotation))))))
        for step in (-1, 0, 1):
            stamp = Header(now + round(step * _PERIOD * 1e9), BASE)
            self._pose.publish(PoseStamped(header=header_to_message(stamp),
                                           pose=pose_to_message(reported)))

    def _start_film(self) -> Film | None:
        """From outside, its states noted twice a second of the simulated time."""
        try:
            film = self._cell.film(_FILM)
        except RenderError as error:
            self.get_logger().warning(f'there will be no film: {error}')
            return None
        calls = itertools.count()

        def watch() -> None:
            if next(calls) % _EVERY == 0:
                self._frames.append(film.state())

        self._cell.watch = watch
        return film

    def _physics(self, do: Callable[[], T]) -> T:
        """Do it, and note how long the simulation took."""
        began = time.monotonic()
        try:
            return do()
        finally:
            self._spent['physics'] += time.monotonic() - began

    def _belief(self, is_straight: bool) -> dict[str, Pose | None]:
        """What a motion avoids and carries; on a straight line the arm comes to the object."""
        if is_straight:
            return {}
        return {'avoid': None if self._gripped else self._believed, 'carried': self._carried}

    # what is true

    def _error(self, pose: NDArray[np.float64]) -> tuple[float, float]:
        """Of a pose of the object [mm], [degrees]."""
        off = pose_error(pose, self._cell.object_pose, self._model.symmetry)
        return 1e3 * off.translation, float(np.rad2deg(off.rotation))

    def _note(self, **what: object) -> None:
        self.trial = self.trial.model_copy(update=what)

    def judge(self) -> ManipulationTrial:
        """The trial, once the executive has ended."""
        self._cell.wait(1.0)
        done = bool(self._cell.standing_on_tray)
        if self._task.place.kind == 'tank':
            done = self._cell.held_clear
            self._cell.wait(HOLD)
            done &= self._cell.held_clear
        if self._film is not None:
            keep_picture(self, self._out / 'film.png', self._film.strip(self._frames))
        times = self.trial.times | self._spent
        return self.trial.model_copy(update={'done': done, 'times': times})


def main() -> int:
    """Run a robot with one task until a signal comes; then write OUT/robot.json."""
    parser = argparse.ArgumentParser(prog='simulated_robot', description=__doc__)
    parser.add_argument('--place', choices=list(OBJECTS), default='sink')
    parser.add_argument('--object', type=Path, required=True, help='YAML with appearance')
    parser.add_argument('--mass', type=float, default=0.25, help='of the object [kg]')
    parser.add_argument('--camera', required=True, help='camera.yaml, f01 or f01-raw')
    parser.add_argument('--renderer', choices=list(RENDERERS), default='fast')
    parser.add_argument('--samples', type=int, default=8, help='of a pixel')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--out', type=Path, required=True, help='folder')
    from rclpy.utilities import remove_ros_args
    options = parser.parse_args(remove_ros_args(sys.argv)[1:])
    robot = None
    try:
        try:
            with ros(sys.argv):
                from rclpy.executors import SingleThreadedExecutor
                robot = SimulatedRobot(options)
                executor = SingleThreadedExecutor()
                executor.add_node(robot)
                sys.stdout.write('ready\n')
                sys.stdout.flush()
                while True:
                    executor.spin_once(0.1)
                    pause(0)
        finally:
            if robot is not None:
                write_file(options.out / 'robot.json', robot.judge().model_dump_json(indent=1))
    except PmclError as error:
        sys.stderr.write(f'simulated_robot: {error}\n')
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
