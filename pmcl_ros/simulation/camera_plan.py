"""CameraPlan: where cameras stand around a scene, and the errors of an arm that holds them."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of, retract
from pmcl_ros.lightfield.pose_entry import Rigid
from pmcl_ros.lightfield.sweep.plan import BASELINES, SweepPlan
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.settings import Settings
from pmcl_ros.simulation.scenes.scene import Scene

_ARC = re.compile(r'arc:(\d{1,9}):(\d{1,9}(?:\.\d*)?)')
_GRID = re.compile(r'grid:(\d{1,9})x(\d{1,9}):(\d*\.?\d*)')
_MOST = 99  # rows, and columns, of a grid
_STANDING = 0.1  # vertical part of a standing sheet's normal, at most


class CameraPlan(Settings):
    """Poses of a camera around a scene: an arc about the object, a grid, or a list."""

    arc: tuple[int, float] | None = Field(
        None, description='number of cameras, and the angle [deg] from the first to the last: on '
        "a level circle about the middle of the object's region")
    grid: tuple[int, int, float] | None = Field(
        None, description='rows, columns, and the width [m]: parallel cameras in a plane')
    poses: tuple[Rigid, ...] = Field(
        (), description="4x4 each, row by row: camera to the scene's own camera [m]")
    sigma_mm: float = Field(0.0, ge=0, le=100, description='error of the reported poses: '
                            'standard deviation of the position on each axis [mm]')
    sigma_deg: float = Field(0.0, ge=0, le=30, description='of the rotation about each [deg]')
    common: float = Field(0.0, ge=0, le=1, description='share of the variance of these errors '
                          'that all views share, as that of a hand-eye transform')
    stated: bool = Field(True, description='whether the views state these errors; if not, their '
                         'poses count as exact')
    hidden: int = Field(0, ge=0, description='number of views in which a card is before the '
                        'object')

    @model_validator(mode='after')
    def _one(self) -> 'CameraPlan':
        if sum((self.arc is not None, self.grid is not None, bool(self.poses))) != 1:
            raise ValueError('give one of arc, grid and poses')
        if self.arc is not None and not (1 <= self.arc[0] <= 360 and 0 <= self.arc[1] <= 360):
            raise ValueError(f'an arc of {self.arc[0]} cameras over {self.arc[1]:g} degrees: 1 to '
                             '360 cameras, 0 to 360 degrees')
        if self.grid is not None:
            _check_grid(*self.grid)
        if self.hidden > self.count:
            raise ValueError(f'{self.hidden} hidden views of {self.count}: set hidden to '
                             f'{self.count} at most')
        return self

    @property
    def count(self) -> int:
        """Number of cameras."""
        return (self.arc[0] if self.arc else self.grid[0] * self.grid[1] if self.grid
                else len(self.poses))

    @classmethod
    def parse(cls, text: str) -> 'CameraPlan':
        """`arc:COUNT:DEGREES`, `grid:ROWSxCOLUMNS:METRES`, or the path of a YAML file.

        Raises SettingsError.
        """
        arc, grid = _ARC.fullmatch(text), _GRID.fullmatch(text)
        if arc:
            return cls.make({'arc': (int(arc[1]), float(arc[2]))}, text)
        if grid and grid[3].strip('.'):
            return cls.make({'grid': (int(grid[1]), int(grid[2]), float(grid[3]))}, text)
        if not Path(text).is_file() and Path(text).suffix in ('.yaml', '.yml'):
            raise SettingsError(f'there is no {text}')
        if not Path(text).is_file():
            raise SettingsError(f'{text} is no plan of cameras: expected arc:COUNT:DEGREES, '
                                'grid:ROWSxCOLUMNS:METRES or a YAML file')
        return cls.load(Path(text))

    def cameras(self, scene: Scene) -> NDArray[np.float64]:
        """(n, 4, 4) the poses of the cameras, camera to the scene's own camera [m]."""
        if self.arc is not None:
            return _arc(scene, *self.arc)
        return self.fixed

    @property
    def fixed(self) -> NDArray[np.float64]:
        """(n, 4, 4) `cameras` of a grid or a list, which are the same for all scenes."""
        if self.grid is None:
            return np.array(self.poses, float).reshape(-1, 4, 4)
        rows, columns, width = self.grid
        plan = SweepPlan.from_grid(rows, columns, width / max(rows - 1, columns - 1))
        return np.array([each.pose for each in plan.poses])

    def reported(self, cameras: NDArray[np.float64], rng: np.random.Generator
             ) -> NDArray[np.float64]:
        """(n, 4, 4) the poses that an arm with these errors tells of cameras (n, 4, 4).

        Errors are motions of the camera in its own frame; a part is the same for all.
        """
        sigma = np.repeat([1e-3 * self.sigma_mm, np.deg2rad(self.sigma_deg)], 3)
        shared = np.sqrt(self.common) * rng.normal(size=6)
        own = np.sqrt(1 - self.common) * rng.normal(size=(len(cameras), 6))
        errors = retract(np.tile(np.eye(4), (len(cameras), 1, 1)), sigma * (shared + own))
        return np.asarray(cameras @ errors)


def _check_grid(rows: int, columns: int, width: float) -> None:
    """Raise ValueError for what is no grid of cameras."""
    least, most = BASELINES
    if not (rows > 0 and columns > 0 and 1 < max(rows, columns) <= _MOST
            and least <= width / (max(rows, columns) - 1) <= most):
        raise ValueError(
            f'a grid of {rows}x{columns} over {width:g} m: at least 2 cameras, 1 to {_MOST} rows '
            f'and columns, and neighbours {least:.5f} to {most:g} m apart')


def _arc(scene: Scene, count: int, degrees: float) -> NDArray[np.float64]:
    """About the vertical through the middle of the first target's region."""
    middle = np.array(scene.targets[0].roi_center)
    vertical = scene.world_from_camera[2]  # upwards, in the camera's frame
    angles = np.deg2rad(degrees) * (np.linspace(-0.5, 0.5, count) if count > 1 else np.zeros(1))
    turns = Rotation.from_rotvec(angles[:, None] * vertical).as_matrix()
    return pose_of(turns, middle - turns @ middle)


def without_walls_between(scene: Scene, cameras: NDArray[np.float64]) -> Scene:
    """The scene without the standing sheets that hide a target from a camera (n, 4, 4).

    A wall is behind what the scene's own camera sees; cameras far aside would look at its back.
    """
    up = scene.world_from_camera[2]
    hides = scene.hiding_sheets(cameras[:, :3, 3])
    return replace(scene, sheets=tuple(
        each for each, is_between in zip(scene.sheets, hides, strict=True)
        if not (is_between and abs(up @ each.pose[:3, 2]) < _STANDING)))


def in_room(scene: Scene, cameras: Sequence[NDArray[np.float64]] | NDArray[np.float64]
            ) -> NDArray[np.float64]:
    """(n, 4, 4) cameras (n, 4, 4) in the frame of the room.

    Its axes are those of the room (z up), its origin is `Scene.origin`.
    """
    turn = scene.world_from_camera
    room = pose_of(turn, -turn @ scene.origin)
    return np.asarray(room @ np.asarray(cameras))
