"""The kernels that read and decode raw pictures, of commands that do not search."""

from pathlib import Path

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.camera.packing import unpack12
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.runtime.resources import resolve
from pmcl_ros.warm_up.stage import Stage, Stages


def _unpack() -> None:
    unpack12(bytes(24), 4, 4)


def _decode() -> None:
    """Decode the shipped white image as a picture."""
    calibration, white = _camera()
    Decoders(calibration, white).decode(read_raw_frame(white))


def _light() -> None:
    """Take the shipped white image for a picture."""
    from pmcl_ros.lightfield.light_from_picture import light_from_picture
    calibration, white = _camera()
    light_from_picture(read_raw_frame(white), calibration.lattice)


def _camera() -> tuple[Calibration, Path]:
    """A calibration, and the path of its white image."""
    folder = resolve('package://pmcl_ros/config/cameras', 'config')
    return Calibration.load(folder / 'demo.yaml'), folder / 'demo_white.RAW.xz'


UNPACK: Stages = Stage(_unpack, ('camera.packing',)),
DECODE: Stages = Stage(_decode, ('camera.packing', *(
    f'lightfield.{each}.' for each in ('lenslets', 'light_field', 'pupil', 'resample')))),


def light_stages() -> Stages:
    """Of the light from a picture without a white image."""
    # Here: it imports large parts of scipy, and the progress counts kernels that are imported.
    from pmcl_ros.lightfield import light_from_picture  # noqa: F401
    return Stage(_light, ('lightfield.light_from_picture',)),
