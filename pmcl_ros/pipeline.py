"""Source -> evidence -> pose in one process, for commands and studies.

    with Pipeline.for_object(model, settings) as pipeline:
        run = pipeline.run(lambda: read_source(path), np.random.default_rng(settings.seed))
    print(run.estimate.describe())

The source is a LightField, a PosedView of an ordinary camera, or several of these in one frame,
PosedViews.
The evidence is an EdgeVolume or a ContourMap, which the contour search reads; of several views
one each, ViewsEvidence; or in the mode faithful the DepthLikelihoodVolume, which the paper's
particle filter reads. The nodes call the same stages themselves; of this module they use what
makes localizers.
"""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Generic, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.settings import MOST_LABELS, DlvSettings, within_limits
from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evidence.binning import binned_to_fit, drawable
from pmcl_ros.evidence.build_map import build_map, warn_of_one_colour
from pmcl_ros.evidence.build_views import ViewsEvidenceBuilder
from pmcl_ros.evidence.edges import build_edges, view_edges
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.lightfield.readers.read import Source
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.history import Watch
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_object.posed_scene import PosedSceneLocalizer
from pmcl_ros.pmcl.multi_object.scene_estimate import SceneEstimate
from pmcl_ros.pmcl.multi_object.scene_localizer import SceneLocalizer
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.multi_view.region_volume import region_volume
from pmcl_ros.pmcl.multi_view.view_warnings import warn_of_pictures
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.particle_filter import ParticleFilterLocalizer
from pmcl_ros.pmcl.prior.odd_poses import check_poses, check_size
from pmcl_ros.pmcl.prior.region import Region, size_in_view, windows_before
from pmcl_ros.pmcl.render.raster import LARGEST
from pmcl_ros.pmcl.render.scene import Window
from pmcl_ros.pmcl.settings import EvidenceKind, Mode, PmclSettings
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.errors import VolumeError
from pmcl_ros.runtime.progress import StageProgress

_LOG = logging.getLogger(__name__)
Evidence = EvidenceVolume | ViewsEvidence | DepthLikelihoodVolume
Estimate = TypeVar('Estimate')  # PoseEstimate, or SceneEstimate of several objects
Given = TypeVar('Given', bound=Source)
Found = TypeVar('Found', covariant=True)  # the same


class AnyLocalizer(Protocol[Found]):
    """Finds an object, or several, in the evidence of a capture (`Localizer.localize`)."""

    @property
    def renderer(self) -> str:
        """What draws and scores poses."""
        ...

    @property
    def localize(self) -> Callable[..., Found]:
        """Evidence, random numbers, progress -> estimate."""
        ...

    def close(self) -> None:
        """Release the GL context, if there is one."""
        ...


def make_localizer(model: ObjectModel, settings: PmclSettings, posed: bool = False
                   ) -> Localizer | ParticleFilterLocalizer | MultiViewLocalizer:
    """What finds one object in the settings' mode; use and close it in the calling thread.

    posed: in `PosedViews`; the region of interest is then in their reference frame.
    """
    if posed:
        return MultiViewLocalizer(model, settings)
    if settings.mode == 'faithful':
        return ParticleFilterLocalizer(model, settings)
    return Localizer(model, settings)


def make_scene_localizer(models: Sequence[ObjectModel], settings: PmclSettings,
                         posed: bool = False) -> AnyLocalizer[SceneEstimate]:
    """What finds several objects together, likewise. Raises as `SceneLocalizer`."""
    return (PosedSceneLocalizer(models, settings) if posed
            else SceneLocalizer(models, settings))


def check_mode(mode: Mode, pictures: bool) -> None:
    """Raise VolumeError where a mode needs a light field, and the source is pictures."""
    if mode == 'faithful' and pictures:
        raise VolumeError('the mode faithful needs a light field, not pictures; choose the mode '
                          'default')


def build_evidence(source: Source, settings: DlvSettings, mode: Mode,
                   kind: EvidenceKind = 'edges',
                   size_in: Callable[[PosedView], float] = lambda _: 0.0) -> Evidence:
    """What the localizer of a mode reads of a capture, `binned_to_fit`.

    kind: as of `evidence_kind`. size_in: how large the object is in an ordinary picture, as of
    `build_map`.
    Raises VolumeError, RenderError, PictureError, SettingsError without the map's network.
    """
    check_mode(mode, not isinstance(source, LightField))
    if mode == 'faithful':
        assert isinstance(source, LightField)  # as was checked
        return build_volume(source, settings)
    source = binned_to_fit(source, settings)
    if isinstance(source, PosedViews):
        return ViewsEvidenceBuilder(settings, kind == 'map', size_in).build(source)
    if isinstance(source, PosedView):
        return (build_map(source, settings, size=size_in(source)) if kind == 'map'
                else view_edges(source, settings))
    if kind == 'map':
        found: Evidence = build_map(source, settings)
    else:
        edges = build_edges(source, settings)
        found = (replace(edges, other=partial(build_map, source, settings)) if kind == 'auto'
                 else edges)
    warn_of_one_colour(source)
    return found


