"""The contour evidence of several views together: where poses are feasible, their refinement."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.pmcl.contour_evidence import STAGES, ContourEvidence
from pmcl_ros.pmcl.multi_view.camera_errors import CameraErrors
from pmcl_ros.pmcl.multi_view.other_objects import OtherObjects
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.posterior import Feasible
from pmcl_ros.pmcl.prior.orientation import Orientation
from pmcl_ros.pmcl.prior.region import Region, out_of_view, regions_before
from pmcl_ros.pmcl.render.back_end import Renderer
from pmcl_ros.pmcl.render.gauss_newton import GaussNewton
from pmcl_ros.pmcl.render.scene import Window
from pmcl_ros.pmcl.settings import PmclSettings

_AT_STAGES = 3, 5, 1000  # views at most by which coarse, fine and finest contours are refined


@dataclass(frozen=True)
class JointEvidence:
    """Evidence of an object's poses in several views.

    Poses are in the frame of the first camera that sees the region. views: what each that sees it
    shows. first: (4, 4) that camera, to the reference frame. cameras: (n, 4, 4) of the views, to
    the frame of the first. errors: of the cameras. region: a box there that holds the region of
    interest. box: (4, 4) from that frame into that of the region of
    interest, and half its size (3,) [m]. numbers: of the views, among all. constraint: (n,) which
    of poses (n, 4, 4) are feasible besides. fronts: in each view (height, width) depth of other
    objects, which may hide this one; 0 for none [m]. masked: in each view (height, width) whether
    its mask leaves the pixel out; None: it has none.
    """

    model: ObjectModel
    views: tuple[ContourEvidence, ...]
    first: NDArray[np.float64]
    cameras: NDArray[np.float64]
    errors: CameraErrors
    region: Region
    box: tuple[NDArray[np.float64], NDArray[np.float64]]
    numbers: tuple[int, ...]
    constraint: Feasible | None = None
    fronts: tuple[NDArray[np.float32], ...] = ()
    masked: tuple[NDArray[np.bool_] | None, ...] = ()

    @classmethod
    def from_views(cls, evidence: ViewsEvidence, renderer: Renderer, model: ObjectModel,
                   settings: PmclSettings, others: OtherObjects | None = None) -> 'JointEvidence':
        """Of the views that see the region of interest, which is a box in the reference frame.

        others: other objects, in that frame. Raises LocalizationError where none does.
        """
        seen = regions_seen(evidence, model, settings)
        posed, views = [evidence.views[number] for number in seen], []
        for each, region in zip(posed, seen.values(), strict=True):
            window = region.window(each.evidence.pinhole, model.radius)
            grid = PixelGrid.from_crop(each.evidence.pinhole,
                                       (window.left, window.top, *window.size), 1)
            # The evidence of a picture is the same at all depths; labels say where to expect it.
            depths = depth_labels(*region.grown(model.radius), len(each.evidence.depths))
            volume = each.evidence.part(grid, depths)
            views.append(ContourEvidence.from_volume(volume, renderer, model, settings, None, None,
                                                    None, region, each.camera_to_reference))
        first = posed[0].camera_to_reference
        cameras = np.linalg.inv(first) @ np.array([each.camera_to_reference for each in posed])
        into = first.copy()
        into[:3, 3] -= settings.roi_center
        errors = (CameraErrors.from_views(posed) if evidence.errors is None
                  else CameraErrors(evidence.errors[list(seen)]))
        return cls(model, tuple(views), first, cameras, errors, views[0].region,
                   (into, np.array(settings.roi_size) / 2), tuple(seen),
                   None if others is None else lambda poses: others.feasible(first @ poses),
                   () if others is None else tuple(
                       others.depths(renderer, each, view.camera_to_reference)
                       for each, view in zip(views, posed, strict=True)),
                   tuple(_masked(each.volume, view.view)
                         for each, view in zip(views, posed, strict=True)))

    def seen(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Poses (..., 4, 4) in the reference frame, in the frame of the first camera."""
        return np.asarray(np.linalg.inv(self.first) @ poses, float)

    def feasible(self, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,) which of poses (n, 4, 4) are in the region, turned as the object can be."""
        into, half = self.box
        places = poses[:, :3, 3] @ into[:3, :3].T + into[:3, 3]
        inside = (np.abs(places) <= half + 1e-9).all(axis=1)
        if self.orientation is not None:
            inside &= self.orientation.allows(poses[:, :3, :3])
        if self.constraint is not None:
            inside &= self.constraint(poses)
        return np.asarray(inside)

    @property
    def orientation(self) -> Orientation | None:
        """Of the object, if it is not any, in the frame of the poses."""
        return self.views[0].orientation

    @property
    def independent(self) -> float:
        """Number of views whose model errors are independent that these are worth."""
        return self.independent_with(np.zeros((0, 3)))

    def independent_with(self, places: NDArray[np.float64]) -> float:
        """The same with further cameras at places (k, 3)."""
        middle = np.array(self.views[0].region.center)
        sights = middle - np.concatenate([self.cameras[:, :3, 3], places])
        sights /= np.linalg.norm(sights, axis=1, keepdims=True)
        angles = np.arccos(np.clip(sights @ sights.T, -1, 1))
        return float(len(sights) ** 2 / self.views[0].error.between_views(angles).sum())

    def spread(self, count: int) -> list[int]:
        """Indices of `count` views, the first and others as far apart as possible."""
        axes = self.cameras[:, :3, 2]
        places = self.cameras[:, :3, 3]
        kept = [0]
        while len(kept) < min(count, len(self.views)):
            apart = np.linalg.norm(axes[:, None] - axes[kept], axis=2)
            apart += np.linalg.norm(places[:, None] - places[kept], axis=2)
            nearest = apart.min(axis=1)
            nearest[kept] = -1  # of equal cameras each is taken once
            kept.append(int(nearest.argmax()))
        return sorted(kept)

    def optimizers(self, stages: Sequence[int] = STAGES) -> list[GaussNewton]:
        """Gauss-Newton at some stages of the search, as of one view, in some of the views."""
        off = self.uncertain
        return [GaussNewton([self.views[number].expansion(
            stage, float(off[number]), self.cameras[number])
            for number in self.spread(_AT_STAGES[stage])], self.region) for stage in stages]

    @property
    def uncertain(self) -> NDArray[np.float64]:
        """(n,) standard deviation with which each camera sees the region off [px]."""
        return self.errors.pixels([each.volume.pinhole for each in self.views],
                                  [each.region.center[2] for each in self.views])


def _masked(volume: EvidenceVolume, view: PosedView | None) -> NDArray[np.bool_] | None:
    """(height, width) where `build_map` has left out what a view's mask does; None: it has none.

    The map says nothing at all there, in any part of the picture and at any size of its pixels.
    """
    if view is None or view.mask is None:
        return None
    return np.asarray(~volume.tensor.any(axis=(2, 3)))


def regions_seen(evidence: ViewsEvidence, model: ObjectModel, settings: PmclSettings
                 ) -> dict[int, Region]:
    """Boxes before the cameras that hold the region of interest, by the numbers of the views.

    Only of views that see it. A picture of one colour there does not, where others do: a covered
    lens is no evidence that nothing is there. Raises LocalizationError where none sees it.
    """
    seen = regions_before(evidence.cameras, settings, model.radius, evidence.header.frame_id)
    blank = _blank(evidence, seen, model.radius)
    return {number: region for number, region in seen.items() if number not in blank}


def silent_views(evidence: ViewsEvidence, model: ObjectModel, settings: PmclSettings
                 ) -> dict[int, str]:
    """Why the other views say nothing, by their numbers. Raises as `regions_seen`."""
    seen = regions_before(evidence.cameras, settings, model.radius, evidence.header.frame_id)
    reasons = out_of_view(evidence.cameras, settings, model.radius)
    for number in _blank(evidence, seen, model.radius):
        view = evidence.views[number].view
        reasons[number] = 'its picture is of one colour where the region is' + (
            f' ({view.name})' if view is not None and view.name else '')
    return dict(sorted(reasons.items()))


def _blank(evidence: ViewsEvidence, seen: dict[int, Region], radius: float) -> list[int]:
    """The views whose pictures are of one colour in their regions; empty where all are."""
    blank = []
    for number, region in seen.items():
        view, pinhole = evidence.views[number].view, evidence.views[number].evidence.pinhole
        if view is not None and _is_blank(view, pinhole, region.window(pinhole, radius)):
            blank.append(number)
    return blank if len(blank) < len(seen) else []


def _is_blank(view: PosedView, pinhole: Pinhole, window: Window) -> bool:
    """Whether a view's picture is of one colour in a window of another size of it, or a crop."""
    ends = np.array([[window.left, window.top], np.add((window.left, window.top), window.size)])
    scale = np.array([view.pinhole.fx / pinhole.fx, view.pinhole.fy / pinhole.fy])
    (left, top), (right, bottom) = np.rint(
        scale * (ends - 0.5 - (pinhole.cx, pinhole.cy))
        + (view.pinhole.cx + 0.5, view.pinhole.cy + 0.5)).astype(int).clip(0).tolist()
    return view.is_of_one_colour(left, top, right - left, bottom - top)
