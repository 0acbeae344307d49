"""Take an object, and put it upright on the tray, or hold it above the water."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import inverse, pose_of
from pmcl_ros.grasps.ranking import Candidate
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.simulation.manipulation.physics import MotionError
from pmcl_ros.simulation.manipulation.workcell import CLEAR, HOLD, Workcell
from pmcl_ros.simulation.manipulation.workplace import Workplace

Array = NDArray[np.float64]

APPROACH = 0.10  # m: straight, before a grasp and after the object is put down
LIFT = 0.15  # m: straight up from where the object was
_ABOVE = 0.002  # m: over the tray, where the object is let go
_RESTS = 1.0  # s: after which it stands still
_SPINS = 12  # of the object about the vertical, in which it may be put down
_TRIES = 2  # to take the object: once more after a slip
_NEARER = 0.0, 0.06, 0.12, 0.18, 0.24  # m: towards the robot, where it is held


@dataclass(frozen=True)
class Sight:
    """An object as the robot sees it: its pose (4, 4) in base_link, and its grasps, best first."""

    pose: Array
    candidates: Sequence[Candidate]


@dataclass(frozen=True)
class Outcome:
    """What came of a trial.

    held: the object was lifted. placed: it stands upright on the tray, or was held above the
    water. cause: of a failure, else empty. largest_touch: force of the robot on the object before
    the fingers first closed [N].
    """

    held: bool
    placed: bool
    cause: str
    largest_touch: float


def pick_and_place(cell: Workcell, model: ObjectModel, look: Callable[[], Sight]) -> Outcome:
    """Take the object and put it on the tray, or out of a tank; once more after a slip.

    look: is called before each try, with the arm anywhere, and again before it approaches what
    floats.
    """
    for _ in range(_TRIES):
        try:
            tool, carried = _take(cell, model, look)
        except MotionError as error:
            return Outcome(False, False, f'no reachable grasp: {error}', cell.largest_touch)
        if cell.held:
            cause = _finish(cell, model, tool, carried)
            return Outcome(True, not cause, cause, cell.largest_touch)
        cell.grip(close=False)
    return Outcome(False, False, 'slip', cell.largest_touch)


def raised(pose: Array, height: float) -> Array:
    """A pose (4, 4) higher by a height [m]."""
    pose = pose.copy()
    pose[2, 3] += height
    return pose


def back(tool: Array, distance: float) -> Array:
    """A pose (4, 4) of the gripper, a distance [m] back along its approach."""
    tool = tool.copy()
    tool[:3, 3] -= distance * tool[:3, 0]
    return tool


def goals(place: Workplace, model: ObjectModel, tool: Array, carried: Array) -> Iterator[Array]:
    """Poses (4, 4) of gripper_link that bring a carried object to its end.

    tool: (4, 4) gripper_link now. carried: (4, 4) the object in it. In a sink: upright, just above
    the tray. In a tank: turned as it is, clear of the water.
    """
    if place.kind == 'tank':
        now = tool @ carried
        lowest = (model.vertices @ now[2, :3]).min() + now[2, 3]
        for nearer in _NEARER:
            goal = raised(tool, place.level + CLEAR + 0.01 - lowest)
            goal[0, 3] -= nearer
            yield goal
        return
    x, y, z = place.tray
    spot = np.array([x, y, z + _ABOVE - model.vertices[:, 2].min()])
    for spin in Rotation.from_euler('z', 2 * np.pi * np.arange(_SPINS)[:, None] / _SPINS):
        yield pose_of(spin, spot) @ inverse(carried)


def _take(cell: Workcell, model: ObjectModel, look: Callable[[], Sight]) -> tuple[Array, Array]:
    """Grasp and lift the object; returns where the gripper took it, and its pose in gripper_link.

    Raises MotionError when no candidate can be reached.
    """
    sight = look()
    cause = MotionError('all are blocked' if sight.candidates else 'there are no candidates')
    for candidate in sight.candidates:
        tool, carried = candidate.pose, inverse(candidate.pose) @ sight.pose
        posture = _posture(cell, model, tool, carried)
        if posture is None:
            continue
        try:
            cell.move(back(tool, APPROACH), avoid=sight.pose, like=posture)
            if cell.task.place.kind == 'tank':  # it has drifted meanwhile
                tool = tool.copy()
                tool[:3, 3] += look().pose[:3, 3] - sight.pose[:3, 3]
            cell.move(tool, straight=True)
        except MotionError as error:
            cause = error
            continue
        cell.grip(close=True)
        try:
            cell.move(raised(tool, LIFT), straight=True)
        except MotionError:
            cell.move(raised(tool, LIFT), carried=carried)
        return tool, carried
    raise cause


def _posture(cell: Workcell, model: ObjectModel, tool: Array, carried: Array) -> Array | None:
    """Angles before a grasp, from which the arm can approach, lift, and bring the object on."""
    ends = list(goals(cell.task.place, model, tool, carried))
    for before in cell.postures(back(tool, APPROACH), avoid=tool @ carried):
        for grasp in cell.postures(tool, straight=True, start=before):
            for lifted in cell.postures(raised(tool, LIFT), straight=True, start=grasp):
                if cell.task.place.kind == 'sink':
                    return before if _end(cell, model, tool, carried) is not None else None
                if any(cell.postures(goal, straight=True, carried=carried, start=lifted)
                       for goal in ends):
                    return before
    return None


def _end(cell: Workcell, model: ObjectModel, tool: Array, carried: Array
         ) -> tuple[Array, Array] | None:
    """One of `goals` that the arm reaches soonest and draws back from; its posture there, or above
    the tray.
    """
    place = cell.task.place
    ends = list(goals(place, model, tool, carried))
    if place.kind == 'tank':
        # On a line the object hangs as it did.
        found = ((goal, posture) for straight in (True, False) for goal in ends
                 for posture in cell.postures(goal, straight=straight, carried=carried))
        return next(found, None)
    downs = [(goal, down) for goal in ends for down in cell.postures(raised(goal, -_ABOVE))]
    for goal, down in sorted(downs, key=lambda each: float(abs(each[1] - cell.joints).max())):
        if cell.postures(back(goal, APPROACH), straight=True, start=down):
            for over in cell.postures(raised(goal, APPROACH), straight=True, start=down):
                return goal, over
    return None


def _finish(cell: Workcell, model: ObjectModel, tool: Array, carried: Array) -> str:
    """Bring the held object to its end; returns the cause of a failure, or nothing.

    tool: (4, 4) where gripper_link took it.
    """
    end = _end(cell, model, tool, carried)
    if end is None:
        return 'no reachable place'
    goal, posture = end
    try:
        if cell.task.place.kind == 'tank':
            cell.move(goal, carried=carried, like=posture)
            cell.wait(HOLD)
            return '' if cell.held_clear else 'slip while held'
        cell.move(raised(goal, APPROACH), carried=carried, like=posture)
        if not cell.held:
            return 'slip on the way'
        cell.move(goal, straight=True)
        cell.grip(close=False)
        cell.move(back(goal, APPROACH), straight=True)
    except MotionError as error:
        return f'no path: {error}'
    cell.wait(_RESTS)
    return '' if cell.standing_on_tray else 'not upright on the tray'
