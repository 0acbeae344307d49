"""An object's grasps as a YAML file."""

import os
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from pmcl_ros.grasps.grasp import Grasp
from pmcl_ros.grasps.gripper import GripperSettings
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.settings import Settings

_Vector = tuple[float, float, float]
_SLACK = 1e-3  # of hand-written unit vectors: they are normalised


class GraspEntry(Settings):
    """One grasp, in the object's frame."""

    name: str = Field(min_length=1, description='tells it apart')
    kind: Literal['rim', 'side', 'top', 'other'] = Field('other', description='how it holds')
    position: _Vector = Field(description='between the fingers [m]')
    approach: _Vector = Field(description='from the wrist to the fingertips')
    closing: _Vector = Field(description='in which the fingers close, at right angles to it')
    width: float = Field(ge=0, description='of the object between the fingers [m]')
    opening: float = Field(gt=0, description='gap between the fingers on approach [m]')

    @classmethod
    def of(cls, grasp: Grasp) -> 'GraspEntry':
        """Of a Grasp, rounded to micrometres."""
        position, approach, closing = (
            tuple(float(each) for each in np.round(vector, digits) + 0.0)
            for vector, digits in ((grasp.pose[:3, 3], 6), (grasp.approach, 9),
                                   (grasp.closing, 9)))
        return cls.make({'name': grasp.name, 'kind': grasp.kind, 'position': position,
                         'approach': approach, 'closing': closing, 'width': round(grasp.width, 6),
                         'opening': round(grasp.opening, 6)}, grasp.name)

    def grasp(self, source: str) -> Grasp:
        """The Grasp; SettingsError names `source` when the directions make no frame."""
        x, y = np.array(self.approach), np.array(self.closing)
        lengths = np.linalg.norm([x, y], axis=1)
        if (abs(lengths - 1) > _SLACK).any() or abs(x @ y) > _SLACK:
            raise SettingsError(
                f'{source}: grasp {self.name!r}: approach {x.tolist()} and closing {y.tolist()} '
                'must be unit vectors at a right angle to each other')
        if self.width >= self.opening:
            raise SettingsError(f'{source}: grasp {self.name!r}: width {self.width} m must be '
                                f'smaller than opening {self.opening} m')
        x /= lengths[0]
        y -= (y @ x) * x
        return Grasp.of(self.name, self.kind, np.array(self.position), x, y / np.linalg.norm(y),
                        self.width, self.opening)


class GraspFile(Settings):
    """The grasps of one object with one gripper."""

    object: str = Field(description="mesh or object YAML, relative to this file's folder")
    gripper: GripperSettings = Field(GripperSettings(), description='left out: a Fetch')
    grasps: list[GraspEntry] = Field(min_length=1, max_length=1000, description='in any order')

    @classmethod
    def read(cls, path: Path) -> tuple[ObjectModel, GripperSettings, tuple[Grasp, ...]]:
        """The object, the gripper and the grasps of a file.

        Raises SettingsError or ObjectModelError, which say what is wrong with the file or mesh.
        """
        found = cls.load(path)
        names = [each.name for each in found.grasps]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise SettingsError(f'{path}: several grasps are called {", ".join(twice)}; names '
                                'tell grasps apart')
        wide = [each.name for each in found.grasps if each.opening > found.gripper.opening]
        if wide:
            raise SettingsError(f'{path}: the opening of {", ".join(wide)} is larger than the '
                                f"gripper's {found.gripper.opening} m")
        grasps = tuple(each.grasp(str(path)) for each in found.grasps)
        return ObjectModel.load(path.parent / found.object), found.gripper, grasps

    @classmethod
    def write(cls, path: Path, model: Path, gripper: GripperSettings, grasps: tuple[Grasp, ...],
              comment: str = '') -> None:
        """Write what `read` reads. model: of the object, told relative to the file."""
        relative = Path(os.path.relpath(model.resolve(), path.parent.resolve())).as_posix()
        cls(object=relative, gripper=gripper,
            grasps=[GraspEntry.of(each) for each in grasps]).save(path, comment)
