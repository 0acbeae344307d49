"""What happened in one trial, as a JSON file."""

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from pmcl_ros.geometry.pose_error import is_right
from pmcl_ros.runtime.settings import Settings
from pmcl_ros.runtime.text_file import read_json

Cause = Literal['', 'not found', 'not sure', 'wrong pose', 'no reachable grasp', 'slip',
                'not upright', 'touched', 'program']
_SAID: tuple[Cause, ...] = ('not found', 'not sure', 'no reachable grasp')
TOUCH = 10.0  # N: more than this before the grasp closes breaks a glass


class Picture(Settings):
    """One picture of the wrist camera."""

    file: str = Field(description='beside the trial')
    camera: tuple[float, ...] = Field(description='where the robot believes the camera to be: '
                                      'its pose in base_link, row by row')
    error: tuple[float, float] = Field(description='of that belief [mm], [degrees]')


class Grip(Settings):
    """One closing of the fingers."""

    gap: float = Field(description='that was left between the fingers [m]')
    held: bool = Field(description='whether the object was between them')
    pose: tuple[float, ...] | None = Field(None, description='that was reported last: object to '
                                           'base_link, row by row')
    off: tuple[float, float] | None = Field(description='the error of the last pose that was '
                                            'reported, at that time [mm], [degrees]; null: '
                                            'none was')
    moved: float | None = Field(None, description='how far the object had moved since [mm]')


class ManipulationTrial(Settings):
    """One trial of manipulation. All of it is the simulator's truth, which the nodes never see."""

    seed: int
    place: str
    stands: bool = Field(description='how the object was at the beginning')
    by_truth: bool = Field(False, description='whether the robot was given the true pose')
    pictures: tuple[Picture, ...] = ()
    poses: tuple[tuple[float, float], ...] = Field((), description='errors of the poses that were '
                                                   'reported [mm], [degrees]')
    grips: tuple[Grip, ...] = ()
    largest_touch: float = Field(0.0, description='before the first grip closed [N]')
    done: bool = Field(False, description='upright on the tray; from a tank: held clear of the '
                       'water')
    said: str = Field('', description='what the executive said at the end')
    status: int = Field(0, description="of the executive's process")
    times: dict[str, float] = Field({}, description='[s]: rendering, physics, to the first grasp '
                                    'command without these')

    @classmethod
    def read(cls, path: Path) -> 'ManipulationTrial':
        """FileError and SettingsError for what is no trial."""
        return cls.make(read_json(path), str(path))

    @property
    def wrong_grips(self) -> int:
        """How often it grasped at a pose that is not right (`is_right`)."""
        return sum(each.off is not None
                   and not is_right(1e-3 * each.off[0], np.deg2rad(each.off[1]))
                   for each in self.grips)

    @property
    def cause(self) -> Cause:
        """Why it failed; empty: it did not."""
        if self.largest_touch > TOUCH:
            return 'touched'
        if self.done:
            return ''
        if self.wrong_grips:
            return 'wrong pose'
        if self.grips:
            upright = self.status == 0 and self.place == 'sink'
            return 'not upright' if upright else 'slip'
        for cause in _SAID:
            if cause in self.said:
                return cause
        return 'program'
