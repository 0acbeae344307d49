"""Localises one object and keeps every intermediate result, for the report."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.lightfield.readers.read import Source
from pmcl_ros.pipeline import Pipeline
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.history import Generation
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_view.joint_evidence import regions_seen
from pmcl_ros.pmcl.multi_view.next_view import CANDIDATES, CAP, NextView, cap, next_views
from pmcl_ros.pmcl.multi_view.view_by_view import sigmas_by_views
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.second_search import evidence_of
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.progress import StageProgress


@dataclass(frozen=True)
class Localization:
    """The search for one object in one capture: a light field, a picture, or several views.

    Of several views source, estimate, region and truth are of the first that sees the region, in
    the frame of its camera. views: all of them, each with the pose (4, 4) of the object before it;
    in_reference: the estimate in their frame. volume: None where one picture alone shows the
    region; of several views in the frame of a camera of its own (`before`). history: the search's
    generations.
    contour: of the estimate; None in the mode faithful, and of several views.
    seconds: wall time of each stage, in their order; those of the search by their names [s].
    renderer: the back end that scored poses.
    name: of the picture, in words. serial: of the camera, empty if unknown.
    truth: None if unknown.
    sigmas: as of `sigmas_by_views`, next_views: of candidates on a cap; of several views that show
    the object.
    """

    source: LightField | PosedView
    model: ObjectModel
    volume_settings: DlvSettings
    settings: PmclSettings
    volume: DepthLikelihoodVolume | None
    estimate: PoseEstimate
    history: tuple[Generation, ...]
    contour: ContourPoints | None
    seconds: dict[str, float]
    renderer: str
    name: str = ''
    serial: str = ''
    truth: Truth | None = None
    region: Region = field(kw_only=True)
    in_reference: PoseEstimate = field(kw_only=True)
    views: tuple[tuple[PosedView, NDArray[np.float64]], ...] = ()
    sigmas: NDArray[np.float64] | None = None
    next_views: tuple[NextView, ...] = ()

    @property
    def cameras(self) -> list[NDArray[np.float64]]:
        """(4, 4) each, of several views, to their reference frame."""
        return [view.camera_to_reference for view, _ in self.views]

    def before(self, volume: DepthLikelihoodVolume) -> tuple[NDArray[np.float64], Region]:
        """The estimated pose (4, 4) and the region in the frame of the volume's camera."""
        if volume.camera is None:
            return self.estimate.pose, self.region
        camera = volume.camera.camera_to_reference
        return (np.asarray(np.linalg.inv(camera) @ self.in_reference.pose),
                Region.before_camera(camera, self.settings.roi_center, self.settings.roi_size))


def localize(read: Callable[[], Source], model: ObjectModel, settings: PmclSettings,
             progress: StageProgress, name: str = '', serial: str = '',
             truth: Truth | None = None, posed: bool = False) -> Localization:
    """Find the object in the source that `read` makes; keep all intermediate results.

    The pose is that of `pmcl localize` with the same settings. posed: of several views. Raises
    what the stages raise.
    """
    history: list[Generation] = []
    with Pipeline.for_object(model, settings, posed=posed) as pipeline:
        run = pipeline.run(read, np.random.default_rng(settings.seed), progress, history.append,
                           with_volume=True)
        ended = time.perf_counter()
        localizer, evidence = pipeline.localizer, run.evidence
        contour = (localizer.contour(evidence_of(run.estimate, evidence), run.estimate.pose)
                   if isinstance(localizer, Localizer) and isinstance(evidence, EvidenceVolume)
                   else None)
    seconds = dict(run.seconds)
    seconds |= _stages(ended - seconds.pop('pose'), history, ended)
    source, estimate = run.source, run.estimate
    views: tuple[tuple[PosedView, NDArray[np.float64]], ...] = ()
    sigmas: NDArray[np.float64] | None = None
    candidates: list[NextView] = []
    if isinstance(source, PosedViews):
        assert isinstance(run.evidence, ViewsEvidence)
        seen = regions_seen(run.evidence, model, settings)
        number = min(set(seen) - set(estimate.hidden))
        poses = [np.asarray(np.linalg.inv(each.camera_to_reference), float)
                 for each in source.views]
        views = tuple((view, into @ estimate.pose)
                      for view, into in zip(source.views, poses, strict=True))
        if not estimate.lost:
            showing = estimate.found_in(run.evidence)
            sigmas = sigmas_by_views(showing, model, settings, estimate.pose)
            cameras = [each.camera_to_reference for each in source.views]
            candidates = next_views(showing, model, settings, estimate.pose,
                                    cap(estimate.pose, cameras, CAP, CANDIDATES),
                                    source.views[0].pinhole)
        source, region, into = source.views[number], seen[number], poses[number]
        estimate = estimate.in_frame(into)
        truth = None if truth is None else replace(truth, pose=into @ truth.pose)
    else:
        region = Region(settings.roi_center, settings.roi_size)
    return Localization(source, model, run.settings, settings, run.volume, estimate,
                        tuple(history), contour, seconds, localizer.renderer, name, serial,
                        truth, region=region, in_reference=run.estimate, views=views,
                        sigmas=sigmas, next_views=tuple(candidates))


def _stages(begin: float, history: list[Generation], end: float) -> dict[str, float]:
    """How long each stage of the search took, and what came after them ('estimate'), [s]."""
    seconds: dict[str, float] = {}
    for each in history:
        seconds[each.stage] = seconds.get(each.stage, 0.0) + each.time - begin
        begin = each.time
    return seconds | {'estimate': end - begin}
