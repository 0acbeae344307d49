"""COLMAP's models as posed views: cameras.txt and images.txt, or cameras.bin and images.bin.

Formats: colmap.github.io/format.html. A model has no metric scale, and names no masks.
"""

import itertools
import logging
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.posed_view import quaternion_pose
from pmcl_ros.lightfield.readers.metric import Metric
from pmcl_ros.lightfield.readers.posed_views import ViewsFile
from pmcl_ros.runtime.binary_file import read_bytes
from pmcl_ros.runtime.errors import LightFieldError

_LOG = logging.getLogger(__name__)
_FRAME = 'colmap'  # of the poses of a model
_CAMERAS, _IMAGES = 'cameras', 'images'
_ENDINGS = '.txt', '.bin'  # of a model as text, which comes first, or in binary form
_PLACES = ('', 'sparse/0', 'sparse')  # of a model in the folder of a project
_PNG = '.png'
_MOST_BYTES = 2 ** 28  # of images, which list all points too
# Parameters of a model: of the camera matrix, then the distortion in OpenCV's order. Binary forms
# have the number of a model: from 0 on, in the order of `_NUMBERED`.
_MODELS = {
    'SIMPLE_PINHOLE': ('f cx cy', ''), 'PINHOLE': ('fx fy cx cy', ''),
    'SIMPLE_RADIAL': ('f cx cy', 'k1'), 'RADIAL': ('f cx cy', 'k1 k2'),
    'OPENCV': ('fx fy cx cy', 'k1 k2 p1 p2'),
    'FULL_OPENCV': ('fx fy cx cy', 'k1 k2 p1 p2 k3 k4 k5 k6'),
    'OPENCV_FISHEYE': ('fx fy cx cy', 'k1 k2 k3 k4')}
_NUMBERED = ('SIMPLE_PINHOLE', 'PINHOLE', 'SIMPLE_RADIAL', 'RADIAL', 'OPENCV', 'OPENCV_FISHEYE',
             'FULL_OPENCV')
_CAMERA, _IMAGE = struct.Struct('<iiQQ'), struct.Struct('<i7di')
_POINT = 24  # bytes, of an image


@dataclass(frozen=True)
class _Image:
    name: str
    camera: str
    camera_to_world: NDArray[np.float64]


def model_folder(path: Path) -> Path | None:
    """Where in a folder a model lies: there, in sparse/0 or in sparse; None: nowhere."""
    return next((path / each for each in _PLACES if _files(path / each) is not None), None)


def _files(folder: Path) -> tuple[Path, Path] | None:
    """Cameras and images of the model that lies there; None: there is none."""
    both = ((folder / f'{_CAMERAS}{ending}', folder / f'{_IMAGES}{ending}')
            for ending in _ENDINGS)
    return next((each for each in both if all(file.is_file() for file in each)), None)


def load(path: Path, metric: Metric | None, masks: Path | None = None) -> tuple[ViewsFile, Path]:
    """The views of a model, and the folder that their files are relative to.

    path: of the project, or of the model in it. masks: the folder of COLMAP's mask_path, or the
    picture of its camera_mask_path. The reference frame, `colmap`, is that of the
    model, in metres. Raises LightFieldError saying what is wrong, and without a metric scale.
    """
    folder = model_folder(path)
    files = None if folder is None else _files(folder)
    if folder is None or files is None:
        raise LightFieldError(f'{path} has no {_CAMERAS}.txt and {_IMAGES}.txt, nor .bin')
    cameras = dict(_cameras(files[0]))
    images = list(_images(files[1]))
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
    """Numbered lines that are no comments, empty ones too; of a binary form those of its text."""
    if path.suffix == _ENDINGS[1]:
        yield from _lines_of_binary(path)
        return
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


def _lines_of_binary(path: Path) -> Iterator[tuple[int, str]]:
    """What the text form says, without points, numbered as cameras or images are."""
    data = read_bytes(path, _MOST_BYTES, 'is it of COLMAP?')
    records = _camera_lines if path.stem == _CAMERAS else _image_lines
    number = 0
    try:
        count, = struct.unpack_from('<Q', data)
        for number, line in enumerate(itertools.islice(records(data), count), 1):
            yield number, line
            if records is _image_lines:
                yield number, ''  # of its points
    except (struct.error, ValueError, OverflowError) as error:
        raise LightFieldError(f'{path} is damaged, or of another format: after {number} '
                              f'{path.stem} {error}') from None


def _camera_lines(data: bytes) -> Iterator[str]:
    at = 8
    while True:
        name, model, width, height = _CAMERA.unpack_from(data, at)
        if not 0 <= model < len(_NUMBERED):
            yield f'{name} {model}'
            return
        kind = _NUMBERED[model]
        numbers = struct.unpack_from(f'<{len(" ".join(_MODELS[kind]).split())}d', data,
                                     at + _CAMERA.size)
        at += _CAMERA.size + 8 * len(numbers)
        yield f'{name} {kind} {width} {height} {" ".join(map(repr, numbers))}'


def _image_lines(data: bytes) -> Iterator[str]:
    at = 8
    while True:
        numbers = _IMAGE.unpack_from(data, at)
        at += _IMAGE.size
        end = data.index(b'\0', at)
        points, = struct.unpack_from('<Q', data, end + 1)
        yield f'{" ".join(map(repr, numbers))} {data[at:end].decode()}'
        at = end + 9 + _POINT * points


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