def apparent_size(model: ObjectModel, settings: PmclSettings) -> Callable[[PosedView], float]:
    """How large an object in the middle of the region of interest is in a picture [px]."""
    return lambda view: size_in_view(model.diameter, settings.roi_center, view.pinhole,
                                     view.camera_to_reference)


def windows_of(source: Source, settings: PmclSettings, radius: float) -> dict[int, Window]:
    """What the object can cover of each picture that sees the region of interest, by its number.

    radius: of the object [m]. Raises LocalizationError where none does, or where few do, or from
    too far, by what seems a mistake in the poses of the cameras.
    """
    if not isinstance(source, PosedViews):
        region = Region(settings.roi_center, settings.roi_size)
        return {0: region.window(source.pinhole, radius)}
    cameras = source.cameras
    windows = windows_before(cameras, settings, radius, source.header.frame_id)
    check_poses(cameras, settings.roi_center, len(windows))
    check_size(max(size_in_view(2 * radius, settings.roi_center, *each) for each in cameras))
    return windows


def binned_to_draw(source: Given, settings: DlvSettings, search: PmclSettings, radius: float
                   ) -> Given:
    """`binned_to_fit`, and so that the processor can draw what the object can cover of a picture.

    search: with the region of interest. radius: of the object [m]. Raises LocalizationError where
    no picture sees the region.
    """
    source = binned_to_fit(source, settings)
    if any(settings.crop) or isinstance(source, LightField):
        return source
    sides = {number: max(window.size)
             for number, window in windows_of(source, search, radius).items()}
    if isinstance(source, PosedView):
        return cast(Given, drawable(source, sides[0], LARGEST))
    return replace(source, views=tuple(drawable(each, sides.get(number, 0), LARGEST)
                                       for number, each in enumerate(source.views)))


def evidence_kind(settings: PmclSettings, source: Source) -> EvidenceKind:
    """The kind that was chosen; by default the map of pictures.

    Of a light field it stays auto: edges, and where these lose the object or are unsure, the map.
    """
    if settings.evidence != 'auto' or isinstance(source, LightField):
        return settings.evidence
    if settings.mode == 'faithful':
        return 'edges'
    _LOG.info('evidence map: poses are found in pictures by contour maps')
    return 'map'


def cameras_of(given: Source | Evidence) -> list[tuple[Pinhole, NDArray[np.float64]]]:
    """The cameras that took a source or its evidence, with poses (4, 4) in its reference frame."""
    if isinstance(given, PosedViews | ViewsEvidence):
        return given.cameras
    pinhole = given.grid.pinhole if isinstance(given, LightField) else given.pinhole
    return [(pinhole, np.eye(4))]


def depths_of(center: tuple[float, float, float], size: tuple[float, float, float],
              radius: float, posed: bool) -> tuple[float, float]:
    """Depths that can hold a part of an object of this radius whose origin is in a box [m].

    posed: of several views, whose evidence does not depend on them: any.
    """
    if posed:
        default = DlvSettings()
        return default.near, default.far
    return Region(center, size).grown(radius)


def volume_settings(mode: Mode, near: float, far: float, grid: ViewGrid | None,
                    changes: Mapping[str, Any] | None = None, origin: str = 'region of interest'
                    ) -> DlvSettings:
    """The settings of evidence and volume for depths `near` to `far` [m].

    In the mode faithful those of the paper: views shifted by phase, truncated, not weighted. There
    are as many labels as by default, or more where the views are farther apart, `MOST_LABELS` at
    most.
    grid: None: a single picture, whose labels nobody sets.
    changes: values that are wanted otherwise. origin: of them, for errors (SettingsError).
    """
    values: dict[str, Any] = within_limits(near, far)
    if grid is not None:
        made = DlvSettings.make(values | dict(changes or {}), origin)
        pairs = StereoPairs.from_grid(grid, made.views)
        needed = min(pairs.labels_needed(made.near, made.far), MOST_LABELS)
        default = DlvSettings()
        values |= {'labels': max(default.labels, needed),
                   'edge_labels': max(default.edge_labels, needed)}
    if mode == 'faithful':
        values |= {'interpolation': 'phase', 'truncate': True, 'view_weights': 'equal'}
    return DlvSettings.make(values | dict(changes or {}), origin)


