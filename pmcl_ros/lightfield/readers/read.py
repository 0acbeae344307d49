"""Read a light field of any format, or a picture of an ordinary camera."""

from pathlib import Path

import numpy as np

from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.lightfield.readers import folder, hci, posed_views, sweep_folder
from pmcl_ros.lightfield.readers.npz import read_npz
from pmcl_ros.lightfield.readers.pictures import Reduction
from pmcl_ros.runtime.errors import LightFieldError

Source = LightField | PosedView  # what an object is looked for in

_NPZ, _YAML = '.npz', ('.yaml', '.yml')


def read_source(path: Path | str, every: int = 1, shrink: int = 1) -> Source:
    """Read a light field (`read_light_field`), or the picture of a views.yaml.

    path: as of `read_light_field`, or a views.yaml or the folder with it. The picture's camera is
    the reference frame.
    Raises as `read_light_field`, and LightFieldError for several views or another pose of the
    camera: these are not yet supported.
    """
    yaml = _views_yaml(Path(path))
    if yaml is None:
        return read_light_field(path, every, shrink)
    view, *others = posed_views.read_views(yaml, Reduction(every, shrink))
    if others:
        raise LightFieldError(f'{yaml} has {1 + len(others)} views: several are not yet '
                              'supported, give one')
    if not np.allclose(view.camera_to_reference, np.eye(4), atol=1e-6):
        raise LightFieldError(f'{yaml}: an object in a single picture is found in the frame of '
                              'its camera; leave out camera_to_reference, and give the region of '
                              'interest in that frame')
    return view


def _views_yaml(path: Path) -> Path | None:
    """The views.yaml that a path names, if it does."""
    yaml = path / posed_views.NAME if path.is_dir() else path
    return yaml if yaml.name == posed_views.NAME and yaml.is_file() else None


def is_light_field(path: Path | str) -> bool:
    """Whether `read_source` reads this kind of path; raw pictures are another kind."""
    path = Path(path)
    return path.is_dir() or path.suffix.lower() in (_NPZ, *_YAML)


def read_light_field(path: Path | str, every: int = 1, shrink: int = 1,
                     header: Header | None = None) -> LightField:
    """Read views of known geometry, rectified.

    path: an NPZ file as `pmcl decode` writes, or the folder with it (views.npz); a folder of
        pictures with light_field.yaml (or that file), see `folder.GridSettings`; one of a moved
        camera's pictures with sweep.yaml (or that file), see `sweep_folder.SweepFolder`; a scene's
        folder of the 4D Light Field Benchmark (parameters.cfg).
    every, shrink: take each `every`-th view, make `shrink` x `shrink` pixels one.
    header: stamp and frame; by default the stamp is the file's modification time.
    Raises LightFieldError or SettingsError saying which file is wrong, and how.
    """
    path, reduction = Path(path), Reduction(every, shrink)
    if not path.exists():
        raise LightFieldError(f'there is no {path}')
    if _views_yaml(path) is not None:
        raise LightFieldError(f'{path} is a picture of an ordinary camera, and here a light field '
                              'is needed; localize, report and evaluate take pictures')
    if header is None:
        header = Header(stamp_ns=path.stat().st_mtime_ns)
    if path.is_dir():
        return _read_folder(path, header, reduction)
    if path.suffix.lower() == _NPZ:
        return read_npz(path, header, reduction)
    if path.name == sweep_folder.NAME:
        return sweep_folder.read_sweep(path, header, reduction)
    if path.suffix.lower() in _YAML:
        return folder.read_folder(path, header, reduction)
    raise LightFieldError(f'{path} is no light field: expected an .npz, a {folder.NAME} or a '
                          'folder')


def _read_folder(path: Path, header: Header, reduction: Reduction) -> LightField:
    if (path / folder.NAME).is_file():
        return folder.read_folder(path / folder.NAME, header, reduction)
    if (path / sweep_folder.NAME).is_file():
        return sweep_folder.read_sweep(path / sweep_folder.NAME, header, reduction)
    if (path / hci.NAME).is_file():
        return hci.read_hci(path, header, reduction)
    if (path / 'views.npz').is_file():
        return read_npz(path / 'views.npz', header, reduction)
    if any(folder.STANFORD_NAMES.fullmatch(each.name) for each in path.iterdir()):
        raise LightFieldError(f'{path}: {folder.STANFORD_HINT.format(name=folder.NAME)}')
    raise LightFieldError(f'{path} has no {folder.NAME}, {hci.NAME} or views.npz with the '
                          f'geometry of its views; write {folder.NAME}')
