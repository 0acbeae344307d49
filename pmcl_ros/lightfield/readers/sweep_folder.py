"""A folder of pictures of one moved camera, with a YAML file of camera and poses."""

import logging
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.pose_entry import Position, Quaternion
from pmcl_ros.lightfield.posed_view import quaternion_pose
from pmcl_ros.lightfield.readers.camera_info_file import camera_entry, is_camera_info
from pmcl_ros.lightfield.readers.pictures import Reduction, picture_size, read_picture
from pmcl_ros.lightfield.sweep.assemble import assemble, is_grid
from pmcl_ros.lightfield.sweep.frame import DistortionModel, Lens, SweepFrame, warn_distorted
from pmcl_ros.lightfield.sweep.settings import SweepSettings
from pmcl_ros.runtime.errors import LightFieldError, told_as
from pmcl_ros.runtime.settings import Settings

NAME = 'sweep.yaml'
_LOG = logging.getLogger(__name__)
_MOST_BYTES = 2 ** 32  # of all pictures


class CameraEntry(Settings):
    """The camera that took all pictures, by these keys or those of a CameraInfo's file."""

    fx: float = Field(gt=1, lt=1e6, description='focal length [px]')
    fy: float | None = Field(None, gt=1, lt=1e6, description='focal length [px]; default: fx')
    cx: float = Field(description='principal point, column [px]')
    cy: float = Field(description='principal point, row [px]')
    model: DistortionModel = Field('plumb_bob', description='of the distortion')
    distortion: tuple[float, ...] = Field((), description='its coefficients; none: rectified')
    width: int | None = Field(None, ge=1, le=100_000, description='of its pictures [px]')
    height: int | None = Field(None, ge=1, le=100_000, description='of its pictures [px]')

    @model_validator(mode='before')
    @classmethod
    def _by_own_keys(cls, values: Any) -> Any:
        return camera_entry(values) if is_camera_info(values) else values

    def lens_of(self, width: int, height: int) -> Lens:
        """The camera with its distortion, of pictures of a size [px].

        Raises LightFieldError for impossible coefficients, and for another size than its own.
        """
        own = self.width or width, self.height or height
        if own != (width, height):
            raise LightFieldError(f'pictures have {width}x{height} px, the camera '
                                  f'{own[0]}x{own[1]}: give the calibration of this size')
        pinhole = Pinhole(width, height, self.fx, self.fy or self.fx, self.cx, self.cy)
        return Lens(pinhole, self.distortion, self.model)


class FrameEntry(Settings):
    """One picture and where its camera was."""

    file: str = Field(min_length=1, description='name of the picture')
    position: Position = Field(
        description='of the optical frame, in any fixed frame [m]')
    orientation: Quaternion = Field(description='quaternion x, y, z, w')

    @property
    def pose(self) -> NDArray[np.float64]:
        """(4, 4) of the optical frame. Raises LightFieldError for no unit quaternion."""
        return quaternion_pose(self.position, self.orientation, self.file)


class SweepFolder(SweepSettings):
    """sweep.yaml: the camera, the frames, and the `SweepSettings`."""

    camera: CameraEntry = Field(description='that took all pictures')
    frames: list[FrameEntry] = Field(min_length=2, description='in any order')
    posed: bool = Field(False, description='read as posed views, whatever the poses; false: a '
                        'grid of parallel views is a light field')

    @field_validator('frames')
    @classmethod
    def _differ(cls, frames: list[FrameEntry]) -> list[FrameEntry]:
        twice = sorted(name for name, count in Counter(
            each.file for each in frames).items() if count > 1)
        if twice:
            raise ValueError(f'{", ".join(twice)} is there more than once')
        return frames


def has_grid(yaml: Path) -> bool:
    """Whether a sweep.yaml is read as a light field; else its pictures are posed views.

    Raises as `read_sweep`.
    """
    of = SweepFolder.load(yaml)
    if of.posed:
        return False
    with told_as(LightFieldError, name=yaml):
        size = picture_size(yaml.parent / of.frames[0].file)
        return is_grid([each.pose for each in of.frames], of.camera.lens_of(*size).pinhole, of)


def read_sweep(yaml: Path, header: Header, reduction: Reduction) -> LightField:
    """The light field of a sweep's pictures, which lie beside its sweep.yaml.

    A warning names frames that are left out. Raises SettingsError or LightFieldError saying
    which file or value is wrong.
    """
    of = SweepFolder.load(yaml)
    if reduction.every != 1:
        raise LightFieldError(f'{yaml}: its frames are no grid of which each {reduction.every}th '
                              'could be taken; write other rows, columns and baseline')
    values = of.model_dump(include=set(SweepSettings.model_fields))
    settings = SweepSettings.make(values | {'shrink': of.shrink * reduction.shrink}, str(yaml))
    with told_as(LightFieldError, name=yaml):
        frames = [_frame(yaml.parent, of.frames[0], of)]
        warn_distorted(of.frames[0].file, frames[0].lens)
        size = len(of.frames) * frames[0].image.nbytes
        if size > _MOST_BYTES:
            raise LightFieldError(
                f'its {len(of.frames)} pictures of {frames[0].lens.pinhole.width}x'
                f'{frames[0].lens.pinhole.height} px need {size / 2 ** 30:.1f} GiB, at most '
                f'{_MOST_BYTES / 2 ** 30:.0f}: list fewer, or make the files smaller')
        frames += [_frame(yaml.parent, each, of) for each in of.frames[1:]]
        sweep = assemble(frames, settings, header.frame_id)
    if sweep.left_out:
        _LOG.warning('%s: %s', yaml, sweep.describe())
    found = sweep.light_field
    return LightField(header, found.views, found.grid, found.gamma)


def _frame(folder: Path, entry: FrameEntry, of: SweepFolder) -> SweepFrame:
    picture = read_picture(folder / entry.file, of.bits)
    height, width = picture.shape[:2]
    return SweepFrame(entry.file, 0, np.ascontiguousarray(picture),
                      of.camera.lens_of(width, height), entry.pose)
