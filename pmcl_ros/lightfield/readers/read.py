"""Path -> LightField, PosedView or PosedViews: finds the format, and calls its reader."""

import logging
from pathlib import Path

from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.lightfield.readers import (
    bop,
    colmap,
    folder,
    hci,
    posed_views,
    sweep_folder,
    transforms,
)
from pmcl_ros.lightfield.readers.metric import Metric
from pmcl_ros.lightfield.readers.npz import read_npz
from pmcl_ros.lightfield.readers.pictures import Reduction
from pmcl_ros.runtime.errors import FileError, LightFieldError, SettingsError
from pmcl_ros.runtime.text_file import read_yaml_file

Source = LightField | PosedView | PosedViews  # what an object is looked for in

_LOG = logging.getLogger(__name__)
_NPZ, _YAML = '.npz', ('.yaml', '.yml')
_KEYS = {posed_views.NAME: 'views', sweep_folder.NAME: 'frames'}  # of lists of pictures


def read_source(path: Path | str, every: int = 1, shrink: int = 1,
                metric: Metric | None = None, masks: Path | None = None) -> Source:
    """Read a light field (`read_light_field`), or pictures of ordinary cameras.

    path: as of `read_light_field`; or a views.yaml, a sweep.yaml of a camera that went around an
    object or with `posed`, a transforms.json, the folder of a COLMAP model, of a BOP scene, or a
    picture of one. A single picture whose camera has no pose is a `PosedView`: the camera is the
    reference frame. metric: of a COLMAP model or a transforms.json, else not used. masks: of a
    COLMAP model (`colmap.load`), else not used.
    Raises as `read_light_field`.
    """
    path = Path(path)
    if not has_pictures(path):
        return read_light_field(path, every, shrink)
    reduction = Reduction(every, shrink)
    if (sweep := _sweep_of_views(path)) is not None:
        posed = sweep_folder.SweepFolder.load(sweep).posed
        _LOG.log(logging.INFO if posed else logging.WARNING,
                 '%s: %s: read as posed views, whose poses are in its fixed frame', sweep,
                 'posed is true' if posed else 'the sweep is no grid')
        return PosedViews(posed_views.views_of_sweep(sweep, reduction))
    of, folder = _views_file(path, metric, masks)
    views = posed_views.views_of(of, folder, str(path), reduction)
    if not of.posed and len(views) > 1:
        raise LightFieldError(f'{path} has poses of an arm, mount_to_base, for pmcl handeye; '
                              'localising needs camera_to_reference')
    return PosedViews(views) if of.posed else views[0]


def has_posed_views(path: Path | str) -> bool:
    """Whether `read_source` makes `PosedViews` of a path.

    Raises SettingsError, LightFieldError.
    """
    path = Path(path)
    yaml = _views_yaml(path)
    if yaml is not None:
        return posed_views.ViewsFile.load(yaml).posed
    if _sweep_of_views(path) is not None or _transforms(path) is not None:
        return True
    return path.is_dir() and has_pictures(path) and not pictures_alone(path)


def pictures_alone(path: Path | str) -> list[Path]:
    """The pictures at a path that are localised one by one: of a BOP scene without camera poses.

    Each is one for `read_source`. Raises LightFieldError.
    """
    path = Path(path)
    scene = (path.is_dir() and _views_yaml(path) is None and has_pictures(path)
             and (path / bop.NAME).is_file())
    return bop.pictures_alone(path) if scene else []


def has_pictures(path: Path) -> bool:
    """Whether `read_source` reads pictures of ordinary cameras at a path."""
    if any(each is not None for each in (_views_yaml(path), _sweep_of_views(path),
                                         bop.scene_of(path), _transforms(path))):
        return True
    if not path.is_dir() or _has_grid(path):
        return False  # a light field, whatever else lies there
    return colmap.model_folder(path) is not None or (path / bop.NAME).is_file()


def is_colmap(path: Path | str) -> bool:
    """Whether `read_source` reads a COLMAP model at a path."""
    path = Path(path)
    return (path.is_dir() and _views_yaml(path) is None and not _has_grid(path)
            and not (path / bop.NAME).is_file() and colmap.model_folder(path) is not None)


def has_scale(path: Path | str) -> bool:
    """Whether `read_source` takes a metric scale of a path."""
    return is_colmap(path) or _transforms(Path(path)) is not None


def _views_file(path: Path, metric: Metric | None, masks: Path | None
                ) -> tuple[posed_views.ViewsFile, Path]:
    """The list of pictures at a path, and the folder that they are relative to."""
    yaml, scene = _views_yaml(path), bop.scene_of(path)
    if yaml is not None:
        return posed_views.ViewsFile.load(yaml), yaml.parent
    if scene is not None:
        return bop.load(scene, path.absolute())
    if (path / bop.NAME).is_file():
        return bop.load(path)
    of_tools = _transforms(path)
    return (colmap.load(path, metric, masks) if of_tools is None
            else transforms.load(of_tools, metric))


