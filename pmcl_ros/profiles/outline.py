"""Boxes around an object in some views, and the upright cylinder that they tell of."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import least_turn, pose_of
from pmcl_ros.runtime.errors import ProfileError

Box = tuple[float, float, float, float]  # left, top, width, height [px]
LEAST_SIDE = 8.0  # px: a smaller box tells nothing
_APART = np.deg2rad(5.0)  # between lines of sight: nearer ones do not tell the depth
_AROUND = 48  # points of a circle
_SLOPPY = 1.15  # times as large may boxes be drawn
_STEEPEST = np.deg2rad(75.0)  # of a line of sight to the level: from above there is no wall


def resized(box: Box, factor: float) -> Box:
    """A box in a picture of `factor` times as many pixels a side; the first's middle is (0, 0)."""
    x, y, width, height = box
    return ((x + 0.5) * factor - 0.5, (y + 0.5) * factor - 0.5, factor * width, factor * height)


@dataclass(frozen=True)
class BoxedView:
    """A view and the box about the object in its picture.

    camera: (4, 4) pose in the reference frame. box: left, top, width, height [px].
    Raises ProfileError for a box that is too small or out of the picture.
    """

    pinhole: Pinhole
    camera: NDArray[np.float64]
    box: Box
    name: str = ''

    def __post_init__(self) -> None:
        left, top, width, height = self.box
        if not (np.isfinite(self.box).all() and min(width, height) >= LEAST_SIDE):
            raise ProfileError(f'{self.name}: the box {_text(self.box)} must have sides of at '
                               f'least {LEAST_SIDE:g} px')
        if not (left + width > 0 and top + height > 0 and left < self.pinhole.width
                and top < self.pinhole.height):
            raise ProfileError(f'{self.name}: the box {_text(self.box)} is outside its picture of '
                               f'{self.pinhole.width}x{self.pinhole.height} px')

    @property
    def sight(self) -> NDArray[np.float64]:
        """(3,) unit vector from the camera through the middle of the box."""
        left, top, width, height = self.box
        middle = np.array([left + width / 2, top + height / 2])
        ray = self.camera[:3, :3] @ self.pinhole.rays(middle)
        return np.asarray(ray / np.linalg.norm(ray))

    def sides(self, up: NDArray[np.float64]) -> tuple[float, float]:
        """Sides of the box across and along an axis [px], whichever way the camera is rolled.

        up: (3,) direction of the axis in the reference frame.
        """
        _, _, width, height = self.box
        ray, axis = self.camera[:3, :3].T @ self.sight, self.camera[:3, :3].T @ up
        x, y, _ = axis * ray[2] - ray * axis[2]  # where a point in the middle moves along the axis
        return (width, height) if abs(y) >= abs(x) else (height, width)


@dataclass(frozen=True)
class Cylinder:
    """About what the boxes hold: an upright cylinder of a radius and a height [m].

    frame: (4, 4) in the reference frame, its origin in the middle, z along the axis, upwards.
    """

    frame: NDArray[np.float64]
    radius: float
    height: float

    def box_in(self, pinhole: Pinhole, camera: NDArray[np.float64]) -> Box:
        """The box about its outline in a camera at a pose (4, 4) in the reference frame."""
        turn = 2 * np.pi * np.arange(_AROUND) / _AROUND
        circle = self.radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        ends = np.concatenate([np.insert(circle, 2, side * self.height / 2, axis=1)
                               for side in (-1, 1)])
        into = np.linalg.inv(camera) @ self.frame
        pixels = pinhole.project(ends @ into[:3, :3].T + into[:3, 3])
        left, top = pixels.min(axis=0)
        width, height = np.ptp(pixels, axis=0)
        return float(left), float(top), float(width), float(height)


def cylinder_in(views: Sequence[BoxedView], up: NDArray[np.float64],
                height: float | None = None) -> Cylinder:
    """The upright cylinder whose outline fills the boxes.

    up: (3,) direction of the axis in the reference frame. height: where it is known; without it
    two views or more are needed. Raises ProfileError where they do not tell the size, and
    where several contradict the height.
    """
    sights, eyes = (np.array(each) for each in zip(
        *((view.sight, view.camera[:3, 3]) for view in views), strict=True))
    rises = np.arcsin(np.clip(-sights @ up, -1, 1))  # how far each looks down
    if (abs(rises) > _STEEPEST).any():
        raise ProfileError('a view looks along the axis, where no profile is seen: take it from '
                           'the side, or say where up is (--up)')
    if len(views) == 1:
        if height is None:
            raise ProfileError('one view with a box does not tell the size: give boxes in two '
                               'views, or --height')
        middle = eyes[0] + _distance(views[0], up, float(rises[0]), height) * sights[0]
    else:
        apart = np.arccos(np.clip(sights @ sights.T, -1, 1)).max()
        if apart < _APART:
            raise ProfileError(f'the views with boxes look in directions only '
                               f'{np.rad2deg(apart):.1f} degrees apart, {np.rad2deg(_APART):g} '
                               'are needed: give a box in another')
        aside = np.eye(3) - sights[:, :, None] * sights[:, None, :]
        middle = np.linalg.solve(aside.sum(axis=0), np.einsum('nij,nj->i', aside, eyes))
    distances = ((middle - eyes) * sights).sum(axis=1)
    if (distances <= 0).any():
        raise ProfileError('the lines of sight through the boxes meet behind a camera: are they '
                           'of the same object, and the poses right?')
    radii, heights = zip(*(_size(view, up, float(rise), float(far)) for view, rise, far in zip(
        views, rises, distances, strict=True)), strict=True)
    if height is not None and len(views) > 1:
        # What is narrower at an end reaches farther there in the same box: it shows less of the
        # circle.
        highest = np.array(heights) + 2 * np.array(radii) * np.tan(abs(rises))
        low, high = min(heights) / _SLOPPY, float(highest.max()) * _SLOPPY
        if not low < height < high:
            raise ProfileError(
                f'the boxes are about something that is {1e3 * low:.0f} to {1e3 * high:.0f} mm '
                f'high, --height says {1e3 * height:.0f} mm: is it in metres, from the table to '
                'the top, and are the boxes about the whole object?')
    return Cylinder(pose_of(_upright(up), middle), float(np.mean(radii)),
                    height or float(np.mean(heights)))


def _size(view: BoxedView, up: NDArray[np.float64], rise: float, distance: float
          ) -> tuple[float, float]:
    """Radius and height [m] of a cylinder that fills a box, seen `rise` from above."""
    width, tall = view.sides(up)
    focal = np.sqrt(view.pinhole.fx * view.pinhole.fy)
    radius = width / 2 * distance / focal
    height = (tall * distance / focal - 2 * radius * abs(np.sin(rise))) / np.cos(rise)
    return radius, max(float(height), radius / 4)


def _distance(view: BoxedView, up: NDArray[np.float64], rise: float, height: float) -> float:
    """Of a cylinder of known height that fills a box [m]."""
    width, tall = view.sides(up)
    wall = max(tall - width * abs(np.sin(rise)), tall / 10)
    return float(np.sqrt(view.pinhole.fx * view.pinhole.fy) * height * np.cos(rise) / wall)


def _upright(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) a rotation whose z is `up`; the identity where that is z."""
    z = np.array([0, 0, 1.0])
    if up @ z < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    return np.asarray(least_turn(z, up).as_matrix())


def _text(box: tuple[float, ...]) -> str:
    return ' '.join(f'{each:g}' for each in box)
