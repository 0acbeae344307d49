"""Things in a liquid: where templates that know of none propose them, and how they appear."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.interface import Interface
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.level_of_detail import subdivided

_POINTS = 24  # of the object, evenly over its vertices
_STEPS = 2  # of the fixed-point iteration


def with_sunken(poses: NDArray[np.float64], model: ObjectModel, interface: Interface | None
                ) -> NDArray[np.float64]:
    """(m, 4, 4): poses (n, 4, 4), and of each that is in the liquid where it is by what is seen.

    A template shows an object where it seems to be. The second pose is so far behind the first as
    its points in the liquid are shifted by refraction on average; an object that reaches out of
    the liquid may be proposed by either of its parts. Poses and interface: frame of the camera.
    """
    if interface is None:
        return poses
    sample = model.vertices[np.linspace(0, len(model.vertices) - 1, _POINTS).astype(int)]
    seen = np.einsum('nij,pj->npi', poses[:, :3, :3], sample)
    shift = np.zeros((len(poses), 3))
    for _ in range(_STEPS):
        points = seen + (poses[:, :3, 3] - shift)[:, None]
        moved = interface.apparent(points.reshape(-1, 3)).reshape(points.shape) - points
        wet = moved.any(axis=2)
        shift = moved.sum(axis=1) / np.maximum(wet.sum(axis=1), 1)[:, None]
    sunken = poses[shift.any(axis=1)].copy()
    sunken[:, :3, 3] -= shift[shift.any(axis=1)]
    return np.concatenate([poses, sunken])


def as_it_appears(model: ObjectModel, pose: NDArray[np.float64], interface: Interface | None
                  ) -> ObjectModel:
    """The model deformed as refraction shows it at a pose (4, 4), to be drawn there.

    Pose and interface: frame of the camera. The model itself where there is no liquid.
    """
    if interface is None:
        return model
    finer = subdivided(model)
    turn, shift = pose[:3, :3], pose[:3, 3]
    seen = interface.apparent(finer.vertices @ turn.T + shift)
    return replace(finer, vertices=(seen - shift) @ turn)
