"""Epipolar geometry of matches between two cameras, as rays with z = 1 in either camera."""

import numpy as np
from numpy.typing import NDArray


def sampson(rays: NDArray[np.float64], between: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m,) signed distance of matches from their epipolar lines, for a focal length of 1.

    rays: (m, 2, 3) with z = 1, in either camera. between: (m or 1, 4, 4) first to second camera.
    First-order geometric error of Hartley and Zisserman, Multiple View Geometry, 11.4.3.
    """
    one, other = rays[:, 0], rays[:, 1]
    turned = np.einsum('mij,mj->mi', between[:, :3, :3], one)
    line = np.cross(between[:, :3, 3], turned)  # E one
    back = np.einsum('mji,mj->mi', between[:, :3, :3], np.cross(other, between[:, :3, 3]))
    scale = np.square(line[:, :2]).sum(axis=1) + np.square(back[:, :2]).sum(axis=1)
    return np.asarray((other * line).sum(axis=1) / np.sqrt(np.maximum(scale, 1e-18)))


def parallax(rays: NDArray[np.float64], between: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m,) angles between the rays of matches [rad]; negative where they meet behind the cameras.

    rays: (m, 2, 3) in either camera. between: (4, 4) first to second camera.
    """
    one, other = rays[:, 0] @ between[:3, :3].T, rays[:, 1]
    normal = np.cross(other, one)
    ahead = -np.einsum('mi,mi->m', np.cross(other, between[:3, 3]), normal)
    angle = np.arctan2(np.linalg.norm(normal, axis=1), np.einsum('mi,mi->m', one, other))
    return np.where(ahead < 0, -angle, angle)
