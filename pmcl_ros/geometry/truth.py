"""The true pose of an object in a capture, and its region of interest: `truth.json`."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import FileError, SettingsError, told_as
from pmcl_ros.runtime.text_file import read_json


@dataclass(frozen=True)
class Truth:
    """Where an object is.

    pose: (4, 4), object to camera, or to the reference frame of several views [m]. roi_center,
    roi_size: the region of interest in that frame [m].
    empty: the object is not there; its pose means nothing. film: whether the object is behind one.
    name: of the scene. cameras: (4, 4) the true poses of simulated views, camera to the reference
    frame [m]; an arm tells others. Empty: unknown.
    """

    pose: NDArray[np.float64]
    roi_center: tuple[float, float, float]
    roi_size: tuple[float, float, float]
    empty: bool
    film: bool = False
    name: str = ''
    cameras: tuple[NDArray[np.float64], ...] = ()

    @classmethod
    def load(cls, path: Path | str) -> 'Truth':
        """Read a truth.json; SettingsError without a pose and a region."""
        with told_as(SettingsError, FileError):
            values = read_json(path)
        try:
            key = 'object_to_camera' if 'object_to_camera' in values else 'object_to_reference'
            pose = np.array(values[key], float).reshape(4, 4)
            x, y, z = (float(each) for each in values['roi']['center'])
            width, height, depth = (float(each) for each in values['roi']['size'])
            return cls(pose, (x, y, z), (width, height, depth), bool(values.get('empty', False)),
                       bool(values.get('film', False)), str(values.get('name', '')),
                       tuple(np.array(each, float).reshape(4, 4)
                             for each in values.get('cameras_to_reference', ())))
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            raise SettingsError(f'{path} holds no object_to_camera (or, of several '
                                f'views, object_to_reference) and roi: {error!r}') from None
