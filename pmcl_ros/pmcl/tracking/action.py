"""Action models of tracking: particles and velocities from one capture to the next."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.particles import perturb
from pmcl_ros.runtime.errors import LocalizationError

_ANCESTORS = 512  # at most: particles of the last state from which the next ones may come

Model = Literal['constant_pose', 'constant_velocity', 'camera']


@dataclass(frozen=True)
class State:
    """The belief at one time: equally weighted particles.

    poses: (n, 4, 4), object to camera [m]. velocities: (n, 6), linear [m/s] and angular [rad/s],
    along and about the camera's axes. camera: (4, 4), camera to the fixed frame; None if unknown.
    """

    stamp_ns: int
    poses: NDArray[np.float64]
    velocities: NDArray[np.float64]
    camera: NDArray[np.float64] | None

    @classmethod
    def at_rest(cls, stamp_ns: int, poses: NDArray[np.float64],
                camera: NDArray[np.float64] | None) -> 'State':
        """The state with velocities of zero."""
        return cls(stamp_ns, poses, np.zeros((len(poses), 6)), camera)


@dataclass(frozen=True)
class ActionModel:
    """How an object moves between two captures.

    translation, rotation: standard deviations of the process noise after `period` seconds [m],
    [rad]; the variances grow linearly with time.
    """

    model: Model
    translation: float
    rotation: float
    period: float

    def predict(self, state: State, stamp_ns: int, camera: NDArray[np.float64] | None,
                rng: np.random.Generator) -> State:
        """The state at a later time, with process noise.

        camera: (4, 4), camera to the fixed frame then. Raises LocalizationError when the time is
        not later, or the model is 'camera' and the camera's pose is not known at both times.
        """
        time = 1e-9 * (stamp_ns - state.stamp_ns)
        if time <= 0:
            raise LocalizationError(f'a capture at {stamp_ns} cannot follow one at '
                                    f'{state.stamp_ns}: it is not newer')
        poses = self._propagate(state, time, camera)
        grown = (time / self.period) ** 0.5
        noisy = perturb(poses, grown * self.translation, grown * self.rotation, rng)
        return State(stamp_ns, noisy, state.velocities, camera)

    def update(self, before: State, stamp_ns: int, poses: NDArray[np.float64],
               camera: NDArray[np.float64] | None, symmetry: Symmetry,
               rng: np.random.Generator) -> State:
        """The state with the found poses (n, 4, 4), later than the state `before`.

        The ancestor of each pose is drawn by the model's transition density, so that velocities
        stay known where poses are uncertain. The velocity is the motion from the ancestor,
        without rotation about the axis of symmetry.
        """
        if self.model != 'constant_velocity':
            return State.at_rest(stamp_ns, poses, camera)
        time = 1e-9 * (stamp_ns - before.stamp_ns)
        expected = self._propagate(before, time, camera)[:_ANCESTORS]
        spread = np.repeat([self.translation, self.rotation], 3) * (time / self.period) ** 0.5
        here, there = (symmetry.local(each, expected[0]) / np.maximum(spread, 1e-9)
                       for each in (poses, expected))
        log_density = -0.5 * cdist(here, there, 'sqeuclidean')
        ancestors = (log_density + rng.gumbel(size=log_density.shape)).argmax(axis=1)
        velocities = symmetry.local(poses, before.poses[ancestors]) / time
        return State(stamp_ns, poses, velocities, camera)

    def _propagate(self, state: State, time: float, camera: NDArray[np.float64] | None
               ) -> NDArray[np.float64]:
        if self.model == 'constant_velocity':
            return retract(state.poses, time * state.velocities)
        if self.model == 'camera':
            if camera is None or state.camera is None:
                raise LocalizationError('the pose of the camera is not known at both captures: '
                                        'publish camera_pose, or /tf, around them')
            return np.asarray(np.linalg.inv(camera) @ state.camera @ state.poses)
        return state.poses
