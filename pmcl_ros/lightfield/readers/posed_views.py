"""Pictures of ordinary cameras with known poses: `views.yaml`."""

import logging
import math
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.masks import mask_of_view, read_mask
from pmcl_ros.lightfield.pose_entry import Matrix
from pmcl_ros.lightfield.posed_view import GAMMA, LEAST_SIDE, PosedView, centre_view, encoded
from pmcl_ros.lightfield.readers.npz import read_npz
from pmcl_ros.lightfield.readers.pictures import (
    MOST_BYTES,
    Bits,
    Reduction,
    picture_size,
    read_picture,
)
from pmcl_ros.lightfield.readers.sweep_folder import CameraEntry, SweepFolder
from pmcl_ros.lightfield.sweep.frame import Lens, warn_distorted
from pmcl_ros.runtime.errors import LightFieldError, told_as
from pmcl_ros.runtime.settings import Settings

NAME = 'views.yaml'
_LOG = logging.getLogger(__name__)
_NPZ, _SWEEP = '.npz', 'sweep'
_MOST_PIXELS = 2 ** 25  # of a picture
_FAR_OFF = 0.2  # of the side: no lens has its principal point there, but a cropped picture may
_EXCHANGED = 0.1  # of the side: from here on, if exchanging cx and cy halves it


class ViewCamera(CameraEntry):
    """A camera and the size of its pictures."""

    width: int = Field(ge=1, le=100_000, description='of its pictures [px]')
    height: int = Field(ge=1, le=100_000, description='of its pictures [px]')
    gamma: float = Field(GAMMA, gt=0, le=10, description="exponent that makes the files' values "
                         'linear light; 1: they are')

    @property
    def pinhole(self) -> Pinhole:
        """The camera without its distortion."""
        return Pinhole(self.width, self.height, self.fx, self.fy or self.fx, self.cx, self.cy)

    @property
    def lens(self) -> Lens:
        """The camera with its distortion. Raises LightFieldError for impossible coefficients."""
        return self.lens_of(self.width, self.height)


class MaskedCamera(ViewCamera):
    """A camera, and where its pictures do not show the scene."""

    mask: str = Field('', description='picture of its size, relative to views.yaml: black where '
                      'all pictures show what moves with the camera, as a gripper, or burnt-in '
                      'text, which is no evidence')


class ViewEntry(Settings):
    """One picture and the pose of its camera."""

    file: str = Field(min_length=1, description='name of the picture, relative to views.yaml; or '
                      'of a light field, .npz of pmcl decode, of which the centre view is meant')
    camera: str = Field('', description='name of its camera; a light field (.npz) has its own')
    camera_to_reference: Matrix = Field(
        (1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.),
        description='pose of its optical frame, 4x4, row by row [m], or as ROS prints a Pose; may '
        'be left out of a single view')
    mount_to_base: Matrix | None = Field(
        None, description='for pmcl handeye, in place of camera_to_reference: pose of the '
        "arm's link that carries camera or board, 4x4, row by row [m], or as ROS prints a Pose")
    sigma_mm: float = Field(0.0, ge=0, le=1e4, description='standard deviation of the position on '
                            'each axis [mm]')
    sigma_deg: float = Field(0.0, ge=0, le=180, description='standard deviation of the rotation '
                             'about each axis [deg]')
    stamp: float | None = Field(None, ge=0, le=9e9, description='time of the exposure since 1970 '
                                "[s]; default: the file's modification time")
    mask: str = Field('', description='picture of its size, relative to views.yaml: black where '
                      'this picture does not show the scene, beside what the mask of its camera '
                      'leaves out')
    group: str = Field('', description='name of the views that share errors of their poses, as '
                       'those of one hand-eye transform')
    common: float = Field(1.0, ge=0, le=1, description='share of the variance of these errors '
                          'that the group shares; the rest is of each view')

    @property
    def is_light_field(self) -> bool:
        """Whether the file is a light field, with a camera of its own."""
        return self.file.lower().endswith(_NPZ)