def _list_at(path: Path, name: str) -> Path | None:
    """The list of pictures of a kind, as `name` is, that a path names, if it does.

    As a file it may have another name: its key tells what it is.
    """
    yaml = path / name if path.is_dir() else path
    if yaml.suffix.lower() not in _YAML or not yaml.is_file():
        return None
    if yaml.name in (folder.NAME, *_KEYS):
        return yaml if yaml.name == name else None
    try:
        return yaml if _KEYS[name] in read_yaml_file(yaml) else None
    except FileError:
        return None


def _views_yaml(path: Path) -> Path | None:
    """The views.yaml that a path names, if it does; as a file it may have another name."""
    return _list_at(path, posed_views.NAME)


def _transforms(path: Path) -> Path | None:
    """The transforms.json that a path names; as a file it may have another name."""
    if not path.is_dir():
        return path if path.suffix.lower() == transforms.SUFFIX and path.is_file() else None
    file = path / transforms.NAME
    others = posed_views.NAME, bop.NAME
    if _has_grid(path) or colmap.model_folder(path) is not None or not file.is_file() or any(
            (path / each).is_file() for each in others):
        return None
    return file


def _sweep_of_views(path: Path) -> Path | None:
    """The sweep.yaml that a path names, where it is read as posed views."""
    yaml = _list_at(path, sweep_folder.NAME)
    if yaml is None:
        return None
    others = posed_views.NAME, folder.NAME
    if path.is_dir() and any((path / each).is_file() for each in others):
        return None
    return None if sweep_folder.has_grid(yaml) else yaml


def is_light_field(path: Path | str) -> bool:
    """Whether `read_source` reads this kind of path; raw pictures are another kind."""
    path = Path(path)
    return (path.is_dir() or path.suffix.lower() in (_NPZ, *_YAML, transforms.SUFFIX)
            or bop.scene_of(path) is not None)


def read_light_field(path: Path | str, every: int = 1, shrink: int = 1) -> LightField:
    """Read views of known geometry, rectified.

    path: an NPZ file as `pmcl decode` writes, or the folder with it (views.npz); a folder of
        pictures with light_field.yaml (or that file), see `folder.GridSettings`; one of a moved
        camera's pictures with sweep.yaml (or that file), see `sweep_folder.SweepFolder`; a scene's
        folder of the 4D Light Field Benchmark (parameters.cfg). Files may have other names.
    every, shrink: take each `every`-th view, make `shrink` x `shrink` pixels one.
    The stamp is the modification time of `path`.
    Raises LightFieldError or SettingsError saying which file is wrong, and how.
    """
    path, reduction = Path(path), Reduction(every, shrink)
    if not path.exists():
        raise LightFieldError(f'there is no {path}')
    if has_pictures(path):
        raise LightFieldError(f'{path} is of pictures of ordinary cameras, and here a light field '
                              'is needed; localize, report and evaluate take pictures')
    header = Header(stamp_ns=path.stat().st_mtime_ns)
    if path.is_dir():
        return _read_folder(path, header, reduction)
    if path.suffix.lower() == _NPZ:
        return read_npz(path, header, reduction)
    if _list_at(path, sweep_folder.NAME) is not None:
        return sweep_folder.read_sweep(path, header, reduction)
    if path.suffix.lower() in _YAML:
        try:
            return folder.read_folder(path, header, reduction)
        except SettingsError as error:
            if path.name == folder.NAME:
                raise
            raise SettingsError(
                f'{error}; it is read as a {folder.NAME}, as it has no views, as a '
                f'{posed_views.NAME}, and no frames, as a {sweep_folder.NAME}') from None
    raise LightFieldError(f'{path} is no light field: expected an .npz, a {folder.NAME} or a '
                          'folder')


def _read_folder(path: Path, header: Header, reduction: Reduction) -> LightField:
    check_folder(path)
    if (path / folder.NAME).is_file():
        return folder.read_folder(path / folder.NAME, header, reduction)
    if (path / sweep_folder.NAME).is_file():
        return sweep_folder.read_sweep(path / sweep_folder.NAME, header, reduction)
    if (path / hci.NAME).is_file():
        return hci.read_hci(path, header, reduction)
    return read_npz(path / 'views.npz', header, reduction)


def _has_grid(path: Path) -> bool:
    """Whether a folder is a light field."""
    return any((path / each).is_file() for each in (folder.NAME, sweep_folder.NAME, hci.NAME,
                                                    'views.npz'))


def check_folder(path: Path) -> None:
    """Raise LightFieldError where a folder has nothing that `read_source` reads."""
    if _has_grid(path) or has_pictures(path):
        return
    bop.check_no_root(path)
    if any(folder.STANFORD_NAMES.fullmatch(each.name) for each in path.iterdir()):
        raise LightFieldError(f'{path}: {folder.STANFORD_HINT.format(name=folder.NAME)}')
    raise LightFieldError(f'{path} has no {folder.NAME}, {hci.NAME} or views.npz with the '
                          f'geometry of its views; write {folder.NAME} '
                          '(docs/howto/light_fields.md), or of ordinary pictures '
                          f'{posed_views.NAME} (docs/howto/one_picture.md)')
