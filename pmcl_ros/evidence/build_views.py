"""PosedViews -> ViewsEvidence, as views come."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evidence.binning import binned_to_fit
from pmcl_ros.evidence.build_map import build_map
from pmcl_ros.evidence.edges import view_edges
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.posed_evidence import PosedEvidence, ViewsEvidence
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews


class ViewsEvidenceBuilder:
    """Makes the evidence of some views. A picture that came before, or the last time, is not read
    again: the last views are held.

    contour_maps: whether it is contour maps, else edges. settings: as of `build_map`. size_in: how
    large the object is in a view [px], as of `build_map`.
    """

    def __init__(self, settings: DlvSettings, contour_maps: bool = True,
                 size_in: Callable[[PosedView], float] = lambda _: 0.0) -> None:
        self._settings, self._contour_maps, self._size_in = settings, contour_maps, size_in
        self._kept: list[tuple[PosedView, EvidenceVolume]] = []  # of the last views

    def build(self, views: PosedViews) -> ViewsEvidence:
        """The evidence of each view, `binned_to_fit`. Raises as `build_map`."""
        views = binned_to_fit(views, self._settings)
        made: list[tuple[PosedView, EvidenceVolume]] = []
        for each in views.views:
            made.append((each, _of_same_picture(each, made + self._kept) or self._build(each)))
        self._kept = made
        return ViewsEvidence(views.header, tuple(
            PosedEvidence(evidence, each.camera_to_reference, each.sigma, each.group, each.common,
                          each.drift, each) for each, evidence in made))

    def _build(self, view: PosedView) -> EvidenceVolume:
        if self._contour_maps:
            return build_map(view, self._settings, size=self._size_in(view))
        return view_edges(view, self._settings)


def _of_same_picture(view: PosedView, kept: Iterable[tuple[PosedView, EvidenceVolume]]
                     ) -> EvidenceVolume | None:
    """The evidence of the view, among others, of this picture by this camera."""
    return next((evidence for other, evidence in kept if other.pinhole == view.pinhole
                 and _same(other.picture, view.picture) and _same_mask(other, view)), None)


def _same(one: NDArray[np.float32], other: NDArray[np.float32]) -> bool:
    """Whether pictures are; most that are not differ in some of their pixels already."""
    some = slice(None, None, 16)
    return np.array_equal(one[some, some], other[some, some]) and np.array_equal(one, other)


def _same_mask(one: PosedView, other: PosedView) -> bool:
    if one.mask is None or other.mask is None:
        return one.mask is other.mask
    return np.array_equal(one.mask, other.mask)
