"""Inverse and forward kinematics of the arm."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.simulation.manipulation.fetch_arm import ARM, HOME, TOOL, fetch_arm
from pmcl_ros.simulation.manipulation.physics import mink

_FREE = np.array([each.limits is None for each in ARM])
_LIMITS = np.array([(-np.pi, np.pi) if each.limits is None else each.limits for each in ARM])
_NEAR, _PARALLEL = 2e-4, 1e-3  # m, rad: of a solution
_ITERATIONS = 30  # at most, from one start
_STARTS = 10  # random ones, beside the present posture and `HOME`
_DAMPING = 1e-4  # of joint speeds (Levenberg-Marquardt)


class InverseKinematics:
    """Joint angles (7,) [rad] that bring gripper_link to a pose (4, 4) in base_link [m].

    Differential: mink solves a quadratic program for each step. Raises SimulationError where
    MuJoCo or mink are not installed.
    """

    def __init__(self, gripper: GripperSettings) -> None:
        library = mink()
        model = fetch_arm(gripper, fingers=False).compile()
        self._configuration = library.Configuration(model)
        self._task = library.FrameTask(TOOL, 'body', position_cost=1.0, orientation_cost=0.3,
                                       lm_damping=1e-3)
        self._limit = library.ConfigurationLimit(model)
        rng = np.random.default_rng(0)
        low, high = _LIMITS.T
        self._starts = HOME, *rng.uniform(low, high, (_STARTS, len(ARM)))

    def forward(self, joints: NDArray[np.float64]) -> NDArray[np.float64]:
        """(4, 4) the pose of gripper_link in base_link [m] for angles (7,) [rad]."""
        self._configuration.update(joints)
        return np.array(
            self._configuration.get_transform_frame_to_world(TOOL, 'body').as_matrix())

    def near(self, tool: NDArray[np.float64], joints: NDArray[np.float64]
             ) -> NDArray[np.float64] | None:
        """The solution (7,) [rad] that iterations from some angles lead to, or None.

        tool: (4, 4) pose of gripper_link in base_link [m]. joints: (7,) [rad]: the start; free
        joints are within half a turn of it.
        """
        library, arm, task = mink(), self._configuration, self._task
        task.set_target(library.SE3.from_matrix(tool))
        arm.update(joints)
        for _ in range(_ITERATIONS):
            error = task.compute_error(arm)
            if np.linalg.norm(error[:3]) < _NEAR and np.linalg.norm(error[3:]) < _PARALLEL:
                return nearest_turn(arm.q.copy(), joints)
            velocity = library.solve_ik(arm, [task], 1.0, 'daqp', damping=_DAMPING,
                                        limits=[self._limit])
            arm.integrate_inplace(velocity, 1.0)
        return None

    def solutions(self, tool: NDArray[np.float64], joints: NDArray[np.float64]
                  ) -> list[NDArray[np.float64]]:
        """Solutions (7,) [rad] from several starts, the nearest to the angles `joints` first.

        tool, joints: as of `near`. There may be none, and one may be there more than once.
        """
        found = [self.near(tool, start) for start in (joints, *self._starts)]
        turned = [nearest_turn(each, joints) for each in found if each is not None]
        return sorted(turned, key=lambda each: float(abs(each - joints).max()))


def nearest_turn(joints: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same posture (7,) [rad] with each free joint within half a turn of the other's."""
    away = joints - other
    return joints - np.where(_FREE, 2 * np.pi * np.round(away / (2 * np.pi)), 0)


def limits(joints: NDArray[np.float64]) -> NDArray[np.float64]:
    """(7, 2) of the joints [rad]; of a free one, a turn either way from its angle."""
    around = joints[:, None] + np.array([-2 * np.pi, 2 * np.pi])
    return np.where(_FREE[:, None], around, _LIMITS)
