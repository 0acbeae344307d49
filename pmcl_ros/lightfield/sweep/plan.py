"""Plans of sweeps: the poses of the pictures, and the depth resolution of the views."""

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.light_field import nominal_positions
from pmcl_ros.lightfield.posed_view import quaternion_pose
from pmcl_ros.runtime.errors import LightFieldError, told_as
from pmcl_ros.runtime.settings import Settings

MATCHING = 0.25  # px: standard deviation of a measured displacement
BASELINES = 1e-5, 10.0  # m: least and largest distance of neighbouring views


def depth_resolution(distance: float, fx: float, width: float, matching: float = MATCHING
                     ) -> float:
    """Standard deviation of depth [m] of a stereo rig: sigma_z = z^2 sigma_d / (f B).

    From d = f B / z: an error sigma_d of a displacement is an error z^2 sigma_d / (f B) of z.
    distance: z [m]. fx: f [px]. width: B, of the sweep, from its first to its last view [m].
    matching: sigma_d [px]. The centre view is compared with views B / 2 to both sides, which is
    sqrt(2) times less accurate than one pair B apart; the other views compensate for this.
    """
    return distance ** 2 * matching / (fx * width)


def width_for(distance: float, fx: float, resolution: float, matching: float = MATCHING) -> float:
    """The width of a sweep [m] whose `depth_resolution` is `resolution` [m]."""
    return distance ** 2 * matching / (fx * resolution)


class PlannedView(Settings):
    """One pose of the camera's optical frame (x right, y down, z forward)."""

    row: int = Field(ge=0, description='of the view')
    column: int = Field(ge=0, description='of the view')
    position: tuple[float, float, float] = Field(description='[m]')
    orientation: tuple[float, float, float, float] = Field(description='quaternion x, y, z, w')

    @model_validator(mode='after')
    def _rigid(self) -> 'PlannedView':
        with told_as(ValueError, LightFieldError):
            _ = self.pose
        return self

    @property
    def pose(self) -> NDArray[np.float64]:
        """(4, 4)."""
        return quaternion_pose(self.position, self.orientation,
                               f'row {self.row}, column {self.column}')


class SweepPlan(Settings):
    """A grid of parallel poses in one plane, in a short order for an arm.

    frame: of the poses; empty: the camera's at the middle of the grid.
    """

    frame: str = Field('', description="frame of the poses; empty: the camera's at the grid's "
                       'middle')
    rows: int = Field(ge=1, le=99, description='rows of views')
    columns: int = Field(ge=1, le=99, description='views of a row')
    baseline: float = Field(ge=BASELINES[0], le=BASELINES[1],
                            description='between neighbouring views [m]')
    poses: list[PlannedView] = Field(min_length=2, description='to take pictures at')

    @model_validator(mode='after')
    def _whole(self) -> 'SweepPlan':
        cells = sorted((each.row, each.column) for each in self.poses)
        if cells != [*np.ndindex(self.rows, self.columns)]:
            raise ValueError(f'{len(self.poses)} poses are not the {self.rows}x{self.columns} of '
                             'the grid, one for each row and column')
        return self

    @classmethod
    def from_grid(cls, rows: int, columns: int, baseline: float,
                  middle: NDArray[np.float64] | None = None, frame: str = '') -> 'SweepPlan':
        """A plan about `middle` (4, 4), every second row from right to left."""
        middle = np.eye(4) if middle is None else middle
        steps = nominal_positions(rows, columns)
        steps -= steps.mean((0, 1))
        x, y, z, w = Rotation.from_matrix(middle[:3, :3]).as_quat(canonical=True).tolist()
        poses = []
        for row in range(rows):
            for column in range(columns) if row % 2 == 0 else reversed(range(columns)):
                place = middle[:3, :3] @ [*(baseline * steps[row, column]), 0] + middle[:3, 3]
                a, b, c = (round(each, 6) + 0.0 for each in place.tolist())
                poses.append(PlannedView(row=row, column=column, position=(a, b, c),
                                         orientation=(x, y, z, w)))
        return cls(frame=frame, rows=rows, columns=columns, baseline=baseline, poses=poses)

    @property
    def middle(self) -> NDArray[np.float64] | None:
        """(4, 4) of the grid in `frame`; None where the poses are relative to it."""
        if not self.frame:
            return None
        poses = np.array([each.pose for each in self.poses])
        return pose_of(Rotation.from_matrix(poses[:, :3, :3]).mean(),
                       poses[:, :3, 3].mean(axis=0))
