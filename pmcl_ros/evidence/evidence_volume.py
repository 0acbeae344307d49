"""What pictures show of contours, for each pixel and depth: read by the contour search."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.volume import check_values
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.learned import NO_SLOPES, SupportSlopes
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole

Box = tuple[int, int, int, int]  # left, top, right, bottom [px]
Volume = TypeVar('Volume', bound='EvidenceVolume')


@dataclass(frozen=True)
class EvidenceVolume(ABC):
    """Evidence of contours in one picture; `EdgeVolume` and `ContourMap` are its two kinds.

    tensor: (height, width, labels, components) float32; one label in place of all where each has
        the same, as in one picture. A reading of it depends on the contour's normal: `EdgeVolume`
        and `ContourMap` tell how.
    depths: (labels,) float64 [m], far to near, uniform in inverse depth.
    Raises VolumeError for values that do not fit together.
    """

    header: Header
    tensor: NDArray[np.float32]
    depths: NDArray[np.float64]
    pinhole: Pinhole

    components: ClassVar[int]
    kind: ClassVar[str]  # for messages

    def __post_init__(self) -> None:
        check_values(self.tensor, (self.components,), self.depths, self.pinhole, self.kind,
                     shared=True)

    @property
    @abstractmethod
    def profile(self) -> ContourProfile:
        """The evidence of a contour point by the readings across it. Raises SettingsError."""

    @property
    @abstractmethod
    def least_support(self) -> float:
        """Support below which an object is lost (`contour_support`) [nat / px]."""

    @property
    def support_slopes(self) -> SupportSlopes:
        """How the support that a pose needs depends on its other numbers."""
        return NO_SLOPES

    @property
    def least_weight(self) -> float:
        """Posterior weight of a pose's mode below which the object is lost: it is ambiguous."""
        return 0.0

    @property
    @abstractmethod
    def model_error(self) -> ModelError:
        """How far contours in such pictures are from rendered ones. Raises SettingsError."""

    @property
    def shows_creases(self) -> bool:
        """Whether the learned profile across creases holds for it."""
        return False

    @property
    def coarser(self) -> 'EvidenceVolume | None':
        """Of the same picture with larger pixels: the search begins there; None: here."""
        return None

    @property
    def resolution(self) -> float:
        """Contours that are nearer to each other than this are one in the evidence [px]."""
        return 0.0

    @property
    def region(self) -> NDArray[np.float32]:
        """(height, width, labels) evidence that a pixel shows a solid [nat / px]; empty: none.

        One label in place of all, where each has the same.
        """
        return np.zeros((0, 0, 0), np.float32)

    @abstractmethod
    def suppressed(self: Volume, kept: NDArray[np.float32]) -> Volume:
        """With the evidence of contours reduced by factors (height, width), 0 to 1."""

    @abstractmethod
    def blurred(self: Volume, sigma: float, box: Box | None = None) -> Volume:
        """For contours in a box whose place is uncertain by `sigma` [px]; default: everywhere."""

    def labels(self, depths: ArrayLike) -> NDArray[np.float64]:
        """(...) labels, between whole ones too, of depths (...) [m]."""
        inverse = 1 / self.depths
        return np.asarray((1 / np.asarray(depths) - inverse[0]) / (inverse[1] - inverse[0]))

    def on(self: Volume, lattice: PixelGrid) -> Volume:
        """The same on some of the pixels."""
        if lattice.pinhole == self.pinhole:
            return self
        tensor = np.ascontiguousarray(self.tensor[lattice.rows[:, None], lattice.columns])
        return replace(self, tensor=tensor, pinhole=lattice.pinhole)

    def part(self: Volume, lattice: PixelGrid, depths: NDArray[np.float64]) -> Volume:
        """The same on some of the pixels, with other labels: of a picture, the same at any."""
        return replace(self.on(lattice), depths=depths)
