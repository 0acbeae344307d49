"""ContourMap: log odds of occluding contours by direction, and of solids, from a network."""

import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.evidence_volume import Box, EvidenceVolume
from pmcl_ros.evidence.learned import LearnedMapEvidence, SupportSlopes
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.runtime.errors import VolumeError

DIRECTIONS = 16  # in which log odds are sampled, 22.5 degrees apart: the series has five terms
_REACH = 4  # standard deviations of a Gaussian
_RESOLUTION = 3.0  # px: a contour is found within half of this on either side
_BAND = 2 ** 18  # px that are blurred or binned at once
_BLURS = 8  # that are kept: of the search's three stages, and of cameras that are uncertain
_MOST = 30.0  # nat / px: no log odds of a network are larger


@dataclass(frozen=True)
class ContourMap(EvidenceVolume):
    """Log odds of contours and solids, for each pixel and refocused depth of a picture.

    tensor: (height, width, labels, 5) a0, c1, s1, c2, s2. A contour whose outward normal has the
        angle t in the image (x right, y down) has the log odds
        a0 + c1 cos t + s1 sin t + c2 cos 2t + s2 sin 2t [nat / px].
    inside: (height, width, labels) float32 log odds that a pixel shows a solid [nat / px].
    Both have one label in place of all where each has the same. They are relative to their base
        rates.
    numbers: how they become evidence.
    bin_side: of the squares of pixels that are one in `coarser`; 1 or less: there is none.
    """

    inside: NDArray[np.float32]
    numbers: LearnedMapEvidence
    bin_side: int = 1
    # What `part` and `blurred` made last: a view that comes again is not blurred again.
    _parts: '_Kept' = field(init=False, repr=False, compare=False, default_factory=dict)
    _blurred: '_Kept' = field(init=False, repr=False, compare=False, default_factory=dict)

    components: ClassVar[int] = 5
    kind: ClassVar[str] = 'contour map'

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.inside.shape != self.tensor.shape[:3] or not np.isfinite(self.inside).all():
            raise VolumeError(f'contour map: inside must be finite, of shape '
                              f'{self.tensor.shape[:3]}, it is {self.inside.shape}')

    @property
    def profile(self) -> ContourProfile:
        """The log odds themselves, weighted, read where contours are found."""
        ends = np.array([-_MOST, _MOST], np.float32)
        return ContourProfile(np.array([self.numbers.contour_offset], np.float32), ends,
                              np.float32(self.numbers.contour_weight) * ends[None],
                              least=self.numbers.least_evidence)

    @property
    def region(self) -> NDArray[np.float32]:
        """See `EvidenceVolume`."""
        if self.numbers.inside_weight == 0:
            return super().region
        return np.float32(self.numbers.inside_weight) * self.inside

    @cached_property
    def coarser(self) -> 'ContourMap | None':
        """See `EvidenceVolume`: the mean likelihood ratios of squares of pixels.

        A network that reads the picture with larger pixels misses thin contours which it sees in
        the picture itself. The log odds of the inside are their means. Errors and resolution stay
        as they are, in pixels: what is found here is judged by the map itself.
        """
        if self.bin_side < 2:
            return None
        side = self.bin_side
        width, height = self.pinhole.width // side, self.pinhole.height // side
        squares = self.inside[:height * side, :width * side].reshape(
            height, side, width, side, -1)
        return replace(
            self, bin_side=1, inside=squares.mean(axis=(1, 3)),
            tensor=np.stack([_binned(self.tensor[:, :, label], side)
                             for label in range(self.tensor.shape[2])], axis=2),
            pinhole=self.pinhole.crop(0, 0, width * side, height * side).resized(width, height),
            numbers=self.numbers.model_copy(update={
                'contour_offset': self.numbers.contour_offset / side}))

    @property
    def resolution(self) -> float:
        """See `EvidenceVolume`."""
        return _RESOLUTION

    @property
    def least_support(self) -> float:
        """See `EvidenceVolume`."""
        return self.numbers.least_support

    @property
    def support_slopes(self) -> SupportSlopes:
        """See `EvidenceVolume`."""
        return self.numbers.slopes

    @property
    def least_weight(self) -> float:
        """See `EvidenceVolume`."""
        return self.numbers.least_weight

    @property
    def model_error(self) -> ModelError:
        """See `EvidenceVolume`."""
        return ModelError(self.numbers.common_error, self.numbers.local_error,
                          self.numbers.error_length,
                          degrees_of_freedom=self.numbers.degrees_of_freedom)

    def inside_of(self, depths: NDArray[np.float32], left: int, top: int) -> float:
        """Mean log odds that the pixels which an object covers show a solid [nat / px].

        depths: (height, width) of its surface, 0 beside it [m]. left, top: pixel of their corner.
        0 where it covers none.
        """
        row, column = np.nonzero(depths)
        if not len(row):
            return 0.0
        label = np.rint(self.labels(depths[row, column])).astype(int)
        return float(self.inside[row + top, column + left,
                                 label.clip(0, self.inside.shape[2] - 1)].mean())

    def on(self, lattice: PixelGrid) -> 'ContourMap':
        """See `EvidenceVolume`."""
        if lattice.pinhole == self.pinhole:
            return self
        tensor, inside = (np.ascontiguousarray(each[lattice.rows[:, None], lattice.columns])
                          for each in (self.tensor, self.inside))
        return replace(self, tensor=tensor, inside=inside, pinhole=lattice.pinhole)

    def part(self, lattice: PixelGrid, depths: NDArray[np.float64]) -> 'ContourMap':
        """See `EvidenceVolume`."""
        made = super().part
        return _kept(self._parts, (lattice, depths.tobytes()), lambda: made(lattice, depths), 1)

    def suppressed(self, kept: NDArray[np.float32]) -> 'ContourMap':
        """See `EvidenceVolume`: log odds of zero say nothing."""
        return replace(self, tensor=self.tensor * kept[..., None, None])

    def blurred(self, sigma: float, box: Box | None = None) -> 'ContourMap':
        """The log odds of a contour within about `sigma` [px] of each place in a box.

        They are the logarithm of the mean likelihood ratio over a Gaussian neighbourhood: what is
        known of a contour whose place is uncertain by `sigma`. box: as in `EvidenceVolume`.
        """
        return _kept(self._blurred, (sigma, box), lambda: self._blur(sigma, box), _BLURS)

    def _blur(self, sigma: float, box: Box | None) -> 'ContourMap':
        height, width = self.tensor.shape[:2]
        left, top, right, bottom = box or (0, 0, width, height)
        reach = math.ceil(_REACH * sigma)
        rows = slice(max(top - reach, 0), max(bottom + reach, 0))
        columns = slice(max(left - reach, 0), max(right + reach, 0))
        sharp, tensor = self.tensor[rows, columns], self.tensor.copy()
        for label in range(tensor.shape[2]):
            if sharp.size:
                tensor[rows, columns, label] = _blurred(sharp[:, :, label], sigma, reach)
        return replace(self, tensor=tensor)


