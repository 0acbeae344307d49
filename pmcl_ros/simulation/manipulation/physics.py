"""MuJoCo, which computes the motion, and mink, which solves inverse kinematics."""

import os
from functools import cache
from types import ModuleType

from pmcl_ros.runtime.errors import SimulationError

_NEEDED = "a simulated arm needs MuJoCo and mink: pip install 'pmcl_ros[manipulate]'"


class MotionError(SimulationError):
    """The arm cannot reach what it was asked to."""


@cache
def mujoco() -> ModuleType:
    """The module mujoco. Raises SimulationError where it is not installed."""
    os.environ.setdefault('MUJOCO_GL', 'egl')  # for pictures without a screen
    try:
        import mujoco as module
    except ImportError:
        raise SimulationError(_NEEDED) from None
    return module


@cache
def mink() -> ModuleType:
    """The module mink. Raises SimulationError where it is not installed."""
    mujoco()  # first: it chooses how pictures are drawn
    try:
        import mink as module
    except ImportError:
        raise SimulationError(_NEEDED) from None
    return module
