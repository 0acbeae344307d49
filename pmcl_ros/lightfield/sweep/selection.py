"""The grid cell of each frame of a sweep, and which frames are used."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import rotation_angle
from pmcl_ros.lightfield.sweep.frame import LeftOut, SweepFrame
from pmcl_ros.lightfield.sweep.settings import SweepSettings

FASTEST = 30.0  # m/s: nothing moves a camera faster
_PLAIN = 1e-12  # sharpness of a picture of one colour, which is as sharp as another one
Sorted = tuple[list[SweepFrame], list[LeftOut]]


@dataclass(frozen=True)
class Layout:
    """Cells of a grid, and how far each frame is from its cell's middle.

    cells: (n, 2) int64 row and column of each frame; outside the grid where there is no such cell.
    aside: (n,) from the cell's middle, in view steps.
    away: (n,) from the middle of the centre cell, in view steps.
    """

    cells: NDArray[np.int64]
    aside: NDArray[np.float64]
    away: NDArray[np.float64]
    shape: tuple[int, int]

    @classmethod
    def from_poses(cls, poses: Sequence[NDArray[np.float64]], settings: SweepSettings,
                   middle: NDArray[np.float64] | None = None) -> 'Layout':
        """The layout of cameras at `poses` (n, 4, 4).

        middle: (4, 4) pose of the grid, x along its rows, y along its columns; None: the medoid
        of the cameras' directions, and the place where most cells have a frame.
        """
        cameras = np.array(poses, float).reshape(-1, 4, 4)
        shape = np.array([settings.rows, settings.columns])
        if middle is None:
            turn = _typical(cameras[:, :3, :3])
            steps = (cameras[:, :3, 3] @ turn)[:, 1::-1] / settings.baseline
            steps -= _corner(steps, (settings.rows, settings.columns))
        else:
            places = (cameras[:, :3, 3] - middle[:3, 3]) @ middle[:3, :3]
            steps = places[:, 1::-1] / settings.baseline + (shape - 1) / 2
        cells = np.floor(steps + 0.5).astype(np.int64)
        return cls(cells, np.linalg.norm(steps - cells, axis=1),
                   np.linalg.norm(steps - shape // 2, axis=1), (settings.rows, settings.columns))

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(n,) whether a frame lies in the grid."""
        return np.asarray(((self.cells >= 0) & (self.cells < self.shape)).all(axis=1))

    @property
    def filled(self) -> int:
        """Number of cells with a frame."""
        return len(np.unique(self.cells[self.inside], axis=0))