class ViewsFile(Settings):
    """views.yaml: cameras, views, and the frame of their poses."""

    cameras: dict[str, MaskedCamera] = Field({}, description='by name')
    views: list[ViewEntry] = Field(description='in any order')
    reference: str = Field('camera', min_length=1, description='name of the frame of the poses')
    bits: Bits = 16

    @property
    def posed(self) -> bool:
        """Whether the poses of the cameras are given."""
        return 'camera_to_reference' in self.views[0].model_fields_set

    @field_validator('views')
    @classmethod
    def _some(cls, views: list[ViewEntry]) -> list[ViewEntry]:
        if not views:
            raise ValueError('there is no view; at least one is needed')
        return views

    @model_validator(mode='after')
    def _whole(self) -> 'ViewsFile':
        of_arm = any(each.mount_to_base is not None for each in self.views)
        for each in self.views:
            if each.is_light_field == bool(each.camera):
                raise ValueError(f'{each.file}: a picture needs a camera, and a light field '
                                 f'({_NPZ}) has its own')
            if each.is_light_field and each.mask:
                raise ValueError(f'{each.file}: a light field ({_NPZ}) takes no mask')
            if each.camera and each.camera not in self.cameras:
                raise ValueError(f'{each.file} is of the camera {each.camera!r}, cameras has '
                                 f'{", ".join(self.cameras) or "none"}')
            if ('camera_to_reference' in each.model_fields_set) != self.posed and len(
                    self.views) > 1 and (self.posed and each.mount_to_base is not None):
                raise ValueError(f'{each.file} and {self.views[0].file}: either all views have '
                                 'camera_to_reference, or none')
            if (len(self.views) > 1 and 'camera_to_reference' not in each.model_fields_set
                    and each.mount_to_base is None and (self.posed or not of_arm)):
                raise ValueError(f'{each.file} has no camera_to_reference; of several views each '
                                 'needs one, or mount_to_base for pmcl handeye')
        files = [os.path.normpath(each.file) for each in self.views]
        repeated = sorted(each for each, times in Counter(files).items() if times > 1)
        if repeated:
            raise ValueError(f'{", ".join(repeated)} is there more than once')
        return self


