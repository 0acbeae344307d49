"""The posterior about the estimate, in millimetres and degrees."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evaluation.report.localization import Localization


class Coordinates(NamedTuple):
    """Deviations from the estimate, in the directions that the symmetry leaves.

    names, units: (d,). particles: (n, d). covariance: (d, d). truth: (d,), if known. mm, deg.
    """

    names: list[str]
    units: list[str]
    particles: NDArray[np.float64]
    covariance: NDArray[np.float64]
    truth: NDArray[np.float64] | None

    @property
    def sigma(self) -> NDArray[np.float64]:
        """(d,) standard deviations."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 1e-12))


def coordinates(run: Localization) -> Coordinates:
    """x, y, z [mm] of the camera's frame, then turns [deg].

    With an axis of symmetry these are its leans in the image's plane and towards the camera;
    without, turns about x, y and z.
    """
    estimate, symmetry = run.estimate, run.model.symmetry
    turns = np.eye(3) if symmetry.axis is None else tilts(estimate.pose, symmetry.axis)
    names = (['about x', 'about y', 'about z'] if symmetry.axis is None
             else ['lean in the image', 'lean to the camera'])
    basis = np.zeros((6, 3 + len(turns)))
    basis[:3, :3], basis[3:, 3:] = np.eye(3), turns.T
    basis = basis * np.array([1e3] * 3 + [180 / np.pi] * len(turns))
    truth = None
    if run.truth is not None and not run.truth.empty:
        truth = symmetry.local(run.truth.pose[None], estimate.pose)[0] @ basis
    return Coordinates(['x', 'y', 'z', *names], ['mm'] * 3 + ['deg'] * len(turns),
                       symmetry.local(estimate.particles, estimate.pose) @ basis,
                       basis.T @ estimate.covariance @ basis, truth)


def tilts(pose: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2, 3) unit turns that lean an axis of symmetry: in the image, and towards the camera.

    The second moves the tip of the axis against the line of sight.
    """
    spindle = pose[:3, :3] @ axis
    ray = pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    inside = ray - spindle * (spindle @ ray)
    if np.linalg.norm(inside) < 1e-3:  # seen along its axis
        inside = np.array([1.0, 0, 0]) - spindle * spindle[0]
    inside = inside / np.linalg.norm(inside)
    return np.stack([inside, np.cross(inside, spindle)])
