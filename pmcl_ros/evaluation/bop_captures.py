"""Captures of a BOP data set: the true poses of its objects, scene_gt.json.

Format: "BOP datasets format" of github.com/thodan/bop_toolkit. Lengths are in millimetres.
"""

import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evaluation.captures import Capture
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.readers import bop
from pmcl_ros.lightfield.readers.posed_views import views_of
from pmcl_ros.lightfield.readers.read import Source
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import LightFieldError, SettingsError
from pmcl_ros.runtime.text_file import parse_json, read_text

_LOG = logging.getLogger(__name__)
_TRUTH, _VISIBLE = 'scene_gt.json', 'scene_gt_info.json'
_LEAST_VISIBLE = 0.1  # of an object's outline, as of BOP's targets
_SIDE = 0.16  # m: of the region of interest, as of generated scenes

Poses = Mapping[int, NDArray[np.float64] | None]


@dataclass(frozen=True)
class BopChoice:
    """What of a BOP data set is evaluated.

    views: pictures that are localised together, where the cameras have poses. objects: the ids of
    those looked for; empty: all. targets: a list of pictures and objects, as BOP's
    test_targets_bop19.json; None: all.
    """

    views: int = 5
    objects: tuple[int, ...] = ()
    targets: Path | None = None


@dataclass(frozen=True)
class BopCapture(Capture):
    """One object in one picture of a scene, or in several whose cameras have poses.

    folder: of the meshes. source: of the scene. object_id: of the mesh. there: the ids of all
    objects in the scene.
    """

    object_id: int = field(kw_only=True)
    there: frozenset[int] = field(kw_only=True)

    @property
    def mesh(self) -> Path:
        """The mesh, in millimetres."""
        return self.folder / f'obj_{self.object_id:06d}.ply'

    @property
    def model(self) -> Path:
        """The mesh; its symmetries lie beside it."""
        return self.mesh

    @property
    def load_model(self) -> Callable[[Path], ObjectModel]:
        """What reads the mesh, in metres, with the symmetries of models_info.json."""
        return ObjectModel.load_bop

    @property
    def picture(self) -> None:
        """There is no raw picture."""
        return

    @property
    def bop_numbers(self) -> tuple[int, int, int]:
        """The numbers of the scene, the first picture and the object."""
        return _number(self.source), int(self.pictures[0].stem), self.object_id

    @property
    def may_be_posed(self) -> bool:
        """Whether it is of several pictures."""
        return len(self.pictures) > 1

    def shows(self, other: Capture) -> bool:
        """Whether the object of another capture is in the scene."""
        return isinstance(other, BopCapture) and other.object_id in self.there

    def read(self, decoders: Decoders | None) -> Source:  # noqa: ARG002
        """The picture, or the views."""
        if len(self.pictures) == 1:
            return self.reading.read(self.pictures[0])
        of, folder = bop.load(self.source, numbers={int(each.stem) for each in self.pictures})
        views = PosedViews(views_of(of, folder, str(self.source), self.reading.reduction))
        return self.reading.stated(views, self.source)

    def files(self) -> list[Path]:
        """The pictures, the mesh, and what is known of them."""
        said = (self.source / each for each in (bop.NAME, _TRUTH, _VISIBLE))
        return [*(each for each in said if each.is_file()), *self.pictures, self.mesh]


def bop_scenes(folder: Path) -> list[Path]:
    """The scenes with known truth in a folder, or the folder itself; empty: there are none.

    Raises LightFieldError for the folder of a data set, which has folders of scenes.
    """
    bop.check_no_root(folder)
    folder = folder.resolve() if folder.name in ('', '..') else folder  # its name is its number
    return [each for each in (folder, *sorted(folder.iterdir()))
            if (each / bop.NAME).is_file() and (each / _TRUTH).is_file()]


def bop_captures(scenes: list[Path], choice: BopChoice) -> list[BopCapture]:
    """The objects in pictures of scenes: a capture for each object and each group of pictures.

    Where all cameras of a scene have poses, a group is of `choice.views` pictures, spread over it;
    else, and with one view, of one picture, in its camera's frame; a warning tells of a scene of
    which only some have poses. Objects of which less than a
    tenth is visible are left out. Of a group the objects of its first picture are looked for: a
    warning tells how many targets of other pictures are not. Raises LightFieldError or
    SettingsError.
    """
    targets = None if choice.targets is None else _read_targets(choice.targets)
    missed: list[int] = []
    found = [capture for scene in scenes
             for capture in _captures_in(scene, choice, targets, missed)]
    if missed:
        _LOG.warning('targets that are not looked for, as the first picture of their group does '
                     'not have them: %d; --views 1 takes all', len(missed))
    return found


