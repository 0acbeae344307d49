"""Where an object that was seen is expected in the next capture: the action models of tracking."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.motion import perturb
from pmcl_ros.runtime.errors import LocalizationError

_ANCESTORS = 512  # at most: particles of the last state that one of the next may be from

Model = Literal['constant_pose', 'constant_velocity', 'camera']


@dataclass(frozen=True)
class State:
    """What is believed at one time: equally weighted particles.

    poses: (n, 4, 4), object to camera. velocities: (n, 6), shift [m/s] and turn [rad/s] about the
    camera's axes. camera: (4, 4), camera to the fixed frame; None where nobody knows.
    """

    stamp_ns: int
    poses: NDArray[np.float64]
    velocities: NDArray[np.float64]
    camera: NDArray[np.float64] | None

    @classmethod
    def at_rest(cls, stamp_ns: int, poses: NDArray[np.float64],
                camera: NDArray[np.float64] | None) -> 'State':
        """Of an object of which no motion is known."""
        return cls(stamp_ns, poses, np.zeros((len(poses), 6)), camera)


@dataclass(frozen=True)
class ActionModel:
    """How an object moves between two captures.

    translation, rotation: standard deviation of what the model leaves open after `period` seconds
    [m, rad]; variances grow with time.
    """

    model: Model
    translation: float
    rotation: float
    period: float

    def predicted(self, state: State, stamp_ns: int, camera: NDArray[np.float64] | None,
                  rng: np.random.Generator) -> State:
        """The state at a later time.

        camera: (4, 4), camera to fixed frame then. Raises LocalizationError when the model is
        'camera' and the camera's pose is not known at both times, or the time is not later.
        """
        time = 1e-9 * (stamp_ns - state.stamp_ns)
        if time <= 0:
            raise LocalizationError(f'a capture at {stamp_ns} cannot follow one at '
                                    f'{state.stamp_ns}: it is not newer')
        poses = self._moved(state, time, camera)
        grown = (time / self.period) ** 0.5
        noisy = perturb(poses, grown * self.translation, grown * self.rotation, rng)
        return State(stamp_ns, noisy, state.velocities, camera)

    def updated(self, before: State, stamp_ns: int, poses: NDArray[np.float64],
                camera: NDArray[np.float64] | None, symmetry: Symmetry,
                rng: np.random.Generator) -> State:
        """The state in which poses (n, 4, 4) were found, later than the state `before`.

        Each came from one of those before, drawn by how likely this model moves that one there: so
        what was known of the velocity is kept where poses are unsure. A turn about the axis of
        symmetry is none.
        """
        if self.model != 'constant_velocity':
            return State.at_rest(stamp_ns, poses, camera)
        time = 1e-9 * (stamp_ns - before.stamp_ns)
        expected = self._moved(before, time, camera)[:_ANCESTORS]
        spread = np.repeat([self.translation, self.rotation], 3) * (time / self.period) ** 0.5
        here, there = (symmetry.local(each, expected[0]) / np.maximum(spread, 1e-9)
                       for each in (poses, expected))
        likely = -0.5 * cdist(here, there, 'sqeuclidean')
        drawn = (likely + rng.gumbel(size=likely.shape)).argmax(axis=1)
        velocities = symmetry.local(poses, before.poses[drawn]) / time
        return State(stamp_ns, poses, velocities, camera)

    def _moved(self, state: State, time: float, camera: NDArray[np.float64] | None
               ) -> NDArray[np.float64]:
        if self.model == 'constant_velocity':
            return retract(state.poses, time * state.velocities)
        if self.model == 'camera':
            if camera is None or state.camera is None:
                raise LocalizationError("the object cannot be moved by the camera's own motion: "
                                        'the pose of the camera is not known at both captures')
            return np.asarray(np.linalg.inv(camera) @ state.camera @ state.poses)
        return state.poses
