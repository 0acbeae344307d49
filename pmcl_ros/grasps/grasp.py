"""Grasps of an object, and the YAML file that holds them."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.settings import Settings

_Vector = tuple[float, float, float]
_TOLERANCE = 1e-3  # of hand-written unit vectors, which are then normalized


@dataclass(frozen=True)
class Grasp:
    """The pose of an open gripper at an object, before it closes.

    name: unique. kind: 'rim' (one finger inside a vessel), 'side', 'top' (over an end of the axis)
        or 'other'.
    pose: (4, 4) the grasp frame (see GripperSettings) in the object's frame.
    width: of the object between the fingers [m]. opening: gap between them on approach [m].
    """

    name: str
    kind: str
    pose: NDArray[np.float64]
    width: float
    opening: float

    @classmethod
    def from_axes(cls, name: str, kind: str, position: NDArray[np.float64],
                  approach: NDArray[np.float64], closing: NDArray[np.float64], width: float,
                  opening: float) -> 'Grasp':
        """From the grasp frame's axes, in the object's frame.

        position: (3,) its origin [m]. approach, closing: (3,) orthonormal, its x and y axes.
        """
        turn = np.column_stack([approach, closing, np.cross(approach, closing)])
        return cls(name, kind, pose_of(turn, position), width, opening)

    @property
    def approach(self) -> NDArray[np.float64]:
        """(3,) unit vector from the wrist to the fingertips."""
        return self.pose[:3, 0]

    @property
    def closing(self) -> NDArray[np.float64]:
        """(3,) unit vector along which the fingers close."""
        return self.pose[:3, 1]


class GraspEntry(Settings):
    """One grasp, in the object's frame."""

    name: str = Field(min_length=1, description='unique')
    kind: Literal['rim', 'side', 'top', 'other'] = Field('other', description='how it holds')
    position: _Vector = Field(description='between the fingers [m]')
    approach: _Vector = Field(description='from the wrist to the fingertips')
    closing: _Vector = Field(description='in which the fingers close, at right angles to it')
    width: float = Field(ge=0, description='of the object between the fingers [m]')
    opening: float = Field(gt=0, description='gap between the fingers on approach [m]')

    @classmethod
    def from_grasp(cls, grasp: Grasp) -> 'GraspEntry':
        """The entry of a grasp, rounded to micrometres."""
        position, approach, closing = (
            tuple(float(each) for each in np.round(vector, digits) + 0.0)
            for vector, digits in ((grasp.pose[:3, 3], 6), (grasp.approach, 9),
                                   (grasp.closing, 9)))
        return cls.make({'name': grasp.name, 'kind': grasp.kind, 'position': position,
                         'approach': approach, 'closing': closing, 'width': round(grasp.width, 6),
                         'opening': round(grasp.opening, 6)}, grasp.name)

    def grasp(self, source: str) -> Grasp:
        """The grasp; SettingsError, which names `source`, when the values are impossible."""
        x, y = np.array(self.approach), np.array(self.closing)
        lengths = np.linalg.norm([x, y], axis=1)
        if (abs(lengths - 1) > _TOLERANCE).any() or abs(x @ y) > _TOLERANCE:
            raise SettingsError(
                f'{source}: grasp {self.name!r}: approach {x.tolist()} and closing {y.tolist()} '
                'must be unit vectors at a right angle to each other')
        if self.width >= self.opening:
            raise SettingsError(f'{source}: grasp {self.name!r}: width {self.width} m must be '
                                f'smaller than opening {self.opening} m')
        x /= lengths[0]
        y -= (y @ x) * x
        return Grasp.from_axes(self.name, self.kind, np.array(self.position), x,
                               y / np.linalg.norm(y), self.width, self.opening)


class GraspFile(Settings):
    """The grasps of one object with one gripper."""

    object: str = Field(description="mesh or object YAML, relative to this file's folder")
    gripper: GripperSettings = Field(GripperSettings(), description='left out: a Fetch')
    grasps: list[GraspEntry] = Field(min_length=1, max_length=1000, description='in any order')

    @classmethod
    def read(cls, path: Path) -> tuple[ObjectModel, GripperSettings, tuple[Grasp, ...]]:
        """The object, the gripper and the grasps of a file.

        Raises SettingsError for an impossible file, ObjectModelError for an impossible mesh.
        """
        found = cls.load(path)
        names = [each.name for each in found.grasps]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise SettingsError(f'{path}: several grasps are called {", ".join(twice)}; names '
                                'must be unique')
        wide = [each.name for each in found.grasps if each.opening > found.gripper.opening]
        if wide:
            raise SettingsError(f'{path}: the opening of {", ".join(wide)} is larger than the '
                                f"gripper's {found.gripper.opening} m")
        grasps = tuple(each.grasp(str(path)) for each in found.grasps)
        return ObjectModel.load(path.parent / found.object), found.gripper, grasps

    @classmethod
    def write(cls, path: Path, model: Path, gripper: GripperSettings, grasps: tuple[Grasp, ...],
              comment: str = '') -> None:
        """Write a file for `read`. model: file of the object, stored relative to this one."""
        relative = Path(os.path.relpath(model.resolve(), path.parent.resolve())).as_posix()
        cls(object=relative, gripper=gripper,
            grasps=[GraspEntry.from_grasp(each) for each in grasps]).save(path, comment)
