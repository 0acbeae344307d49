"""A simulated arm at a workplace: it moves, grips and lifts, by MuJoCo's physics."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import inverse, pose_of
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.simulation.manipulation import object_body
from pmcl_ros.simulation.manipulation.buoyancy import Water
from pmcl_ros.simulation.manipulation.fetch_arm import (
    ARM,
    FINGERS,
    FIXED,
    HOME,
    OBJECT,
    ROBOT,
    STEP,
    TOOL,
    add_box,
    fetch_arm,
)
from pmcl_ros.simulation.manipulation.film import Film
from pmcl_ros.simulation.manipulation.physics import MotionError, mujoco
from pmcl_ros.simulation.manipulation.planner import ROOM, Belief, Planner, to_free
from pmcl_ros.simulation.manipulation.trajectory import timed
from pmcl_ros.simulation.manipulation.workplace import Task, Workplace

Array = NDArray[np.float64]

_ARM = slice(0, len(ARM))
_SPEED, _SLOW = 0.5, 0.08  # shares of the velocity limits: in general, on a straight line
_STILL = 0.01  # rad/s, m/s
_SETTLES = 1.0  # s: in which an arm comes to rest at most
_CLOSING = 0.05  # m/s: speed of the gap
_LOW = 0.15  # of its height: the centre of mass of what floats, so that it floats upright
_WATCH_STEPS = 50  # of the physics, between two calls of `watch`
_WATER_STEPS = 5  # of the physics, between two forces of the water
_UPRIGHT = np.cos(np.radians(15))  # of the lean of what stands
CLEAR, HOLD = 0.10, 3.0  # m, s: so far above the water and so long is held what is lifted


class Workcell:
    """A Fetch's arm, the fixed things of a workplace, and one object. It begins at `HOME`, open.

    mass: of the object [kg]. rng: of the drift of an object that floats. gripper: its sizes. All
    poses are (4, 4), to base_link [m]. Time passes only in `move`, `grip` and `wait`; `watch`,
    where it is set, is then called every 0.1 s. Raises SimulationError where MuJoCo or mink is not
    installed.
    """

    def __init__(self, task: Task, model: ObjectModel, mass: float,
                 rng: np.random.Generator | None = None) -> None:
        self.task, self._gripper = task, GripperSettings()
        self._vertices, self._symmetry = model.vertices, model.symmetry
        spec = fetch_arm(self._gripper)
        for box in task.place.boxes:
            add_box(spec.worldbody, box.name, np.array(box.low), np.array(box.high), FIXED, ROBOT)
        _draw_water(spec, task.place)
        floats = task.place.kind == 'tank'
        heights = model.vertices[:, 2]
        low = float((1 - _LOW) * heights.min() + _LOW * heights.max()) if floats else None
        object_body.add_object(spec, model, mass, low)
        self._model = spec.compile()
        self._data = mujoco().MjData(self._model)
        self._planner = Planner(spec, self._gripper)
        self._water = Water(model, task.place.level, task.pose[:2, 3],
                            rng or np.random.default_rng(0)) if floats else None
        self._object_geoms = self._model.geom_contype == OBJECT
        self._robot_geoms = (self._model.geom_contype & ROBOT).astype(bool)
        self._steps, self._has_closed = 0, False
        self.watch: Callable[[], None] | None = None
        self.largest_touch = 0.0
        self._command = HOME.copy()
        self._data.qpos[_ARM] = self._data.ctrl[_ARM] = HOME
        self._data.qpos[len(ARM):len(ARM) + 2] = self._gripper.opening / 2
        self._data.qpos[len(ARM) + 2:] = to_free(task.pose)
        self._data.ctrl[len(ARM)] = self._gripper.opening
        mujoco().mj_forward(self._model, self._data)

    @property
    def time(self) -> float:
        """Since the beginning [s]."""
        return float(self._data.time)

    @property
    def tool(self) -> Array:
        """Where gripper_link is."""
        return self._pose(TOOL)

    @property
    def object_pose(self) -> Array:
        """Where the object is."""
        return self._pose(object_body.NAME)

    @property
    def joints(self) -> Array:
        """(7,) angles of `ARM` [rad]."""
        return np.array(self._data.qpos[_ARM])

    @property
    def gap(self) -> float:
        """Between the fingers [m]."""
        return float(self._data.qpos[len(ARM):len(ARM) + 2].sum())

    def forward(self, joints: Array) -> Array:
        """Where gripper_link would be for angles (7,) [rad]."""
        return self._planner.forward(joints)

    def postures(self, goal: Array, tip: Array | None = None, straight: bool = False,
                 avoid: Array | None = None, carried: Array | None = None,
                 start: Array | None = None) -> list[Array]:
        """Angles (7,) that bring the tip to a goal and touch nothing; [] for none. As of `move`.

        The nearest to `start` come first.
        start: (7,) angles from which the arm would move, None: from here. Of a straight line the
        whole is tried, and its end is the only one; else the goal only.
        """
        belief = _belief(avoid, carried, straight)
        begin = self._command if start is None else start
        try:
            if straight:
                return [self._planner.line(_tool(goal, tip), begin, belief)[-1]]
            return self._planner.postures(_tool(goal, tip), begin, belief)
        except MotionError:
            return []

    def move(self, goal: Array, tip: Array | None = None, straight: bool = False,
             avoid: Array | None = None, carried: Array | None = None,
             like: Array | None = None) -> None:
        """Bring a frame on the gripper to a goal, and come to rest.

        tip: the frame in gripper_link, None: gripper_link itself. straight: on a line, and slowly.
        avoid: where the object is believed to be, which the arm must not touch. carried: the
        object's pose in gripper_link while it is held, so that it strikes nothing. like: (7,) one
        of `postures` to end in, None: any. Raises MotionError where there is no way.
        """
        tool, belief = _tool(goal, tip), _belief(avoid, carried, straight)
        self._planner.gap = self.gap
        path = (self._planner.line(tool, self._command, belief) if straight
                else self._planner.path(tool, self._command, belief, like))
        for posture in timed(path, _SLOW if straight else _SPEED):
            self._data.ctrl[_ARM] = posture
            self._step()
        self._command = path[-1]
        self._settle()

    def grip(self, close: bool) -> float:
        """Close until the fingers press, or open; returns the gap between them [m]."""
        self._has_closed |= close
        command, end = self._data.ctrl, 0.0 if close else self._gripper.opening
        start = self.gap
        steps = int(abs(end - start) / _CLOSING / STEP)
        for part in np.arange(1, steps + 1) / max(steps, 1):
            command[len(ARM)] = start + (end - start) * part
            self._step()
        self._settle()
        return self.gap

    @property
    def held(self) -> bool:
        """Both fingers touch the object."""
        return all(self._touches(name) for name in FINGERS)

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / STEP)):
            self._step()

    def film(self, size: tuple[int, int]) -> Film:
        """For pictures of its states; size: width and height [pixels]."""
        return Film(self._model, self._data, size)

    @property
    def standing_on_tray(self) -> bool:
        """The object touches the tray and nothing of the robot, upright and at rest.

        Upright as far as can be seen: one that looks the same upside down may be.
        """
        upright = self._symmetry.equivalents(self.object_pose)[:, 2, 2].max() > _UPRIGHT
        moves = np.linalg.norm(self._data.qvel[-6:-3])
        return bool(upright and moves < _STILL and self._touches('tray')
                    and not self._robot_touches().any())

    @property
    def held_clear(self) -> bool:
        """The object is held, all of it clear of the water."""
        pose = self.object_pose
        lowest = (self._vertices @ pose[2, :3]).min() + pose[2, 3]
        return bool(self.held and lowest > self.task.place.level + CLEAR)

    def _pose(self, body: str) -> Array:
        found = self._data.body(body)
        return pose_of(found.xmat.reshape(3, 3), found.xpos)

    def _step(self) -> None:
        data = self._data
        if self._water is not None and self._steps % _WATER_STEPS == 0:
            body = data.body(object_body.NAME)
            data.xfrc_applied[body.id] = self._water.force(
                self._pose(object_body.NAME), body.xipos, *self._velocity(), _WATER_STEPS * STEP)
        self._steps += 1
        if self.watch is not None and self._steps % _WATCH_STEPS == 0:
            self.watch()
        mujoco().mj_step(self._model, data)
        if not self._has_closed and data.ncon:
            self._feel()

    def _velocity(self) -> tuple[Array, Array]:
        """Of the object's centre of mass [m/s], and its spin [rad/s], in base_link."""
        both = np.empty(6)
        body = self._data.body(object_body.NAME)
        mujoco().mj_objectVelocity(self._model, self._data, mujoco().mjtObj.mjOBJ_BODY, body.id,
                                   both, 0)
        return both[3:], both[:3]

    def _feel(self) -> None:
        """Note how hard the robot presses on the object."""
        force, total = np.empty(6), 0.0
        for number in np.flatnonzero(self._robot_touches()):
            mujoco().mj_contactForce(self._model, self._data, int(number), force)
            total += float(np.linalg.norm(force[:3]))
        self.largest_touch = max(self.largest_touch, total)

    def _robot_touches(self) -> NDArray[np.bool_]:
        """(contacts,) between robot and object."""
        pairs = self._data.contact.geom
        return np.asarray(self._object_geoms[pairs].any(axis=1)
                          & self._robot_geoms[pairs].any(axis=1))

    def _touches(self, name: str) -> bool:
        """Whether the object touches a geom."""
        pairs = self._data.contact.geom
        other = self._model.geom(name).id
        return bool((self._object_geoms[pairs].any(axis=1) & (pairs == other).any(axis=1)).any())

    def _settle(self) -> None:
        """Until arm and fingers are at rest, or for a second."""
        for _ in range(int(_SETTLES / STEP)):
            self._step()
            if abs(self._data.qvel[:len(ARM) + 2]).max() < _STILL:
                return


def _draw_water(spec: Any, place: Workplace) -> None:
    """What nothing touches, and lights."""
    spec.visual.headlight.ambient[:] = spec.visual.headlight.diffuse[:] = (0.4, 0.4, 0.4)
    spec.worldbody.add_light(pos=(0.3, -0.8, 2.5), dir=(0.1, 0.4, -1), castshadow=True)
    water = add_box(spec.worldbody, 'water', np.array([*place.low, place.floor]),
                    np.array([*place.high, place.level]), 0, 0)
    water.rgba = (0.3, 0.5, 0.9, 0.35)


def _belief(avoid: Array | None, carried: Array | None, straight: bool) -> Belief:
    """Only on a line may the arm come near to the object."""
    return Belief(avoid, carried) if straight else Belief(avoid, carried, ROOM)


def _tool(goal: Array, tip: Array | None) -> Array:
    """The pose of gripper_link that brings a frame on it to a goal."""
    return goal if tip is None else goal @ inverse(tip)
