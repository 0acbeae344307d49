"""Poses: objects at rest on a table, a camera above it, and what stands behind them."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import least_turn, pose_of

Pose = NDArray[np.float64]
_Z = np.array([0, 0, 1.0])


def resting(rng: np.random.Generator, vertices: NDArray[np.floating], way: str,
            up: NDArray[np.floating] = _Z) -> Pose:
    """Draw an object's pose (4, 4) in the world (z up, the table is z = 0), above the origin.

    vertices: (n, 3) of the object [m]; the lowest one touches the table.
    way: 'upright', 'head down', 'lying' (what is up then lies nearly level), or 'tilted' (any
    attitude, held up to 4 cm above the table). up: (3,) of the object, length 1.
    """
    turn = Rotation.from_euler('z', rng.uniform(0, 2 * np.pi))
    lean = {'upright': 0.0, 'head down': np.pi, 'lying': np.pi / 2 + rng.normal(0, 0.04),
            'tilted': np.arccos(rng.uniform(-1, 1))}[way]
    about = Rotation.from_euler('z', rng.uniform(0, 2 * np.pi))
    if not np.array_equal(up, _Z):
        turn = turn * least_turn(np.asarray(up, float), _Z)
    rotation = about * Rotation.from_euler('x', lean) * turn
    low = rotation.apply(vertices)[:, 2].min()
    held = rng.uniform(0, 0.04) if way == 'tilted' else 0.0
    return pose_of(rotation, np.array([0, 0, held - low]))


def camera_above(rng: np.random.Generator, aim: NDArray[np.floating], distance: float,
                 aside: tuple[float, float], heights: tuple[float, float] = (0.15, 1.15),
                 roll: float = 0.1) -> Pose:
    """Draw a camera that looks down at a point of the world; returns camera from world (4, 4).

    aim: (3,) the point [m]. distance: of the camera from it [m]. aside: angles to the right and
    down at which the camera sees it [rad]. heights: limits of the angle at which it looks down
    [rad]. roll: standard deviation of its turn about the optical axis [rad].
    """
    height = np.arcsin(rng.uniform(np.sin(heights[0]), np.sin(heights[1])))
    azimuth = rng.uniform(0, 2 * np.pi)
    back = np.array([np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth),
                     np.sin(height)])
    right = np.cross([0, 0, 1.0], back)
    right /= np.linalg.norm(right)
    rows = np.stack([right, -np.cross(back, right), -back])  # x right, y down, z forward
    looking = (Rotation.from_euler('y', aside[0]) * Rotation.from_euler('x', -aside[1])
               * Rotation.from_euler('z', rng.normal(0, roll)) * Rotation.from_matrix(rows))
    place = np.asarray(aim) + distance * back
    return pose_of(looking, -looking.apply(place))


def viewing_way(camera: Pose) -> NDArray[np.float64]:
    """(2,) the way along the table in which a camera (4, 4), world to camera, looks."""
    return np.asarray(camera[2, :2] / max(float(np.linalg.norm(camera[2, :2])), 1e-9))


def random_heading(rng: np.random.Generator, camera: Pose, spread: float) -> float:
    """Draw an angle about the world's z: that of `viewing_way`, up to a spread off [rad]."""
    x, y = viewing_way(camera)
    return float(np.arctan2(y, x) + rng.uniform(-spread, spread))


def standing_across(heading: float) -> Rotation:
    """Turns a `Sheet` upright on the table, its z at an angle about the world's z [rad]."""
    x, y = np.cos(heading), np.sin(heading)
    return Rotation.from_matrix(np.stack([[-y, x, 0], [0, 0, 1], [x, y, 0]], axis=1))
