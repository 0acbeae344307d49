"""transforms.json as posed views: pictures of phones, of Blender, of NeRF and splatting tools.

Format: docs.nerf.studio/quickstart/data_conventions.html. Camera axes are those of OpenGL, x
right, y up, z backward; the middle of the first pixel is (0.5, 0.5).
"""

import logging
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator

from pmcl_ros.lightfield.readers.metric import Metric
from pmcl_ros.lightfield.readers.pictures import picture_size
from pmcl_ros.lightfield.readers.posed_views import ViewsFile
from pmcl_ros.runtime.errors import LightFieldError
from pmcl_ros.runtime.settings import Settings
from pmcl_ros.runtime.text_file import read_json

NAME, SUFFIX = 'transforms.json', '.json'
_LOG = logging.getLogger(__name__)
_FRAME = 'transforms'  # of the poses
_PNG = '.png'  # of names without an ending, as Blender's
_PERSPECTIVE, _FISHEYE = ('OPENCV', 'PINHOLE', 'SIMPLE_PINHOLE', 'PERSPECTIVE'), 'OPENCV_FISHEYE'
_TO_OPENCV = np.array([1.0, -1.0, -1.0, 1.0])  # of the axes of a camera
# Written by nerfstudio of COLMAP and by instant-ngp, whose poses have no metric scale.
_NOT_METRIC = {'colmap_im_id', 'sharpness', 'aabb_scale'}
_Length = Annotated[float | None, Field(gt=0)]
_Angle = Annotated[float | None, Field(gt=0, lt=math.pi)]
_Side = Annotated[int | None, Field(ge=1, le=100_000)]
_Row = Annotated[list[float], Field(min_length=4, max_length=4)]


class _Frame(Settings):
    """A picture, its camera and the camera's pose; other fields do not matter."""

    model_config = ConfigDict(extra='ignore')

    file_path: str = Field(min_length=1)
    transform_matrix: list[_Row] = Field(min_length=3, max_length=4)
    mask_path: str | None = None
    camera_model: str = _PERSPECTIVE[0]
    is_fisheye: bool = False  # of instant-ngp, which has no camera_model
    fl_x: _Length = None
    fl_y: _Length = None
    camera_angle_x: _Angle = None
    camera_angle_y: _Angle = None
    cx: float | None = None
    cy: float | None = None
    w: _Side = None
    h: _Side = None
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    @model_validator(mode='after')
    def _known(self) -> '_Frame':
        if self.fl_x is None and self.camera_angle_x is None:
            raise ValueError('neither fl_x nor camera_angle_x tells the focal length')
        if self.camera_model not in (*_PERSPECTIVE, _FISHEYE):
            raise ValueError(f'the camera_model {self.camera_model} is not known, only '
                             f'{", ".join(_PERSPECTIVE)} and {_FISHEYE}; undistort the pictures')
        if not self._fisheye and self.k4:
            raise ValueError(f'{self.camera_model} has k1, k2, k3, p1 and p2, no k4 '
                             f'({self.k4:g}); undistort the pictures')
        return self

    @property
    def _fisheye(self) -> bool:
        return self.is_fisheye or self.camera_model == _FISHEYE

    @property
    def pose(self) -> NDArray[np.float64]:
        """(4, 4) camera to the frame of the file, with the axes of OpenCV."""
        return np.array([*self.transform_matrix[:3], [0.0, 0.0, 0.0, 1.0]]) * _TO_OPENCV

    @property
    def distortion(self) -> tuple[str, tuple[float, ...]]:
        """Model and coefficients of views.yaml."""
        if self._fisheye:
            return 'equidistant', (self.k1, self.k2, self.k3, self.k4)
        return 'plumb_bob', (self.k1, self.k2, self.p1, self.p2, self.k3)

    def camera(self, folder: Path) -> dict[str, Any]:
        """A camera of views.yaml; folder: of the pictures. Raises LightFieldError."""
        width, height = ((self.w, self.h) if self.w and self.h
                         else picture_size(folder / self.file))
        fx = self.fl_x or _focal_length(width, self.camera_angle_x)
        fy = self.fl_y or _focal_length(height, self.camera_angle_y) or fx
        model, numbers = self.distortion
        return {'width': width, 'height': height, 'fx': fx, 'fy': fy,
                'cx': (width / 2 if self.cx is None else self.cx) - 0.5,
                'cy': (height / 2 if self.cy is None else self.cy) - 0.5, 'model': model,
                **({'distortion': numbers} if any(numbers) else {})}

    @property
    def file(self) -> str:
        """Name of the picture, relative to that of the file."""
        path = os.path.normpath(self.file_path)
        return path if os.path.splitext(path)[1] else path + _PNG


def load(path: Path, metric: Metric | None) -> tuple[ViewsFile, Path]:
    """The views of a file, and the folder that their files are relative to.

    The reference frame, `transforms`, is that of the file, in metres. Poses count as metric but
    for those of COLMAP and instant-ngp. Raises LightFieldError or SettingsError saying what is
    wrong, and for these without a metric scale.
    """
    data, folder = read_json(path), path.parent
    listed = data.get('frames')
    if not isinstance(listed, list) or not all(isinstance(each, dict) for each in listed):
        raise LightFieldError(f'{path} has no frames, a list of pictures with their poses; is it '
                              f'a {NAME}?')
    # Any may be of all pictures, or of one. A field of null is one that is not there.
    shared = {name: data[name] for name in _Frame.model_fields if data.get(name) is not None}
    frames = [_Frame.make(shared | {name: value for name, value in each.items()
                                    if value is not None}, f'{path}: frame {number}')
              for number, each in enumerate(listed)]
    scale = _scale(frames, metric, path, any(
        each.keys() & _NOT_METRIC for each in (data, *listed)))
    names: dict[str, str] = {}  # of cameras, which are mostly one
    cameras, views = {}, []
    for frame in frames:
        camera = frame.camera(folder)
        name = names.setdefault(repr(camera), str(len(names)))
        cameras[name] = camera
        pose = frame.pose
        pose[:3, 3] *= scale
        views.append({'file': frame.file, 'camera': name, 'mask': frame.mask_path or '',
                      'camera_to_reference': pose.ravel().tolist()})
    return ViewsFile.make({'cameras': cameras, 'views': views, 'reference': _FRAME},
                          str(path)), folder


def _focal_length(side: int, angle: float | None) -> float | None:
    """Of a camera that sees an angle [rad] along a side [px]; None where it is not known."""
    return None if angle is None else side / (2 * math.tan(angle / 2))


def _scale(frames: Sequence[_Frame], metric: Metric | None, path: Path, needed: bool) -> float:
    """Metres a unit; needed: poses have no metric scale of their own."""
    metric = metric or Metric()
    if not needed and not metric.is_given:
        _LOG.info('%s: its poses count as metres', path)
        return 1.0
    return metric.metres_per_unit({each.file: each.pose[:3, 3] for each in frames},
                                  f'{path}, of COLMAP or instant-ngp,' if needed else str(path))
