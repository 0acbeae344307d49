"""Still water that carries a closed object, and slowly moves it about."""

import numpy as np
import trimesh
from numpy.typing import NDArray

from pmcl_ros.pmcl.object_model import ObjectModel

Array = NDArray[np.float64]

_PITCH = 0.008  # m: between sample points
_WATER, _GRAVITY = 1000.0, 9.81  # kg/m^3, m/s^2
_DRAG = np.array([1.5, 1.5, 6.0])  # N s/m, of an immersed object; heaving makes waves
_TURNING = 0.02  # N m s
DRIFT, _FASTEST = 0.0015, 0.005  # m/s: of the water, standard deviation and largest
_CHANGES = 8.0  # s: over which the drift changes
_RETURNS = 15.0  # s: in which the water would bring the object back


class Water:
    """Forces of water on an object.

    level: height of the water [m]. start: (2,) about which the object drifts [m].
    """

    def __init__(self, model: ObjectModel, level: float, start: Array, rng: np.random.Generator
                 ) -> None:
        self._points, self._volume = sample_volume(model)
        self._level, self._start, self._rng = level, np.array(start, float), rng
        self._drift = rng.normal(0, DRIFT, 2)

    def force(self, pose: Array, centre: Array, velocity: Array, spin: Array, seconds: float
              ) -> Array:
        """(6,) force [N] and torque about the centre of mass [Nm], in base_link.

        pose: (4, 4) of the object. centre: (3,) its centre of mass [m]; velocity, spin: (3,) of it
        [m/s, rad/s]. seconds: since the last call; the drift changes meanwhile.
        """
        self._stir(pose[:2, 3], seconds)
        points = self._points @ pose[:3, :3].T + pose[:3, 3]
        # A sample counts by the share of its cube that is below the level: no jumps.
        wet = self._volume * np.clip((self._level - points[:, 2]) / _PITCH + 0.5, 0, 1)
        volume = wet.sum()
        share = volume / (self._volume * len(points))
        flow = np.append(self._drift, 0.0)
        up = np.array([0, 0, _WATER * _GRAVITY * volume])
        middle = wet @ points / max(volume, 1e-12)
        force = up - share * _DRAG * (velocity - flow)
        torque = np.cross(middle - centre, up) - share * _TURNING * spin
        return np.concatenate([force, torque])

    def _stir(self, spot: Array, seconds: float) -> None:
        """The drift changes at random, and back to where the object began."""
        part = seconds / _CHANGES
        self._drift += (-self._drift * part - (spot - self._start) * part / _RETURNS
                        + self._rng.normal(0, DRIFT * np.sqrt(2 * part), 2))
        self._drift *= min(1.0, _FASTEST / max(float(np.linalg.norm(self._drift)), 1e-9))


def sample_volume(model: ObjectModel) -> tuple[Array, float]:
    """Points (n, 3) in the object, evenly, and the volume that each stands for [m^3]."""
    mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
    points = np.asarray(mesh.voxelized(_PITCH).fill().points, float)
    return points, float(mesh.volume) / len(points)
