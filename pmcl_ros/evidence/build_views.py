"""PosedViews -> ViewsEvidence, as views come."""

import hashlib
from collections.abc import Callable

import numpy as np

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evidence.binning import binned_to_fit
from pmcl_ros.evidence.build_map import build_map
from pmcl_ros.evidence.edges import view_edges
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.posed_evidence import PosedEvidence, ViewsEvidence
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews


class ViewsEvidenceBuilder:
    """Makes the evidence of some views. Pictures that came the last time are not read again.

    contour_maps: whether it is contour maps, else edges. settings: as of `build_map`. size_in: how
    large the object is in a view [px], as of `build_map`.
    """

    def __init__(self, settings: DlvSettings, contour_maps: bool = True,
                 size_in: Callable[[PosedView], float] = lambda _: 0.0) -> None:
        self._settings, self._contour_maps, self._size_in = settings, contour_maps, size_in
        self._kept: dict[bytes, EvidenceVolume] = {}  # of the last views, by their pictures

    def build(self, views: PosedViews) -> ViewsEvidence:
        """The evidence of each view, `binned_to_fit`. Raises as `build_map`."""
        views = binned_to_fit(views, self._settings)
        keys = [_key(each) for each in views.views]
        self._kept = {key: self._kept.get(key) or self._build(view)
                      for key, view in zip(keys, views.views, strict=True)}
        return ViewsEvidence(views.header, tuple(
            PosedEvidence(self._kept[key], each.camera_to_reference, each.sigma, each.group,
                          each.common, each) for key, each in zip(keys, views.views, strict=True)))

    def _build(self, view: PosedView) -> EvidenceVolume:
        if self._contour_maps:
            return build_map(view, self._settings, size=self._size_in(view))
        return view_edges(view, self._settings)


def _key(view: PosedView) -> bytes:
    found = hashlib.blake2b(np.ascontiguousarray(view.picture).data)
    found.update(repr(view.pinhole).encode())
    return found.digest()
