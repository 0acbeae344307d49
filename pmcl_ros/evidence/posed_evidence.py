"""Evidence of several posed views: one evidence volume each, with its camera's pose."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.runtime.errors import VolumeError

_SHOWS = 0.25  # px: contours are seldom known better


@dataclass(frozen=True)
class PosedEvidence:
    """The evidence of one view. The rest as in `PosedView`.

    view: that it is of, where surfaces are to be compared in the pictures too.
    """

    evidence: EvidenceVolume
    camera_to_reference: NDArray[np.float64]
    sigma: tuple[float, float] = (0.0, 0.0)
    group: str = ''
    common: float = 1.0
    drift: float = 0.0
    view: PosedView | None = None

    @property
    def pixels_off(self) -> float:
        """By how far the stated errors move what it shows [px]."""
        position, rotation = self.sigma
        depth = float(self.evidence.depths[len(self.evidence.depths) // 2])
        return self.evidence.pinhole.fx * (position / depth + rotation)


@dataclass(frozen=True)
class AssumedCameras:
    """Cameras of views in place of those that are given as exact.

    poses: (n, 4, 4) to the reference frame. errors: as of `ViewsEvidence`; None: they are exact.
    """

    poses: NDArray[np.float64]
    errors: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class ViewsEvidence:
    """The evidence of several views of one scene.

    header: stamp of the estimate, and the reference frame. errors: (n, 6, k) of the cameras, as
    `CameraErrors.root`; None: those that the views state. Raises VolumeError without a view.
    """

    header: Header
    views: tuple[PosedEvidence, ...]
    errors: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        if not self.views:
            raise VolumeError('there is no evidence of any view')

    @property
    def pictures(self) -> PosedViews | None:
        """All views; None where one is not known."""
        views = tuple(each.view for each in self.views if each.view is not None)
        return PosedViews(views) if len(views) == len(self.views) else None

    @property
    def cameras(self) -> list[tuple[Pinhole, NDArray[np.float64]]]:
        """Of the views, each with its pose (4, 4) in the reference frame."""
        return [(each.evidence.pinhole, each.camera_to_reference) for each in self.views]

    @property
    def poses(self) -> NDArray[np.float64]:
        """(n, 4, 4) of the cameras."""
        return np.array([each.camera_to_reference for each in self.views])

    @property
    def coarser(self) -> 'ViewsEvidence | None':
        """With the coarser evidence of views that have one; None where no view has."""
        if all(each.evidence.coarser is None for each in self.views):
            return None
        return replace(self, views=tuple(
            replace(each, evidence=each.evidence.coarser or each.evidence)
            for each in self.views))

    def without(self, numbers: Sequence[int]) -> 'ViewsEvidence':
        """Without some of the views. Raises VolumeError where none is left."""
        kept = [number for number in range(len(self.views)) if number not in numbers]
        return replace(self, views=tuple(self.views[number] for number in kept),
                       errors=None if self.errors is None else self.errors[kept])

    def with_cameras(self, assumed: AssumedCameras) -> 'ViewsEvidence':
        """The same views, with other cameras."""
        return replace(self, errors=assumed.errors, views=tuple(
            replace(each, camera_to_reference=pose, sigma=(0.0, 0.0))
            for each, pose in zip(self.views, assumed.poses, strict=True)))

    @property
    def are_exact(self) -> bool:
        """Whether the cameras' poses count as exact: no errors are stated that would show."""
        return self.errors is None and not any(each.pixels_off > _SHOWS or each.drift
                                               for each in self.views)

    @property
    def pinhole(self) -> Pinhole:
        """Of the first view."""
        return self.views[0].evidence.pinhole
