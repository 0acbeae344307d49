"""Reads captures with known truth: folders with a picture, a model.obj and a truth.json.

A model.yaml beside them gives the object's symmetries and material (`ObjectSettings`). Further
objects in the same picture have a model.obj and a truth.json in subfolders.
"""

import logging
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from pmcl_ros.camera.files import is_picture, list_pictures, read_raw_frame
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.readers.read import Source, has_pictures, has_posed_views
from pmcl_ros.messages.bags import is_bag
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.reading import Reading
from pmcl_ros.runtime.binary_file import sha256
from pmcl_ros.runtime.errors import SettingsError

_LOG = logging.getLogger(__name__)
_MOST_NAMES = 20  # in an error


@dataclass(frozen=True)
class Capture:
    """One object in one picture: a raw one, a light field, views (`read_source`), or their bag.

    folder: of the object's truth and model. source: of the picture. name: of the capture.
    pictures: the files that are localised together; empty: all of `source`. reading: how they are
    read, of all but raw pictures.
    """

    folder: Path
    truth: Truth
    source: Path
    name: str
    pictures: tuple[Path, ...] = ()
    reading: Reading = field(default_factory=Reading)

    @classmethod
    def load(cls, folder: Path, source: Path | None = None) -> 'Capture':
        """Read a folder's truth.json; SettingsError when that is impossible.

        source: the folder of the picture, if `folder` is a subfolder of it.
        """
        source = source or folder
        name = folder.relative_to(source.parent).as_posix()
        return cls(folder, Truth.load(folder / 'truth.json'), source, name)

    @property
    def model(self) -> Path:
        """The file of the object: model.yaml if there is one, else model.obj."""
        described = self.folder / 'model.yaml'
        return described if described.exists() else self.folder / 'model.obj'

    @property
    def mesh(self) -> Path:
        """The mesh of the object."""
        return self.folder / 'model.obj'

    @cached_property
    def object(self) -> str:
        """A digest of the mesh: the same for two captures of one object."""
        return sha256(self.mesh)[:16]

    @property
    def bop_numbers(self) -> tuple[int, int, int] | None:
        """The numbers of scene, picture and object in a BOP data set; None: it is of none."""
        return None

    @property
    def load_model(self) -> Callable[[Path], ObjectModel]:
        """What reads `model`."""
        return ObjectModel.load

    def shows(self, other: 'Capture') -> bool:
        """Whether the object of another capture is in this picture too."""
        return other.source == self.source

    def files(self) -> list[Path]:
        """All files, none hidden, of the capture, and of its picture where that is elsewhere."""
        return [each for folder in dict.fromkeys([self.source, self.folder])
                for each in sorted(folder.iterdir())
                if each.is_file() and not each.name.startswith('.')]

    @property
    def picture(self) -> Path | None:
        """The raw picture; None where the source is a light field or a view."""
        if not any(is_picture(path) for path in self.source.iterdir()):
            return None
        return list_pictures(self.source)[0]

    @property
    def has_pictures(self) -> bool:
        """Whether it is of pictures of ordinary cameras; a bag is not looked into."""
        return self.picture is None and has_pictures(self.source)

    @property
    def may_be_posed(self) -> bool:
        """Whether it is of posed views; or of a bag, which is not looked into."""
        return is_bag(self.source) or has_posed_views(self.source)

    def light_field(self) -> LightField:
        """The views of a light field; SettingsError for a raw or an ordinary picture."""
        read = self.read(None)
        if not isinstance(read, LightField):
            raise SettingsError(f'{self.source} is a picture of an ordinary camera; a light field '
                                'is needed here')
        return read

    def read(self, decoders: Decoders | None) -> Source:
        """The light field or the views. decoders: of the camera of a raw picture."""
        if self.picture is None:
            return self._read_bag() if is_bag(self.source) else self.reading.read(self.source)
        if decoders is None:
            raise SettingsError(f'{self.picture} is a raw picture: its calibration is needed')
        return decoders.decode(read_raw_frame(self.picture))

    def _read_bag(self) -> Source:
        found = self.reading.read_bag(self.source)
        if isinstance(found, RawFrame):
            raise SettingsError(f'{self.source} is a bag of raw pictures: pmcl bag extract makes '
                                'files of them')
        return found


def find_captures(folder: Path | str) -> list[Capture]:
    """The captures in the subfolders of a folder, sorted by name; SettingsError without any.

    A warning names folders with a truth.json that have no model.obj.
    """
    places = sorted(path.parent for depth in ('*', '*/*')
                    for path in Path(folder).glob(f'{depth}/truth.json'))
    found = {path.relative_to(folder).as_posix(): path for path in places
             if (path / 'model.obj').exists()}
    bare = _named([path.relative_to(folder).as_posix() for path in places
                   if not (path / 'model.obj').exists()])
    if not found:
        untrue = _named(sorted({each.parent.name for each in Path(folder).glob('*/model.*')}))
        raise SettingsError(
            f'{folder} has no subfolder with a picture, model.obj and truth.json, and no BOP '
            'scene with scene_gt.json; ' + (
                f'no model.obj is beside truth.json in {bare}' if bare else
                f'no truth.json is beside the model in {untrue}' if untrue else
                'pmcl scenes render and pmcl simulate make such folders'))
    if bare:
        _LOG.warning('%s: left out, as no model.obj is beside truth.json: %s', folder, bare)
    return [Capture.load(path, Path(folder) / name.partition('/')[0])
            for name, path in found.items()]


def _named(names: Sequence[str]) -> str:
    return ', '.join(names[:_MOST_NAMES]) + (', ...' if len(names) > _MOST_NAMES else '')


def select(captures: Sequence[Capture], only: Collection[str], folder: Path | str
           ) -> list[Capture]:
    """The captures of these names; empty: all. folder: of all, for the error.

    Raises SettingsError for a name that no capture has.
    """
    names = [each.name for each in captures]
    missing = sorted(set(only) - set(names))
    if missing:
        raise SettingsError(f'{folder} has no capture {", ".join(missing)}; there are '
                            f'{_named(names)}')
    return [each for each in captures if not only or each.name in only]
