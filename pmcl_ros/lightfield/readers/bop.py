"""Scenes of the BOP benchmark as posed views: scene_camera.json.

Format: "BOP datasets format" of github.com/thodan/bop_toolkit. Lengths are in millimetres.
"""

import logging
import re
from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import inverse, pose_of
from pmcl_ros.lightfield.posed_view import check_pose
from pmcl_ros.lightfield.readers.posed_views import ViewsFile
from pmcl_ros.runtime.errors import FileError, LightFieldError, PictureError, told_as
from pmcl_ros.runtime.picture_file import read_picture_size
from pmcl_ros.runtime.text_file import read_json

NAME = 'scene_camera.json'
_LOG = logging.getLogger(__name__)
_NEAR = 1e-3  # m: views that are nearer to each other tell no depth
_FOLDERS, _ENDINGS = ('rgb', 'gray'), ('png', 'jpg', 'tif')
_POSE = 'cam_R_w2c', 'cam_t_w2c'
_MOST_NAMES = 8  # in an error
_NUMBER = re.compile(r'[0-9]{1,9}')


def load(scene: Path, picture: Path | None = None, numbers: Collection[int] | None = None
         ) -> tuple[ViewsFile, Path]:
    """The views of a scene's folder, and the folder that their files are relative to.

    The reference frame, `bop`, is the scene's world, in metres. picture: this one alone, in the
    frame of its camera. numbers: of the pictures to take; None: all. Raises LightFieldError where
    the scene has no poses of its cameras, and saying what is wrong. A warning asks for the unit
    where cameras are all at one place, nearly.
    """
    path = scene / NAME
    cameras: dict[str, Any] = {}
    views = []
    taken = {number: values for number, values in _read(path).items()
             if (picture is None or picture.stem == f'{number:06d}')
             and (numbers is None or number in numbers)}
    if picture is None:
        _check_posed(path, taken)
    for number, values in taken.items():
        file = picture or picture_of(scene, number)
        try:
            fx, skew, cx, _, fy, cy, *_ = (float(each) for each in values['cam_K'])
        except (KeyError, TypeError, ValueError, OverflowError):
            raise _incomplete(path, number) from None
        if skew != 0:
            raise LightFieldError(f'{path}: picture {number} has skew {skew:g} in cam_K; expected '
                                  'a camera without')
        with told_as(LightFieldError, PictureError):
            width, height = read_picture_size(file)
        cameras[str(number)] = {'width': width, 'height': height, 'fx': fx, 'fy': fy, 'cx': cx,
                           'cy': cy}
        view: dict[str, Any] = {'file': str(file.relative_to(scene)), 'camera': str(number)}
        pose = None if picture is not None else _camera_to_world(path, number, values)
        if pose is not None:
            view['camera_to_reference'] = pose.ravel().tolist()
        views.append(view)
    if not views:
        raise LightFieldError(f'{path} lists no picture' + (f' {picture}' if picture else ''))
    if picture is None:
        _check_unit(path, [each['camera_to_reference'][3:12:4] for each in views])
    return ViewsFile.make({'cameras': cameras, 'views': views, 'reference': 'bop'},
                          str(path)), scene


def _check_unit(path: Path, places: list[list[float]]) -> None:
    """Warn where cameras' places (n, 3) [m] differ, by next to nothing."""
    apart = float(np.linalg.norm(np.ptp(places, axis=0)))
    if 0 < apart < _NEAR:
        _warn_near(path, len(places), round(1e3 * apart, 2))


@cache  # captures of one scene are many
def _warn_near(path: Path, count: int, apart: float) -> None:
    _LOG.warning('%s: its %d cameras are all within %g mm: are cam_t_w2c in millimetres?', path,
                 count, apart)


def _check_posed(path: Path, cameras: dict[int, dict[str, Any]]) -> None:
    """Raise LightFieldError where pictures have no poses of their cameras."""
    without = [number for number, values in cameras.items()
               if not any(key in values for key in _POSE)]
    if not without:
        return
    file = picture_of(path.parent, without[0])
    if len(without) == len(cameras):
        raise LightFieldError(
            f'{path} has no poses of its cameras ({", ".join(_POSE)}): each picture can only be '
            f'localised alone; give one, as {file}')
    names = ', '.join(map(str, without[:_MOST_NAMES])) + ', ...' * (len(without) > _MOST_NAMES)
    raise LightFieldError(
        f'{path}: {len(without)} of {len(cameras)} pictures have no pose of their camera '
        f'({", ".join(_POSE)}): {names}; take them out, or localise one alone, as {file}')


