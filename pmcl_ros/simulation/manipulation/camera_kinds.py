"""The cameras that a simulated wrist can carry."""

from pathlib import Path

from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.simulation.lytro.camera import F01, F01_RAW, LytroCamera
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera

# At its widest zoom, 39 degrees: an arm's reach leaves no room for less.
WIDE_F01 = LytroCamera(focal=0.00645, stop=0.00597)


def load_camera(name: str) -> OrdinaryCamera | LytroCamera:
    """The camera that `--camera` names: F01, F01_RAW, or the path of a camera.yaml.

    Raises SettingsError where there is no such file, and as `OrdinaryCamera.load`.
    """
    if name in (F01, F01_RAW):
        return WIDE_F01
    if not Path(name).is_file():
        raise SettingsError(f'--camera {name}: there is no such file; a YAML with width, height, '
                            f'fx, cx, cy, or {F01} or {F01_RAW}')
    return OrdinaryCamera.load(Path(name))
