"""The fourth of the four values: where the object is, and how sure that is."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.header import Header


@dataclass(frozen=True)
class PoseEstimate:
    """The pose of the mesh frame in the camera's optical frame.

    pose: (4, 4) float64, object to camera, metres.
    covariance: (6, 6) float64, x, y, z [m^2], then rotations about the fixed axes of the camera's
        frame [rad^2]; a free axis of symmetry has variance pi^2 / 3.
    particles: (n, 4, 4) the last population. log_weights: (n,) normalised.
    score: of the pose, in the units of the mode's score.
    lost: the data support no pose.
    """

    header: Header
    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    particles: NDArray[np.float64]
    log_weights: NDArray[np.float64]
    score: float
    lost: bool
    mode: str

    @property
    def quaternion(self) -> NDArray[np.float64]:
        """(4,) x, y, z, w of the orientation."""
        return Rotation.from_matrix(self.pose[:3, :3]).as_quat()

    def as_dict(self) -> dict[str, Any]:
        """The fields of the command line's JSON (architecture, "The command line")."""
        return {'position': self.pose[:3, 3].tolist(),
                'orientation_xyzw': self.quaternion.tolist(),
                'covariance': self.covariance.ravel().tolist(), 'score': self.score,
                'lost': self.lost}

    def describe(self) -> str:
        """One line for people."""
        x, y, z = self.pose[:3, 3]
        sigma = 1e3 * np.sqrt(np.diag(self.covariance)[:3])
        found = 'lost; best hypothesis' if self.lost else 'found'
        return (f'{found} at ({x:.4f}, {y:.4f}, {z:.4f}) m, orientation xyzw '
                f'({", ".join(f"{q:.4f}" for q in self.quaternion)}), score {self.score:.3g}, '
                f'standard deviation ({", ".join(f"{s:.1f}" for s in sigma)}) mm')
