"""Paths of the arm that touch nothing."""

from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import interpolate, rotation_angle
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.simulation.manipulation.fetch_arm import ARM, FIXED, OBJECT
from pmcl_ros.simulation.manipulation.inverse_kinematics import InverseKinematics, limits
from pmcl_ros.simulation.manipulation.physics import MotionError, mujoco
from pmcl_ros.simulation.manipulation.roadmap import connect

Array = NDArray[np.float64]

_STEP = 0.015  # rad: between postures of a path that are looked at
_LINE = 0.005  # m: between poses of a straight line
_TURN = 0.05  # rad: likewise
_JUMP = 0.3  # rad: more between neighbours of a line is another posture
_CLEAR = 5e-3  # m: to be kept from everything
ROOM = 0.045  # m: to be kept from an object, which may drift, but on the line to it
_LEAN = 0.3  # rad: more than at its start and its end, on the way of what is carried
_AWAY = np.array([0, 0, -5.0, 1, 0, 0, 0])  # m, quaternion: where no object is in the way


@dataclass(frozen=True)
class Belief:
    """Where the planner takes the object to be.

    avoid: (4, 4) the object in base_link, where the arm must not touch it. carried: (4, 4) the
    object in gripper_link, where it must not touch the place. None: there is none. room: to be
    kept from what is avoided [m]. lean: by which the z of what is carried may be away from up
    [rad].
    """

    avoid: Array | None = None
    carried: Array | None = None
    room: float = _CLEAR
    lean: float = np.pi

    def tilt(self, tool: Array) -> float:
        """By which the z of what is carried is away from up [rad]."""
        if self.carried is None:
            return 0.0
        return float(np.arccos(np.clip(tool[2, :3] @ self.carried[:3, 2], -1, 1)))


