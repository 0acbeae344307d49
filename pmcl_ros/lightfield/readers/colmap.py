"""COLMAP's text models as posed views: cameras.txt and images.txt.

Formats: colmap.github.io/format.html. A model has no metric scale, and names no masks.
"""

import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.posed_view import quaternion_pose
from pmcl_ros.lightfield.readers.metric import Metric
from pmcl_ros.lightfield.readers.posed_views import ViewsFile
from pmcl_ros.runtime.errors import LightFieldError

_LOG = logging.getLogger(__name__)
_FRAME = 'colmap'  # of the poses of a model
_CAMERAS, _IMAGES = 'cameras.txt', 'images.txt'
_PLACES = ('', 'sparse/0', 'sparse')  # of a model in the folder of a project
_PNG = '.png'
_MOST_BYTES = 2 ** 28  # of images.txt, which lists all points too
# Parameters of a model: of the camera matrix, then the distortion in OpenCV's order.
_MODELS = {
    'SIMPLE_PINHOLE': ('f cx cy', ''), 'PINHOLE': ('fx fy cx cy', ''),
    'SIMPLE_RADIAL': ('f cx cy', 'k1'), 'RADIAL': ('f cx cy', 'k1 k2'),
    'OPENCV': ('fx fy cx cy', 'k1 k2 p1 p2'),
    'FULL_OPENCV': ('fx fy cx cy', 'k1 k2 p1 p2 k3 k4 k5 k6'),
    'OPENCV_FISHEYE': ('fx fy cx cy', 'k1 k2 k3 k4')}


@dataclass(frozen=True)
class _Image:
    name: str
    camera: str
    camera_to_world: NDArray[np.float64]


def model_folder(path: Path) -> Path | None:
    """Where in a folder a text model lies: there, in sparse/0 or in sparse; None: nowhere."""
    return next((path / each for each in _PLACES
                 if (path / each / _CAMERAS).is_file() and (path / each / _IMAGES).is_file()),
                None)


def is_binary(path: Path) -> bool:
    """Whether a model in binary form lies there."""
    return any((path / each / Path(_IMAGES).with_suffix('.bin')).is_file() for each in _PLACES)


def load(path: Path, metric: Metric | None, masks: Path | None = None) -> tuple[ViewsFile, Path]:
    """The views of a model, and the folder that their files are relative to.

    path: of the project, or of the model in it. masks: the folder of COLMAP's mask_path, or the
    picture of its camera_mask_path. The reference frame, `colmap`, is that of the
    model, in metres. Raises LightFieldError saying what is wrong, and without a metric scale.
    """
    folder = model_folder(path)
    if folder is None:
        raise LightFieldError(f'{path} has no {_CAMERAS} and {_IMAGES}')
    cameras = dict(_cameras(folder / _CAMERAS))
    images = list(_images(folder / _IMAGES))
    scale = (metric or Metric()).metres_per_unit(
        {each.name: each.camera_to_world[:3, 3] for each in images},
        f'{folder}, a COLMAP model,')
    views = []
    for each in images:
        pose = each.camera_to_world.copy()
        pose[:3, 3] *= scale
        views.append({'file': each.name, 'camera': each.camera,
                      'camera_to_reference': pose.ravel().tolist()})
    if masks is not None:
        _add_masks(masks.absolute(), cameras, views)
    found = ViewsFile.make({'cameras': cameras, 'views': views, 'reference': _FRAME},
                           str(folder))
    return found, _pictures(path, folder, images)