def _typical(turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) medoid of the rotations (n, 3, 3): the least sum of angles to the others.

    A mean would follow outliers.
    """
    return np.asarray(turns[np.argmin([rotation_angle(turns, each).sum() for each in turns])])


def _corner(steps: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.float64]:
    """(2,) place of cell (0, 0) of the grid with most cells filled by frames (n, 2).

    Ties are resolved by the frames' distances to their cells. All grids with a frame in the middle
    of a cell are tried: the mean of all frames would follow outliers.
    """
    rows, columns = shape
    best, corner = -np.inf, steps[0]
    for own in steps:
        apart = steps - own
        cells = np.floor(apart + 0.5).astype(np.int64)
        near = (abs(cells) < shape).all(axis=1)
        aside = np.linalg.norm(apart - cells, axis=1)[near].mean()
        sums = np.zeros((2 * rows, 2 * columns), np.int64)
        places = cells[near] + shape
        sums[places[:, 0], places[:, 1]] = 1
        sums = sums.cumsum(axis=0).cumsum(axis=1)
        filled = (sums[rows:, columns:] - sums[:rows, columns:] - sums[rows:, :columns]
                  + sums[:rows, :columns])  # of the grid whose last cell is at (i, j)
        row, column = np.unravel_index(filled.argmax(), filled.shape)
        score = float(filled[row, column] - aside)
        if score > best:
            best, corner = score, own + np.array([row - rows + 1, column - columns + 1])
    return np.asarray(corner)


def good_pictures(frames: Sequence[SweepFrame], settings: SweepSettings) -> Sorted:
    """Drop frames that moved during the exposure, are blurred, or differ in brightness.

    Blur and brightness are relative to the median of the unmoved frames: a scene with little
    texture is not blurred.
    """
    left: list[LeftOut] = []
    still: list[SweepFrame] = []
    for each in frames:
        reason = moves(each, settings)
        if reason:
            left.append(LeftOut(each.name, reason))
        else:
            still.append(each)
    if not still:
        return still, left
    light = np.array([each.brightness for each in still])
    usual = float(np.median(light))
    shares = relative_sharpness(still)
    good: list[SweepFrame] = []
    for each, share, mean in zip(still, shares, light, strict=True):
        if share < settings.sharpness:
            left.append(LeftOut(each.name, f'blurred: {100 * share:.0f} % of the usual sharpness, '
                                f'{100 * settings.sharpness:.0f} are needed'))
        elif abs(mean - usual) > settings.brightness * usual:
            left.append(LeftOut(each.name, f'its mean is {mean:.3f}, that of most {usual:.3f}: '
                                'lock exposure and white balance'))
        else:
            good.append(each)
    return good, left


def moves(frame: SweepFrame, settings: SweepSettings) -> str:
    """Reason to drop a frame that moved during its exposure; empty: it did not."""
    moved = frame.movement(settings.near, settings.exposure)
    if moved <= settings.movement:
        return ''
    return (f'moved by {moved:.1f} px in its {1e3 * settings.exposure:g} ms ({frame.speed:.3f} '
            f'm/s, {frame.angular_speed:.3f} rad/s), {settings.movement:g} are allowed'
            + ('; are the poses in millimetres, not metres?' if frame.speed >= FASTEST else ''))


def distance(one: SweepFrame, other: SweepFrame, near: float) -> float:
    """Distance of two frames [m], as of `distances`."""
    return float(distances(one.pose, other.pose[None], near)[0])


def distances(pose: NDArray[np.float64], others: NDArray[np.float64], near: float
              ) -> NDArray[np.float64]:
    """(n,) distances [m] of a pose (4, 4) from others (n, 4, 4).

    A rotation counts by its motion of points at depth `near`.
    """
    return np.asarray(np.linalg.norm(pose[:3, 3] - others[:, :3, 3], axis=1)
                      + near * rotation_angle(others, pose))


def relative_sharpness(frames: Sequence[SweepFrame]) -> NDArray[np.float64]:
    """(n,) sharpness of each frame in its blurrier direction, relative to the median."""
    energies = np.maximum([each.sharpness for each in frames], _PLAIN)
    return np.asarray((energies / np.median(energies, axis=0)).min(axis=1))


def one_for_each_cell(frames: Sequence[SweepFrame], layout: Layout,
                      reference: int) -> tuple[dict[tuple[int, int], SweepFrame], list[LeftOut]]:
    """The frame of each cell (row, column), and the others.

    Sharper frames and frames nearer to the cell's middle win. The centre cell gets the frame of
    index `reference`, wherever it lies.
    """
    rows, columns = layout.shape
    score = np.minimum(relative_sharpness(frames), 1.0) - layout.aside
    chosen: dict[tuple[int, int], int] = {(rows // 2, columns // 2): reference}
    left: list[LeftOut] = []
    for number in np.argsort(-score, kind='stable').tolist():
        if number == reference:
            continue
        row, column = layout.cells[number].tolist()
        if not layout.inside[number]:
            left.append(LeftOut(frames[number].name, f'outside the {rows}x{columns} grid, at row '
                                f'{row}, column {column}'))
        elif (row, column) in chosen:
            left.append(LeftOut(frames[number].name, f'{frames[chosen[row, column]].name} is '
                                f'better or nearer in row {row}, column {column}', True))
        else:
            chosen[row, column] = number
    return {cell: frames[number] for cell, number in chosen.items()}, left