def camera_poses(scene: Path) -> dict[int, NDArray[np.float64] | None]:
    """By the number of each picture its camera's pose, (4, 4), camera to the scene's world [m].

    None for a picture without one. Raises LightFieldError.
    """
    path = scene / NAME
    return {number: _camera_to_world(path, number, values)
            for number, values in _read(path).items()}


def rigid(rotation: object, translation: object, where: str) -> NDArray[np.float64]:
    """The transform (4, 4) [m] of nine numbers row by row, and three in millimetres.

    Raises LightFieldError, which begins with `where`, for what is none.
    """
    try:
        turn, place = np.array(rotation, float), np.array(translation, float)
    except (TypeError, ValueError, OverflowError):
        turn = place = np.empty(0)
    if turn.size != 9 or place.size != 3:
        raise LightFieldError(f'{where}: expected 9 and 3 numbers, got {turn.size} and '
                              f'{place.size}')
    pose = pose_of(turn.reshape(3, 3), place.ravel() / 1000)
    check_pose(pose, where)
    return pose


def _camera_to_world(path: Path, number: int, values: dict[str, Any]
                     ) -> NDArray[np.float64] | None:
    given = [key for key in _POSE if key in values]
    if not given:
        return None
    if len(given) < len(_POSE):
        raise _incomplete(path, number)
    rotation, translation = _POSE
    return inverse(rigid(values[rotation], values[translation],
                         f'{path}: picture {number}: {" and ".join(_POSE)}'))


def _incomplete(path: Path, number: int) -> LightFieldError:
    return LightFieldError(f'{path}: picture {number} needs cam_K, 9 numbers, and cam_R_w2c, 9 '
                           'numbers, with cam_t_w2c, 3 numbers')


def pictures_alone(scene: Path) -> list[Path]:
    """The pictures of a scene's folder without any pose of a camera; empty: it has poses."""
    cameras = _read(scene / NAME)
    if any(key in values for values in cameras.values() for key in _POSE):
        return []
    return [picture_of(scene, number) for number in cameras]


def model_of(path: Path, object_id: int) -> Path:
    """The mesh of an object, in millimetres, in the folder `models` of a scene's data set.

    path: of a scene or of a picture of it. Raises LightFieldError where there is none.
    """
    check_no_root(path)
    scene = (path if path.is_dir() else scene_of(path) or path).absolute()
    name = f'models/obj_{object_id:06d}.ply'
    for folder in (*scene.parents,)[:3]:
        if (folder / name).is_file():
            return folder / name
    raise LightFieldError(f'no folder above {scene} has {name}, the model of object {object_id}; '
                          "copy the data set's folder models there")


def check_no_root(path: Path) -> None:
    """Raise LightFieldError, which names a scene, where a folder is the root of a data set."""
    scene = next(iter(sorted(path.glob(f'*/*/{NAME}'))), None)
    if (path / 'models').is_dir() and scene is not None:
        raise LightFieldError(f'{path} is no scene, it is the folder of a data set; give a scene, '
                              f'{scene.parent}, or to evaluate all of {scene.parent.parent}')


def scene_of(picture: Path) -> Path | None:
    """The scene whose picture a path is, rgb/000003.png or likewise; None: it is of none."""
    folder = picture.absolute().parent
    return (folder.parent if picture.suffix[1:].lower() in _ENDINGS and folder.name in _FOLDERS
            and (folder.parent / NAME).is_file() else None)


def _read(path: Path) -> dict[int, dict[str, Any]]:
    values = by_number(path)
    if not all(isinstance(each, dict) for each in values.values()):
        raise LightFieldError(f'{path}: expected numbers of pictures, each with its camera')
    return values


def by_number(path: Path) -> dict[int, Any]:
    """What a JSON file of a scene says of each picture, by its number, in ascending order.

    Raises LightFieldError.
    """
    with told_as(LightFieldError, FileError):
        values = read_json(path)
    if not all(map(_NUMBER.fullmatch, values)):
        raise LightFieldError(f'{path}: expected the numbers of pictures as its names')
    return {int(number): values[number] for number in sorted(values, key=int)}


def picture_of(scene: Path, number: int) -> Path:
    """The file of a picture of a scene; LightFieldError where there is none."""
    for folder in _FOLDERS:
        for ending in (*_ENDINGS, *(each.upper() for each in _ENDINGS)):
            path = scene / folder / f'{number:06d}.{ending}'
            if path.is_file():
                return path
    raise LightFieldError(f'{scene} has no picture {number:06d} in {" or ".join(_FOLDERS)}, as '
                          f'{" or ".join(_ENDINGS)}')
