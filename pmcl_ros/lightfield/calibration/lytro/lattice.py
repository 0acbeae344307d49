"""The hexagonal lattice of the lenslets' centres on the sensor."""

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.runtime.settings import Settings


class Lattice(Settings):
    """centre(i, j) = centre_px + R(rotation) [(i + (j mod 2) / 2) pitch_px, j row_step_px].

    Raw pixels as (column, row), 0-based, pixel centres at integers; i and j may be negative.
    """

    pitch_px: float = Field(gt=2, lt=100, description='distance of two lenslets of a row [raw px]')
    row_step_px: float = Field(gt=2, lt=100,
                               description='distance of two rows of lenslets [raw px]')
    rotation: float = Field(
        gt=-0.5, lt=0.5,
        description='from the +x axis of the sensor to the rows, towards +y [rad]')
    centre_px: tuple[float, float] = Field(description='centre of lenslet (0, 0) [raw px]')

    def centres(self, i: NDArray[np.integer], j: NDArray[np.integer]) -> NDArray[np.float64]:
        """(..., 2) raw pixels (column, row) of the centres of lenslets (i, j)."""
        along = (i + np.mod(j, 2) / 2) * self.pitch_px
        across = j * self.row_step_px
        cos, sin = np.cos(self.rotation), np.sin(self.rotation)
        return np.stack([self.centre_px[0] + cos * along - sin * across,
                         self.centre_px[1] + sin * along + cos * across], axis=-1)

    def index_range(self, width: int, height: int) -> tuple[int, int, int, int]:
        """i0, i1, j0, j1, ends excluded: all lenslets that reach onto a sensor of this size."""
        corners = np.array([[x, y] for x in (0, width) for y in (0, height)])
        cos, sin = np.cos(self.rotation), np.sin(self.rotation)
        along, across = np.array([[cos, sin], [-sin, cos]]) @ (corners - self.centre_px).T
        i, j = along / self.pitch_px, across / self.row_step_px
        return (int(np.floor(i.min())) - 2, int(np.ceil(i.max())) + 2,
                int(np.floor(j.min())) - 2, int(np.ceil(j.max())) + 2)

    def nearest(self, points: NDArray[np.floating]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """i, j (...) of the lenslet whose centre is nearest to each raw pixel (..., 2)."""
        apart = np.asarray(points, float) - self.centre_px
        cos, sin = np.cos(self.rotation), np.sin(self.rotation)
        along = (cos * apart[..., 0] + sin * apart[..., 1]) / self.pitch_px
        across = (cos * apart[..., 1] - sin * apart[..., 0]) / self.row_step_px
        # The nearest lens of each of the two rows about the point, then the nearer of the two.
        rows = np.floor(across)[..., None] + [0, 1]
        halves = np.mod(rows, 2) / 2
        columns = np.rint(along[..., None] - halves)
        distances = np.hypot((along[..., None] - columns - halves) * self.pitch_px,
                             (across[..., None] - rows) * self.row_step_px)
        nearer = distances.argmin(axis=-1)[..., None]
        i, j = (np.take_along_axis(each, nearer, axis=-1)[..., 0].astype(np.int64)
                for each in (columns, rows))
        return i, j

    def difference(self, other: 'Lattice', width: int, height: int) -> NDArray[np.float64]:
        """(n,) raw px from each centre of `other` on a sensor to the nearest one of this."""
        i0, i1, j0, j1 = other.index_range(width, height)
        centres = other.centres(*np.meshgrid(np.arange(i0, i1), np.arange(j0, j1))).reshape(-1, 2)
        centres = centres[((centres >= 0) & (centres <= [width - 1, height - 1])).all(axis=1)]
        return np.asarray(np.hypot(*(self.centres(*self.nearest(centres)) - centres).T))


def predicted_lattice(metadata: CameraMetadata) -> Lattice | None:
    """The lattice by the camera's metadata (lytro_f01.md, B3); None: they have no lattice.

    It is only approximate in a real camera; the fits do not use it.
    """
    mla, sensor = metadata.devices.mla, metadata.devices.sensor
    if mla.lensPitch is None or sensor.pixelPitch is None:
        return None
    exit_pupil, gap = metadata.devices.lens.exitPupilOffset.z, mla.sensorOffset.z
    # Projected from the exit pupil, the lenslets are farther apart on the sensor behind them.
    spread = (exit_pupil + gap) / exit_pupil if exit_pupil else 1
    pitch = mla.lensPitch / sensor.pixelPitch * spread
    centre = ((metadata.image.width - 1) / 2 + mla.sensorOffset.x / sensor.pixelPitch,
              (metadata.image.height - 1) / 2 + mla.sensorOffset.y / sensor.pixelPitch)
    return Lattice.make({'pitch_px': pitch * mla.scaleFactor.x,
                         'row_step_px': pitch * mla.scaleFactor.y * 3 ** 0.5 / 2,
                         'rotation': mla.rotation, 'centre_px': centre}, 'metadata')
