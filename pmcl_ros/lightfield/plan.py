"""All of a decode that does not depend on the picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.lightfield.calibration.calibration import Calibration
from pmcl_ros.lightfield.calibration.lattice import Lattice
from pmcl_ros.lightfield.lenslets import DARKEST, Lenslets, sum_lenslets
from pmcl_ros.lightfield.pupil import Pupil
from pmcl_ros.lightfield.readers.reduction import MOST_BYTES
from pmcl_ros.lightfield.resample import StandIns, ViewPixels, resample_views
from pmcl_ros.lightfield.view_grid import ViewGrid
from pmcl_ros.runtime.errors import LightFieldError

_MOST_VIEWS = 21
_LEAST_SIDE = 8  # px, of a view, as in a calibration
_LIGHT = 2 ** 14  # counts of relative light 1, when it is summed as if it were a picture


@dataclass(frozen=True)
class DecodePlan:
    """What is read where, and how bright it is made, for one calibration and map of light.

    grid: geometry and weights of the views. inside: (n, 2) row and column of those with light.
    lenslets: all that they are read from. factors: (rows, n, 3, columns) float32, 1 / the light of
    each sample. pixels, shifts, stand_ins: where a pixel of a view lies among the samples.
    """

    grid: ViewGrid
    inside: NDArray[np.int64]
    lattice: Lattice
    lenslets: Lenslets
    factors: NDArray[np.float32]
    pixels: ViewPixels
    shifts: NDArray[np.float64]
    stand_ins: StandIns

    @classmethod
    def make(cls, calibration: Calibration, light: NDArray[np.float32], views: int,
             size: tuple[int, int] | None) -> 'DecodePlan':
        """For `views` x `views` views of `size` (width and height, None: the calibration's).

        light: (height, width), 1 at the centres of lenslets. Raises LightFieldError when the
        lattice is not that of the light, or there is no such grid of views: their number, or their
        pixels, are impossible or too many.
        """
        if views % 2 == 0 or not 1 <= views <= _MOST_VIEWS:
            raise LightFieldError(f'{views} views of a row: their number must be odd, from 1 to '
                                  f'{_MOST_VIEWS}')
        lattice = calibration.lattice
        pinhole = calibration.pinhole if size is None else calibration.pinhole.resized(*size)
        needed = views ** 2 * pinhole.width * pinhole.height * 3 * 4
        if min(pinhole.width, pinhole.height) < _LEAST_SIDE or needed > MOST_BYTES:
            raise LightFieldError(
                f'{views}x{views} views of {pinhole.width}x{pinhole.height} px take '
                f'{needed / 2 ** 30:.1f} GiB; their sides must be {_LEAST_SIDE} px or more, and '
                f'all together take {MOST_BYTES / 2 ** 30:.0f} GiB at most: choose another size, '
                'or fewer views')
        height, width = light.shape
        last = np.array([width - 1, height - 1])
        pupil = Pupil.measure(light, Lenslets.covering(lattice, 0, last[0], 0, last[1]), views)
        # To the bit what messages bring: single precision, and -P[3] over fx.
        positions = pupil.positions.astype(np.float32).astype(np.float64)
        baseline = pinhole.fx * calibration.baseline / pinhole.fx
        inside = np.argwhere(pupil.weights > 0)
        # A view is shifted by where it looks from indeed, be that its nominal step or not.
        focus = baseline / calibration.focus_distance
        shifts = positions[pupil.weights > 0] * [pinhole.fx * focus, pinhole.fy * focus]
        pixels = ViewPixels(pinhole, (width / pinhole.width, height / pinhole.height),
                            calibration.k1, calibration.k2)
        reach = pixels.reach(shifts)
        left, top = np.minimum(reach[:, [0, 2]].min(axis=0), 0)
        right, bottom = np.maximum(reach[:, [1, 3]].max(axis=0), last)
        lenslets = Lenslets.covering(lattice, left, right, top, bottom)
        stand_ins = StandIns.of(lenslets, lattice, inside[:, ::-1] - views // 2, reach, width,
                                height)
        grid = ViewGrid(pinhole, baseline, positions, pupil.weights)
        plan = cls(grid, inside, lattice, lenslets,
                   _factors(light, lenslets, inside, views // 2), pixels, shifts, stand_ins)
        plan.factors.flags.writeable = False
        return plan

    def sample(self, frame: RawFrame, samples: NDArray[np.float32]) -> None:
        """Fill `samples`, of the shape of `factors`, with the linear colours of a frame."""
        metadata = frame.metadata
        sum_lenslets(frame.counts, metadata.black, self.lenslets, self.inside,
                     self.grid.shape[0] // 2, self.factors,
                     1 / (metadata.white - metadata.black), samples)

    def resample(self, samples: NDArray[np.float32], views: NDArray[np.float32]) -> None:
        """Fill `views` (rows, columns, height, width, 3) from `samples`."""
        rows, columns = self.grid.shape
        slots = self.inside[:, 0] * columns + self.inside[:, 1]
        resample_views(samples, self.lattice, self.lenslets.origin, self.pixels, self.shifts,
                       self.stand_ins, slots,
                       views.reshape(rows * columns, *views.shape[2:]))


def _factors(light: NDArray[np.float32], lenslets: Lenslets, inside: NDArray[np.int64],
             half: int) -> NDArray[np.float32]:
    rows, columns = lenslets.shape
    sums = np.empty((rows, len(inside), 3, columns), np.float32)
    counts = np.rint(np.clip(light, 0, 3) * _LIGHT).astype(np.uint16)
    sum_lenslets(counts, 0, lenslets, inside, half, np.ones_like(sums), 1 / _LIGHT, sums)
    return np.divide(1, np.maximum(sums, np.float32(DARKEST), out=sums), out=sums)
