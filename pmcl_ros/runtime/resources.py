"""Where the package's own files lie: package://pmcl_ros/... as in the rest of ROS."""

import os
import sys
from pathlib import Path

import pmcl_ros
from pmcl_ros.runtime.errors import SettingsError

SCHEME = 'package://pmcl_ros/'


def resolve(path: str, parameter: str) -> Path:
    """The file or folder that a parameter names; SettingsError when it is empty or does not exist.

    `package://pmcl_ros/X` is X in the source tree, or in the package's share folder: of the prefix
    that the package is installed in, of those in AMENT_PREFIX_PATH, or of Python's.
    """
    if not path:
        raise SettingsError(f'parameter {parameter!r} is empty; set it to a path')
    if not path.startswith(SCHEME):
        found = Path(path).expanduser()
        if not found.exists():
            raise SettingsError(f'parameter {parameter!r}: there is no {found.absolute()}')
        return found
    tried = candidates(path)
    for each in tried:
        if each.exists():
            return each
    raise SettingsError(f'parameter {parameter!r}: {path} is in none of '
                        f'{", ".join(str(each) for each in tried)}')


def cameras_folder() -> Path:
    """Where the user's calibrations lie, each with the name of its camera."""
    home = os.environ.get('XDG_CONFIG_HOME') or '~/.config'
    return Path(home).expanduser() / 'pmcl_ros' / 'cameras'


def calibration_file(name: str) -> Path:
    """A calibration by its path, as of `resolve`, or by the name of its camera.

    The name is that of a file in `cameras_folder`, or of one that the package ships. Raises
    SettingsError.
    """
    if not name or Path(name).name != name or Path(name).suffix or Path(name).is_file():
        return resolve(name, 'calibration')
    folders = [cameras_folder(), *candidates(f'{SCHEME}config/cameras')]
    known = {each.stem: each for folder in reversed(folders) for each in folder.glob('*.yaml')}
    if name not in known:
        raise SettingsError(
            f"parameter 'calibration': there is no file {name}, and no camera of that name; known "
            f'are {", ".join(sorted(known)) or "none"}. pmcl calibrate --camera {name} makes one '
            f'in {folders[0]}')
    return known[name]


def candidates(path: str) -> list[Path]:
    """Where `package://pmcl_ros/...` may be, the first that exists counts (`resolve`)."""
    return [folder / path.removeprefix(SCHEME) for folder in _folders()]


def _folders() -> list[Path]:
    root = Path(pmcl_ros.__file__).parent.parent
    ament = [each for each in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if each]
    # pip installs into other prefixes too: --user, --target, /usr/local of Debian's Python.
    own = [each for each in root.parents if (each / 'share' / 'pmcl_ros').is_dir()]
    prefixes = [*own, *map(Path, ament), Path(sys.prefix)]
    return [root, *(each / 'share' / 'pmcl_ros' for each in prefixes)]