def _add_masks(masks: Path, cameras: dict[str, dict[str, Any]], views: list[dict[str, Any]]
               ) -> None:
    """Give each picture its mask of a folder, or all cameras the mask that is a file."""
    if not masks.is_dir():
        _LOG.info('%s is the mask of all pictures', masks)
        for camera in cameras.values():
            camera['mask'] = str(masks)
        return
    for view in views:
        found, other = masks / f'{view["file"]}{_PNG}', masks / view['file']
        if other.suffix.lower() == _PNG and not os.path.isfile(found) and os.path.isfile(other):
            found = other  # COLMAP takes this too
        view['mask'] = str(found)
    _LOG.info('each of %d pictures has its mask in %s', len(views), masks)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Numbered lines that are no comments; empty ones too."""
    try:
        with path.open(encoding='utf-8-sig') as stream:
            if os.fstat(stream.fileno()).st_size > _MOST_BYTES:
                raise LightFieldError(f'{path} has more than {_MOST_BYTES // 2 ** 20} MiB: is it '
                                      'of COLMAP?')
            for number, line in enumerate(stream, 1):
                if not line.startswith('#'):
                    yield number, line.strip()
    except (OSError, UnicodeDecodeError) as error:
        raise LightFieldError(f'cannot read {path}: {error}') from None


def _cameras(path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    for number, line in _lines(path):
        if not line:
            continue
        name, model, *rest = (*line.split(), '')
        if model not in _MODELS:
            raise LightFieldError(f'{path}:{number}: the camera model {model} is not known, only '
                                  f'{", ".join(_MODELS)}; undistort the pictures with COLMAP')
        matrix, distortion = (each.split() for each in _MODELS[model])
        try:
            width, height = int(rest[0]), int(rest[1])
            given = dict(zip([*matrix, *distortion], map(float, rest[2:-1]), strict=True))
        except (ValueError, IndexError):
            raise LightFieldError(
                f'{path}:{number}: expected CAMERA_ID {model} WIDTH HEIGHT '
                f'{" ".join([*matrix, *distortion]).upper()}, not {line!r}') from None
        # The middle of the first pixel is (0.5, 0.5) there, (0, 0) here.
        values: dict[str, Any] = {
            'width': width, 'height': height, 'fx': given.get('f', given.get('fx')),
            'fy': given.get('f', given.get('fy')), 'cx': given['cx'] - 0.5,
            'cy': given['cy'] - 0.5}
        if model == 'OPENCV_FISHEYE' or any(given[each] for each in distortion):
            numbers = [given[each] for each in distortion]
            plain = model not in ('FULL_OPENCV', 'OPENCV_FISHEYE')
            values |= {'distortion': numbers + [0.0] * (4 - len(numbers)) if plain else numbers,
                       'model': {'FULL_OPENCV': 'rational_polynomial',
                                 'OPENCV_FISHEYE': 'equidistant'}.get(model, 'plumb_bob')}
        yield name, values


def _images(path: Path) -> Iterator[_Image]:
    """Every other line is an image; the others list its points."""
    points = False
    for number, line in _lines(path):
        if points:
            points = False
            words = line.split()
            if len(words) % 3 or not _are_numbers([*words[:3], *words[-3:]]):
                raise LightFieldError(f'{path}:{number}: expected the points of the image above, '
                                      f'three numbers each, or an empty line, not {line[:80]!r}')
            continue
        if not line:
            continue
        words = line.split(maxsplit=9)
        try:
            w, x, y, z, *place = map(float, words[1:8])
            camera, name = words[8], words[9]
        except (ValueError, IndexError):
            raise LightFieldError(f'{path}:{number}: expected IMAGE_ID QW QX QY QZ TX TY TZ '
                                  f'CAMERA_ID NAME, not {line[:80]!r}') from None
        world_to_camera = quaternion_pose(place, (x, y, z, w), f'{path}:{number}')
        points = True
        yield _Image(name, camera, np.asarray(np.linalg.inv(world_to_camera), float))


def _are_numbers(words: list[str]) -> bool:
    try:
        return all(np.isfinite(float(each)) for each in words)
    except ValueError:
        return False


def _pictures(path: Path, folder: Path, images: list[_Image]) -> Path:
    """The folder of the pictures."""
    tried = [path / 'images', path, folder / 'images', folder.parent / 'images',
             folder.parent.parent / 'images']
    for each in tried:
        if images and os.path.isfile(each / images[0].name):  # which takes any name
            return each
    return tried[0]
