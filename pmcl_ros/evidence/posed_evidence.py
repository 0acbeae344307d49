"""Evidence of several posed views: one evidence volume each, with its camera's pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.runtime.errors import VolumeError


@dataclass(frozen=True)
class PosedEvidence:
    """The evidence of one view. The rest as in `PosedView`."""

    evidence: EvidenceVolume
    camera_to_reference: NDArray[np.float64]
    sigma: tuple[float, float] = (0.0, 0.0)
    group: str = ''
    common: float = 1.0


@dataclass(frozen=True)
class ViewsEvidence:
    """The evidence of several views of one scene.

    header: stamp of the estimate, and the reference frame. pictures: of the same views, where
    surfaces are to be compared in them too. Raises VolumeError without a view.
    """

    header: Header
    views: tuple[PosedEvidence, ...]
    pictures: PosedViews | None = None

    def __post_init__(self) -> None:
        if not self.views:
            raise VolumeError('there is no evidence of any view')

    @property
    def pinhole(self) -> Pinhole:
        """Of the first view."""
        return self.views[0].evidence.pinhole