class Planner:
    """Plans in a copy of the world: fixed things are known exactly, the object as believed.

    spec: `mujoco.MjSpec` of a Workcell, the joints of the arm first, then those of the fingers,
    then the free joint of the object; its margins are changed.
    """

    def __init__(self, spec: Any, gripper: GripperSettings) -> None:
        for geom in spec.geoms:  # before it is compiled: bodies take their margins from these
            geom.margin = ROOM if geom.contype == OBJECT else _CLEAR
        self._model = model = spec.compile()
        self._data = mujoco().MjData(model)
        self._kinematics = InverseKinematics(gripper)
        self._fixed = model.geom_contype == FIXED
        self._object = model.geom_contype == OBJECT
        self.gap = gripper.opening

    def forward(self, joints: Array) -> Array:
        """(4, 4) gripper_link in base_link for angles (7,) [rad]."""
        return self._kinematics.forward(joints)

    def struck(self, joints: Array, belief: Belief) -> str | None:
        """What the arm, or the object in it, touches in a posture; or that the object leans."""
        mj, data, n = mujoco(), self._data, len(ARM)
        data.qpos[:n], data.qpos[n:n + 2] = joints, self.gap / 2
        data.qpos[n + 2:] = _AWAY
        if belief.avoid is not None:
            data.qpos[n + 2:] = to_free(belief.avoid)
        elif belief.carried is not None:
            tool = self.forward(joints)
            if belief.tilt(tool) > belief.lean:
                return 'the lean of what it carries'
            data.qpos[n + 2:] = to_free(tool @ belief.carried)
        mj.mj_kinematics(self._model, data)
        mj.mj_collision(self._model, data)
        if not data.ncon:
            return None
        pairs = data.contact.geom
        object_, fixed = self._object[pairs].any(axis=1), self._fixed[pairs].any(axis=1)
        # The object may touch the robot that carries it, or else what it is on.
        matters = ~object_ | (fixed if belief.carried is not None else ~fixed)
        room = np.where(object_ & ~fixed, belief.room, _CLEAR)
        matters &= data.contact.dist < room
        if not matters.any():
            return None
        first, second = pairs[np.argmax(matters)]
        name = self._model.geom(int(first if self._fixed[first] else second)).name
        return str(name)

    def path(self, tool: Array, start: Array, belief: Belief, like: Array | None = None) -> Array:
        """(n, 7) a path to a pose of gripper_link: if something is carried on a line if that is
        free, else straight in joint space, else around what is in the way.

        like: (7,) the posture at the goal, None: any. Raises MotionError where there is none.
        """
        if self.struck(start, belief) is not None:  # it is near already
            belief = replace(belief, room=_CLEAR)
        if belief.carried is not None:
            with suppress(MotionError):
                line = self.line(tool, start, belief)
                if like is None or abs(line[-1] - like).max() < _JUMP:
                    return line
            # What leans more than it must is heavy to hold.
            belief = replace(belief, lean=_LEAN + max(belief.tilt(tool), belief.tilt(
                self.forward(start))))
        if like is None:
            goals = self.postures(tool, start, belief)
        else:
            goals = self.postures(tool, like, belief)[:1]
        for goal in goals:
            direct = _between(start, goal)
            if self._blocked(direct, belief) is None:
                return direct
        for goal in goals:
            around = self._around(start, goal, belief)
            if around is not None:
                return around
        raise MotionError(f'no path to {_words(tool)}: blocked by '
                          f'{self._blocked(_between(start, goals[0]), belief)}')

    def line(self, tool: Array, start: Array, belief: Belief) -> Array:
        """(n, 7) a path on which gripper_link moves straight to a pose; MotionError when the arm
        cannot, or touches something.
        """
        first = self.forward(start)
        count = 1 + int(max(np.linalg.norm(tool[:3, 3] - first[:3, 3]) / _LINE,
                            float(rotation_angle(first[None], tool)[0]) / _TURN))
        path = [start]
        for part in np.arange(1, count + 1) / count:
            step = interpolate(first, tool, float(part))
            joints = self._kinematics.near(step, path[-1])
            if joints is None or abs(joints - path[-1]).max() > _JUMP:
                raise MotionError(f'no inverse kinematics on the line to {_words(tool)}')
            struck = self.struck(joints, belief)
            if struck is not None:
                raise MotionError(f'the line to {_words(tool)} is blocked by {struck}')
            path.append(joints)
        return np.array(path)

    def postures(self, tool: Array, start: Array, belief: Belief) -> list[Array]:
        """Angles (7,) at a pose of gripper_link that touch nothing, the nearest to `start` first.

        Raises MotionError where there are none.
        """
        found = self._kinematics.solutions(tool, start)
        if not found:
            raise MotionError(f'no inverse kinematics for {_words(tool)}')
        struck = [self.struck(each, belief) for each in found]
        free = [each for each, what in zip(found, struck, strict=True) if what is None]
        if not free:
            raise MotionError(f'{_words(tool)} is blocked by {struck[0]}')
        return _suppress_duplicates(free)

    def _blocked(self, path: Array, belief: Belief) -> str | None:
        """What a path strikes first; its start, where the arm is, does not count."""
        return next((what for joints in path[1:]
                     if (what := self.struck(joints, belief)) is not None), None)

    def _around(self, start: Array, goal: Array, belief: Belief) -> Array | None:
        """A path with corners, around what is in the way."""
        corners = connect(start, goal, limits(start),
                          lambda a, b: self._blocked(_between(a, b), belief) is None,
                          np.random.default_rng(0))
        if corners is None:
            return None
        return np.concatenate([_between(a, b) for a, b in pairwise(corners)])


def to_free(pose: Array) -> Array:
    """(7,) the coordinates of a free joint: position, quaternion w, x, y, z."""
    quaternion = np.empty(4)
    mujoco().mju_mat2Quat(quaternion, np.ascontiguousarray(pose[:3, :3]).ravel())
    return np.concatenate([pose[:3, 3], quaternion])


def _between(start: Array, goal: Array) -> Array:
    """(n, 7) postures evenly from one to another."""
    count = 1 + int(abs(goal - start).max() / _STEP)
    return start + (goal - start) * np.arange(count + 1)[:, None] / count


def _suppress_duplicates(postures: list[Array]) -> list[Array]:
    """Without those that are like an earlier one."""
    kept: list[Array] = []
    for each in postures:
        if all(abs(each - other).max() > 10 * _STEP for other in kept):
            kept.append(each)
    return kept


def _words(tool: Array) -> str:
    x, y, z = np.round(tool[:3, 3], 3).tolist()
    return f'gripper at ({x}, {y}, {z})'