def views_of(of: ViewsFile, folder: Path, name: str, reduction: Reduction
             ) -> tuple[PosedView, ...]:
    """The views that a file lists, without distortion.

    folder: that their files are relative to. name: of the list, for errors. Pictures are PNG,
    JPEG, TIFF, ... of 8 or 16 bits or floating point, colour or grey.
    Warnings tell of a principal point far from the middle, of a distortion that folds the picture
    or leaves little of it, and of one pose of all views. Raises
    SettingsError or LightFieldError saying which file or value is wrong.
    """
    of = of.model_copy(update={'views': [of.views[each] for each in
                                         reduction.kept(len(of.views))]})
    shrink = reduction.shrink
    cameras = [of.cameras[each.camera] for each in of.views if each.camera]
    pixels = [(each.width // shrink) * (each.height // shrink) for each in cameras] or [0]
    size = 12 * sum(pixels)
    excess = max(size / MOST_BYTES, max(pixels) / _MOST_PIXELS)
    if excess > 1:
        raise LightFieldError(
            f'{name}: its {len(of.views)} pictures have up to {max(pixels) / 1e6:.1f} million '
            f'pixels, at most {_MOST_PIXELS / 1e6:.1f} are read, and need {size / 2 ** 20:.0f} '
            f'MiB, at most {MOST_BYTES // 2 ** 20}: shrink them (--shrink '
            f'{math.ceil(shrink * math.sqrt(excess))})' + (
                ', or take fewer (--every)' * (len(pixels) > 1)))
    names = dict.fromkeys(each.camera for each in of.views if each.camera)
    odd = {name: why for name in names if (why := _oddness(of.cameras[name].pinhole))}
    if odd:
        camera, why = next(iter(odd.items()))
        _warn_odd(camera, of.cameras[camera].pinhole, why, len(odd) - 1)
    for camera in names:
        warn_distorted(camera, of.cameras[camera].lens)
    masks = {camera: _mask(folder / of.cameras[camera].mask, of.cameras[camera], reduction)
             for camera in names if of.cameras[camera].mask}
    views = tuple(replace(_view(folder, each, of, reduction),
                          mask=_own_mask(folder, each, of, reduction, masks.get(each.camera)))
                  for each in of.views)
    _check_no_copies(of, views, name)
    first, *others = views
    if others and of.posed and all(
            np.array_equal(each.camera_to_reference, first.camera_to_reference)
            for each in others):
        _LOG.warning('%s: all %d views have the same pose, and different pictures: does each have '
                     'its own camera_to_reference?', name, len(views))
    return views


def _oddness(pinhole: Pinhole) -> str:
    """The question for what is wrong with a principal point; empty where it is a lens's."""
    off = pinhole.off_middle
    if off > _EXCHANGED and replace(pinhole, cx=pinhole.cy, cy=pinhole.cx).off_middle < off / 2:
        return 'are cx and cy exchanged?'
    return 'is the calibration of another resolution?' if off > _FAR_OFF else ''


@cache  # captures of one camera are many
def _warn_odd(camera: str, pinhole: Pinhole, why: str, others: int) -> None:
    _LOG.warning('camera %r%s: the principal point (%g, %g) is far from the middle of %dx%d: %s',
                 camera, f' and {others} more' if others else '', pinhole.cx, pinhole.cy,
                 pinhole.width, pinhole.height, why)


def _check_no_copies(of: ViewsFile, views: Sequence[PosedView], name: str) -> None:
    """Raise LightFieldError for two equal pictures of one pose: noise would count as less."""
    known: dict[bytes, list[int]] = {}
    for number, each in enumerate(views):
        # Adding 0 makes -0 the same as 0.
        alike = known.setdefault((each.camera_to_reference + 0.0).tobytes(), [])
        for other in alike:
            if np.array_equal(views[other].picture, each.picture):
                raise LightFieldError(f'{name}: {of.views[other].file} and '
                                      f'{of.views[number].file} are one picture with one pose; '
                                      'leave one of them out')
        alike.append(number)


def views_of_sweep(yaml: Path, reduction: Reduction) -> tuple[PosedView, ...]:
    """The pictures of a sweep.yaml, whose cameras may look from anywhere; raises as `views_of`.

    The reference frame, `sweep`, is the fixed frame of its poses.
    """
    of = SweepFolder.load(yaml)
    with told_as(LightFieldError, name=yaml):
        width, height = picture_size(yaml.parent / of.frames[0].file)
        views = [{'file': each.file, 'camera': _SWEEP,
                  'camera_to_reference': each.pose.ravel().tolist()} for each in of.frames]
    camera = {'width': width, 'height': height, 'gamma': of.gamma} | of.camera.model_dump(
        exclude_none=True)
    found = ViewsFile.make({'cameras': {_SWEEP: camera}, 'views': views, 'reference': _SWEEP,
                            'bits': of.bits}, str(yaml))
    return views_of(found, yaml.parent, str(yaml),
                    Reduction(reduction.every, of.shrink * reduction.shrink))


def _view(folder: Path, entry: ViewEntry, of: ViewsFile, reduction: Reduction) -> PosedView:
    path = folder / entry.file
    seen = (centre_view(read_npz(path, Header(), reduction)) if entry.is_light_field
            else _picture(path, entry.camera, of.cameras[entry.camera], of.bits, reduction))
    with told_as(LightFieldError, name=path):
        stamp_ns = (path.stat().st_mtime_ns if entry.stamp is None
                    else round(1e9 * entry.stamp))
        return replace(
            seen, header=Header(stamp_ns, of.reference),
            camera_to_reference=np.array(entry.camera_to_reference).reshape(4, 4),
            sigma=(1e-3 * entry.sigma_mm, float(np.deg2rad(entry.sigma_deg))),
            group=entry.group, common=entry.common, name=entry.file)


def _another_size(camera: ViewCamera, width: int, height: int) -> str:
    """What to do with a picture of another size than its camera's."""
    if (height, width) == (camera.width, camera.height):
        return ('the camera was calibrated with turned pictures; these are read as they are '
                'stored, whatever EXIF orientation they have: turn the files')
    if width * camera.height != height * camera.width:
        return 'give the calibration of this size'
    fit = camera.pinhole.resized(width, height)
    return (f'if the whole picture was resized, its calibration is fx {fit.fx:g}, fy {fit.fy:g}, '
            f'cx {fit.cx:g}, cy {fit.cy:g}')


def _mask(path: Path, camera: ViewCamera, reduction: Reduction) -> NDArray[np.bool_]:
    """(height, width) where a file is not black, as `_picture` shows it."""
    return mask_of_view(read_mask(path), camera.lens, camera.pinhole, reduction, str(path))


def _own_mask(folder: Path, entry: ViewEntry, of: ViewsFile, reduction: Reduction,
              of_camera: NDArray[np.bool_] | None) -> NDArray[np.bool_] | None:
    """The mask of a picture: what neither its own nor that of its camera leaves out."""
    if not entry.mask:
        return of_camera
    path = folder / entry.mask
    own = _mask(path, of.cameras[entry.camera], reduction)
    if of_camera is None:
        return own
    if not (both := own & of_camera).any():
        raise LightFieldError(f'{path}: this mask and that of the camera {entry.camera!r} '
                              f'together leave nothing of {entry.file}')
    return both


def _picture(path: Path, name: str, camera: ViewCamera, bits: int, reduction: Reduction
             ) -> PosedView:
    """What a camera's file shows, without distortion, in the frame of the camera."""
    values = read_picture(path, bits)
    height, width = values.shape[:2]
    with told_as(LightFieldError, name=path):
        if (width, height) != (camera.width, camera.height):
            raise LightFieldError(
                f'it has {width}x{height} px, its camera {name!r} {camera.width}x{camera.height}: '
                + _another_size(camera, width, height))
        if min(width, height) // reduction.shrink < LEAST_SIDE:
            raise LightFieldError(f'it has {width}x{height} px' + (
                f', shrunk by {reduction.shrink}' if reduction.shrink > 1 else '')
                + f'; {LEAST_SIDE} a side are needed')
        reduction.check_memory(1, 1, height, width)
        picture = camera.lens.undistorted(encoded(values, camera.gamma), camera.pinhole)
        return PosedView(Header(), reduction.shrunk(picture), reduction.pinhole(camera.pinhole))