def _captures_in(scene: Path, choice: BopChoice, targets: set[tuple[int, int, int]] | None,
                 missed: list[int]) -> Iterator[BopCapture]:
    """missed: takes the objects that are targets in the other pictures of a group alone."""
    cameras, truths = bop.camera_poses(scene), _entries(scene / _TRUTH)
    visible = _entries(scene / _VISIBLE) if (scene / _VISIBLE).is_file() else {}
    without = [number for number, each in cameras.items() if each is None]
    together = choice.views > 1 and len(cameras) > 1
    posed = together and not without
    if together and 0 < len(without) < len(cameras):
        _tell_unposed(scene / bop.NAME, without[0], len(without), len(cameras))
    listed = None if targets is None else {
        picture for of, picture, _ in targets if of == _number(scene)}
    there = frozenset(_object_id(entry, f'{scene / _TRUTH}: picture {number}')
                      for number, each in truths.items() for entry in each)
    numbers = sorted(cameras if listed is None else listed & cameras.keys())
    for group in _groups(numbers, choice.views if posed else 1):
        first = group[0]
        if targets is not None:
            missed += [each for each in _unseen(group, targets, _number(scene))
                       if not choice.objects or each in choice.objects]
        copies: dict[int, int] = {}
        for entry in truths.get(first, ()):
            where = f'{scene / _TRUTH}: picture {first}'
            number = _object_id(entry, where)
            copy = copies[number] = copies.get(number, -1) + 1
            if choice.objects and number not in choice.objects:
                continue
            if targets is not None and (_number(scene), first, number) not in targets:
                continue
            if np.mean([_visible(truths, visible, each, number, copy)
                        for each in group]) < _LEAST_VISIBLE:
                continue
            pose = bop.rigid(entry.get('cam_R_m2c'), entry.get('cam_t_m2c'),
                             f'{where}: cam_R_m2c and cam_t_m2c')
            to_world = cameras[first] if posed and len(group) > 1 else None
            pose = pose if to_world is None else to_world @ pose
            name = f'{scene.name}/{first:06d}/obj_{number:06d}' + (f'_{copy}' if copy else '')
            center, size = _region(pose, (first, number, copy))
            yield BopCapture(bop.model_of(scene, number).parent,
                             Truth(pose, center, size, False, name=name), scene, name,
                             pictures=tuple(bop.picture_of(scene, each) for each in group),
                             object_id=number, there=there)


@cache  # wrong objects are found by a second look
def _tell_unposed(path: Path, first: int, count: int, total: int) -> None:
    _LOG.warning('%s: %d of %d pictures have no pose of their camera, as %06d: each picture '
                 'is localised alone; take those out to localise the others together', path,
                 count, total, first)


def _number(scene: Path) -> int:
    """The number of a scene; 0 where its folder is named otherwise."""
    return int(scene.name) if scene.name.isdecimal() else 0


def _unseen(group: list[int], targets: set[tuple[int, int, int]], scene: int) -> set[int]:
    """The objects that are targets in a group's other pictures alone."""
    first, *others = ({number for of, picture, number in targets if (of, picture) == (scene, each)}
                      for each in group)
    return set[int]().union(*others) - first


def _groups(numbers: list[int], views: int) -> Iterator[list[int]]:
    """Groups of so many pictures, or of all where there are fewer, each spread over all."""
    count = max(1, len(numbers) // views)
    for first in range(min(count, len(numbers))):
        yield numbers[first::count][:views]


def _region(pose: NDArray[np.float64], seed: tuple[int, ...]
            ) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Centre and size of a region of interest about the object, up to a fifth of it off."""
    off = np.random.default_rng(seed).uniform(-0.2, 0.2, 3) * _SIDE
    x, y, z = (float(each) for each in pose[:3, 3] + off)
    return (x, y, z), (_SIDE,) * 3


def _object_id(entry: Mapping[str, Any], where: str) -> int:
    number = entry.get('obj_id')
    if not isinstance(number, int) or number < 0:
        raise LightFieldError(f'{where}: obj_id {number!r} is no number of an object')
    return number


def _visible(truths: Mapping[int, list[dict[str, Any]]],
             visible: Mapping[int, list[dict[str, Any]]], picture: int, number: int, copy: int
             ) -> float:
    """The visible part of a copy of an object in a picture; 1 where it is not said.

    0 where the picture's truth does not list it. Each picture has an order of its own.
    """
    if picture not in truths:
        return 1.0
    places = [place for place, entry in enumerate(truths[picture]) if entry['obj_id'] == number]
    if copy >= len(places):
        return 0.0
    of, place = visible.get(picture, []), places[copy]
    value = of[place].get('visib_fract', 1.0) if place < len(of) else 1.0
    return float(value) if isinstance(value, int | float) else 1.0


def _entries(path: Path) -> dict[int, list[dict[str, Any]]]:
    """By the number of each picture what is said of its objects."""
    values = bop.by_number(path)
    if not all(isinstance(each, list) and all(isinstance(entry, dict) for entry in each)
               for each in values.values()):
        raise LightFieldError(f'{path}: expected numbers of pictures, each with a list of objects')
    return values


def _read_targets(path: Path) -> set[tuple[int, int, int]]:
    """The numbers of scenes, pictures and objects."""
    values = parse_json(read_text(path), str(path))
    try:
        return {(int(each['scene_id']), int(each['im_id']), int(each['obj_id']))
                for each in values}
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise SettingsError(f'{path}: expected a list of scene_id, im_id and obj_id, as '
                            f'test_targets_bop19.json: {error!r}') from None