@dataclass(frozen=True)
class Run(Generic[Estimate]):
    """One capture's way through the pipeline.

    source: in which the pose was searched: large pictures are `binned_to_draw`.
    settings: of evidence and volume. volume: None where nothing asked for it, or where one
    picture alone shows the region.
    seconds: wall time of the stages 'views', 'evidence', 'volume' if made, 'pose' [s].
    """

    source: Source
    settings: DlvSettings
    evidence: Evidence
    volume: DepthLikelihoodVolume | None
    estimate: Estimate
    seconds: dict[str, float]


class Pipeline(Closing, Generic[Estimate]):
    """Finds an object, or several, in light fields or pictures; use and close it in one thread.

    localizer: closed with this. model: of the largest object. posed: whether it is looked for in
    `PosedViews`.
    settings: region, mode and kind of the evidence. changes: parameters of evidence and volume
    that differ from `volume_settings`; origin: where they are from, for errors.
    """

    def __init__(self, localizer: AnyLocalizer[Estimate], model: ObjectModel,
                 settings: PmclSettings, posed: bool, changes: Mapping[str, Any] | None,
                 origin: str) -> None:
        self.localizer, self._model, self._settings = localizer, model, settings
        self._depths = depths_of(settings.roi_center, settings.roi_size, model.radius, posed)
        self._changes, self._origin = changes, origin

    @classmethod
    def for_object(cls, model: ObjectModel, settings: PmclSettings,
                   changes: Mapping[str, Any] | None = None, origin: str = 'region of interest',
                   posed: bool = False) -> 'Pipeline[PoseEstimate]':
        """One object. posed: as of `make_localizer`. Raises RenderError, LocalizationError."""
        return Pipeline(make_localizer(model, settings, posed), model, settings, posed, changes,
                        origin)

    @classmethod
    def for_objects(cls, models: Sequence[ObjectModel], settings: PmclSettings,
                    changes: Mapping[str, Any] | None = None, origin: str = 'region of interest',
                    posed: bool = False) -> 'Pipeline[SceneEstimate]':
        """Several objects together. posed: as of `make_localizer`. Raises as `SceneLocalizer`."""
        localizer = make_scene_localizer(models, settings, posed)
        return Pipeline(localizer, max(models, key=lambda each: each.radius), settings, posed,
                        changes, origin)

    def close(self) -> None:
        """Close the localizer."""
        self.localizer.close()

    def settings_for(self, grid: ViewGrid | None) -> DlvSettings:
        """The settings of evidence and volume for views of a grid; None: of a single picture."""
        return volume_settings(self._settings.mode, *self._depths, grid, self._changes,
                               self._origin)

    def run(self, read: Callable[[], Source], rng: np.random.Generator,
            progress: StageProgress = lambda *_: None, watch: Watch | None = None,
            with_volume: bool = False) -> Run[Estimate]:
        """Read a light field or a picture, and find the objects in it.

        watch: as of `Localizer.localize`, for one object. with_volume: make the volume too where
        the mode reads none; of posed views that of the region (`region_volume`). Raises what the
        stages raise.
        """
        seconds: dict[str, float] = {}
        begun = time.perf_counter()

        def finished(stage: str) -> None:
            nonlocal begun
            now = time.perf_counter()
            seconds[stage], begun = now - begun, now

        def show(part: float) -> bool:
            progress('pose', part)
            return True

        progress('views', 0.0)
        source = read()
        # Is it in view at all? Evidence takes time and memory.
        windows_of(source, self._settings, self._model.radius)
        settings = self.settings_for(source.grid if isinstance(source, LightField) else None)
        source = binned_to_draw(source, settings, self._settings, self._model.radius)
        kind: EvidenceKind = ('edges' if isinstance(self.localizer, SceneLocalizer)
                              else evidence_kind(self._settings, source))
        finished('views')
        progress('evidence', 0.0)
        evidence = build_evidence(source, settings, self._settings.mode, kind,
                                  apparent_size(self._model, self._settings))
        finished('evidence')
        volume = evidence if isinstance(evidence, DepthLikelihoodVolume) else None
        if with_volume and volume is None and isinstance(source, LightField):
            progress('volume', 0.0)
            volume = build_volume(source, settings)
            finished('volume')
        elif with_volume and isinstance(evidence, ViewsEvidence):
            progress('volume', 0.0)
            made = region_volume(evidence, self._model, self._settings, self._changes,
                                 self._origin)
            volume, settings = made or (None, settings)
            finished('volume')
        progress('pose', 0.0)
        options = {} if watch is None else {'watch': watch}
        estimate = self.localizer.localize(evidence, rng, show, **options)
        finished('pose')
        if (isinstance(source, PosedView) and isinstance(estimate, PoseEstimate)
                and estimate.lost):
            warn_of_pictures((source,), windows_of(source, self._settings, self._model.radius),
                             self._settings.roi_center)
        return Run(source, settings, evidence, volume, estimate, seconds)