def _blurred(sharp: NDArray[np.float32], sigma: float, reach: int) -> NDArray[np.float32]:
    """(height, width, 5) of one label, in bands: the ratios of all would take a lot of memory.

    reach: of the blur [px].
    """
    height, blurred = len(sharp), np.empty(sharp.shape, np.float32)
    band = max(_BAND // sharp.shape[1], 1)
    for top in range(0, height, band):
        bottom, first = min(top + band, height), max(top - reach, 0)
        ratios = cv2.GaussianBlur(likelihood_ratios(sharp[first:bottom + reach]), (0, 0), sigma)
        blurred[top:bottom] = series(ratios[top - first:bottom - first])
    return blurred


def _binned(sharp: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """(height / side, width / side, 5) of one label, in bands; incomplete squares are cut."""
    height, width = sharp.shape[0] // side, sharp.shape[1] // side
    binned = np.empty((height, width, sharp.shape[2]), np.float32)
    band = max(_BAND // (sharp.shape[1] * side), 1)
    for top in range(0, height, band):
        bottom = min(top + band, height)
        ratios = likelihood_ratios(sharp[top * side:bottom * side, :width * side])
        binned[top:bottom] = series(
            ratios.reshape(bottom - top, side, width, side, DIRECTIONS).mean(axis=(1, 3)))
    return binned


_Kept = dict[Hashable, ContourMap]


def _kept(kept: _Kept, key: Hashable, make: Callable[[], ContourMap], most: int) -> ContourMap:
    """What was made for a key, or is made now; the oldest goes where there are `most`."""
    if key not in kept:
        made = make()
        while len(kept) >= most:
            del kept[next(iter(kept))]
        kept[key] = made
    return kept[key]


def harmonics(angles: NDArray[np.floating]) -> NDArray[np.float32]:
    """(n, 5) factors of a0, c1, s1, c2, s2 for normals of angles (n,) [rad]."""
    t = np.asarray(angles, np.float64)
    return np.stack([np.ones_like(t), np.cos(t), np.sin(t), np.cos(2 * t), np.sin(2 * t)],
                    axis=-1).astype(np.float32)


def likelihood_ratios(tensor: NDArray[np.float32]) -> NDArray[np.float32]:
    """(..., DIRECTIONS) of contours whose normals have evenly spaced angles; tensor: (..., 5)."""
    return np.asarray(np.exp(tensor @ _basis().T))


def series(ratios: NDArray[Any]) -> NDArray[np.float32]:
    """(..., 5) the tensor whose log odds are nearest to those of ratios (..., DIRECTIONS)."""
    basis = _basis()
    # Equally spaced directions make the harmonics orthogonal.
    return np.asarray(np.log(ratios) @ (basis / np.square(basis).sum(axis=0)))


def _basis() -> NDArray[np.float32]:
    return harmonics(2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)
