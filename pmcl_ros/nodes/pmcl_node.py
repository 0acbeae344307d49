"""Evidence or PosedViews -> PoseEstimate: looks for one object, or several, in each capture."""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image
from visualization_msgs.msg import Marker, MarkerArray

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.drawing.pictures import overlay
from pmcl_ros.drawing.view_overlay import overlay_in_view
from pmcl_ros.evidence.build_views import ViewsEvidenceBuilder
from pmcl_ros.evidence.contour_net import contour_net
from pmcl_ros.evidence.edges import EdgeVolume, edges_from_likelihood
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.marker import mesh_to_marker, no_markers, place_markers, region_to_marker
from pmcl_ros.messages.pose import estimate_to_messages
from pmcl_ros.nodes.evidence_input import ENDED, EvidenceInput
from pmcl_ros.nodes.optional_outputs import OptionalOutputs
from pmcl_ros.nodes.pmcl_outputs import ObjectFrame, ObjectList, Overlays, SeveralObjects
from pmcl_ros.nodes.pmcl_settings import PmclNodeSettings
from pmcl_ros.nodes.posed_views_input import PosedViewsInput
from pmcl_ros.nodes.posed_views_outputs import PosedViewsOutputs
from pmcl_ros.nodes.runtime.base import MANY, SMALL, StageNode
from pmcl_ros.nodes.runtime.pose_source import PoseNames, pose_source
from pmcl_ros.nodes.runtime.running import run
from pmcl_ros.nodes.runtime.worker import Worker
from pmcl_ros.nodes.transport.losses import MissingCaptures
from pmcl_ros.pipeline import (
    AnyLocalizer,
    Evidence,
    binned_to_draw,
    cameras_of,
    make_localizer,
    size_in,
)
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_object.scene_estimate import SceneEstimate
from pmcl_ros.pmcl.multi_view.incremental_search import IncrementalSearch
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.multi_view.next_view import position_sigma
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Box, with_region
from pmcl_ros.pmcl.render.sunken import as_it_appears
from pmcl_ros.pmcl.tracking.continuity import Continuity
from pmcl_ros.pmcl.tracking.tracker import PREDICTED, Tracker
from pmcl_ros.runtime.errors import LocalizationError, PoseUnavailableError
from pmcl_ros.runtime.resources import resolve

_CAMERA = PoseNames('track_camera', 'camera_pose', 'track_frame', 'track_max_age')


class PmclNode(StageNode):
    """Publishes the pose of the object in each capture once, or says that it is lost.

    A search takes seconds: it runs on a thread of its own, which owns the GL context, so that the
    node answers meanwhile. One capture may wait, the newest. With `tracking` each search starts
    from the last pose found; with tracking none the tracker only searches.
    """

    name = 'pmcl_node'
    settings_class = PmclNodeSettings

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._in_scene: dict[str, Header] = {}  # of MoveIt, in which objects stay

    def set_up(self, settings: PmclNodeSettings) -> None:
        """Load the objects and make what searches for them, with a GL context if it needs one."""
        self._settings = settings
        self._overlays = Overlays(self)
        self._markers = self.publisher(MarkerArray, 'markers', SMALL)
        self._camera_poses = (
            pose_source(self, _CAMERA, settings.track_camera, settings.track_frame, MANY)
            if settings.tracking == 'camera' else None)
        self._several: SeveralObjects | None = None
        self._posed = settings.source == 'posed_views'
        if self._posed and settings.evidence != 'edges':
            contour_net()  # a broken file is an error here, not at the first views
        self._tracker: Tracker | None = None
        self._incremental: IncrementalSearch | None = None
        if settings.several:
            paths = [resolve(each, 'objects') for each in settings.several]
            self._several = SeveralObjects(self, settings, paths, settings.broadcast_tf,
                                           self._overlays, self._markers)
            self._work(partial(self._several.localizer, self._posed),
                       ', '.join(self._several.names))
            names, models = self._several.names, self._several.models
            self._continuities = [Continuity(each.symmetry, _region(settings)) for each in models]
            self._evidence_of = _evidence_of(settings, max(models, key=lambda each: each.radius))
        else:
            self._set_up_one(settings)
            names, models = [self._model.name], [self._model]
        self._optional = OptionalOutputs(self, settings, names, models, self._in_scene)
        self._of_views = PosedViewsOutputs(self, self._posed, settings)

    def _set_up_one(self, settings: PmclNodeSettings) -> None:
        path = resolve(settings.object, 'object')
        self._model = ObjectModel.load(path)
        self.object_frame = (ObjectFrame(self, settings.object_frame or self._model.name)
                             if settings.broadcast_tf else None)
        self._use(settings, self._work(
            partial(make_localizer, self._model, settings, self._posed), self._model.name))
        self._poses = [self.publisher(PoseStamped, 'pose', SMALL),
                       self.publisher(PoseWithCovarianceStamped, 'pose_with_covariance', SMALL),
                       self.publisher(PoseArray, 'particles', SMALL)]
        self._list = ObjectList(self, [path])
        self._marker: Marker | None = None  # made when somebody wants it

    def _use(self, settings: PmclNodeSettings, localizer: AnyLocalizer[PoseEstimate]) -> None:
        """Search with a localizer of one object, in the region that the settings say."""
        self._box = region_to_marker(_region(settings))
        self._continuities = [Continuity(self._model.symmetry, _region(settings))]
        self._evidence_of = _evidence_of(settings, self._model)
        self._incremental = None
        if isinstance(localizer, MultiViewLocalizer):
            self._incremental = IncrementalSearch(localizer)
            self._tracker = Tracker(self._incremental, self._model, settings)
        elif isinstance(localizer, Localizer):
            self._tracker = Tracker(localizer, self._model, settings)

    def _work(self, make: Callable[[], Any], sought: str) -> Any:
        """A thread for what searches, which is made on it."""
        self._worker: Worker[Any] = Worker(make)
        self.configured.callback(self._worker.close)
        self.health.back_end = self._worker.owned.renderer
        self.get_logger().info(f'looks for {sought} with {self.health.back_end}')
        return self._worker.owned

    def start(self) -> None:
        """Listen."""
        self._searches = 0
        self._forget()
        self._worker.resume()
        self.active.callback(self.publish_last, self._markers, no_markers())
        self.active.callback(self._stop)
        if self._camera_poses is not None:
            self._camera_poses.start()
        self._input: EvidenceInput | None = None
        if self._posed:
            PosedViewsInput(self, self._on_evidence)
        else:
            self.subscribe(CameraInfo, 'center/camera_info', self._on_camera, SMALL)
            self.subscribe(Image, 'center/image', self._overlays.on_picture, SMALL)
            self._input = EvidenceInput(self, self._settings, self._on_evidence,
                                        both=self._settings.searches_again)
        self.serve('~/localize', self._again)
        self.serve('~/reset', self._reset)
        self._of_views.start()

    def _forget(self) -> None:
        if self._tracker is not None:
            self._tracker.reset()
        if self._incremental is not None:
            self._incremental.reset()
        for each in self._continuities:
            each.reset()
        for frame in self._several.frames if self._several else [self.object_frame]:
            if frame is not None:
                frame.forget()
        self._overlays.forget()
        self._of_views.forget()
        self._random = np.random.default_rng(self._settings.seed)
        self._last: Evidence | PosedViews | None = None
        self._missing = MissingCaptures()
        self._is_placed = not self._settings.region_in_view

    # in

    def _on_camera(self, message: CameraInfo) -> None:
        self._overlays.on_camera(message)
        self._missing.announce(header_from(message.header).stamp_ns)

    def _on_evidence(self, evidence: Evidence | PosedViews) -> None:
        self.health.frames_in += 1
        for stamp in self._missing.arrived(evidence.header.stamp_ns):
            self.health.count('captures without evidence')  # dropped before this node
            self.get_logger().warning(
                f'no evidence came of capture {stamp}: the log of this node, or of one before it, '
                'says why, unless that one was killed')
        if isinstance(evidence, PosedViews):
            self._of_views.on_views(evidence)
        self._search(evidence)

    def _again(self) -> str:
        if self._last is None:
            raise LocalizationError('no evidence has come since the node was activated or reset')
        self._search(self._last)
        return f'searching in capture {self._last.header.stamp_ns} again'

    def _stop(self) -> None:
        if self._input is not None:
            self._input.wait_no_more()
        waited = self._worker.stop()
        if waited is not None:
            self.dropped(f'capture {waited.args[0].header.stamp_ns}: {ENDED}')

    def _reset(self) -> str:
        self._stop()
        self._forget()
        self._optional.clear()
        if self._input is not None:
            self._input.forget()
        self._worker.resume()
        return f'the next capture is searched as the first, with seed {self._settings.seed}'

    def _search(self, evidence: Evidence | PosedViews) -> None:
        self._last = evidence
        replaced = self._worker.offer(partial(self._localize, evidence, time.monotonic(),
                                              self._camera_at(evidence)))
        if replaced is not None:
            self.dropped(f'capture {replaced.args[0].header.stamp_ns}: a newer one came before '
                         'it was searched')

    def _camera_at(self, evidence: Evidence | PosedViews) -> NDArray[np.float64] | None:
        if self._camera_poses is None:
            return None
        try:
            return self._camera_poses.nearest(evidence.header.stamp_ns, evidence.header.frame_id,
                                              self._settings.track_max_age)
        except PoseUnavailableError as error:
            self.get_logger().warning(str(error))
            return None

    # on the worker's thread

    def _localize(self, given: Evidence | PosedViews, began: float,
                  camera: NDArray[np.float64] | None,
                  localizer: AnyLocalizer[PoseEstimate] | AnyLocalizer[SceneEstimate]) -> None:
        def progress(_: float) -> bool:
            return not self._worker.stopping

        with self.watched('search'):
            if not self._is_placed:
                localizer = self._placed(given)
            evidence = (self._evidence_of(given) if isinstance(given, PosedViews)
                        else given)
            if self._settings.mode != 'faithful' and isinstance(evidence, DepthLikelihoodVolume):
                evidence = edges_from_likelihood(evidence)
            found: PoseEstimate | SceneEstimate
            if self._tracker is not None and isinstance(evidence, EdgeVolume | ViewsEvidence):
                found = self._tracker.track(evidence, self._random, progress, camera)
            else:
                found = localizer.localize(evidence, self._random, progress)
            latency = time.monotonic() - began
            if self._worker.stopping:
                self.dropped(f'capture {evidence.header.stamp_ns}: {ENDED}')
            elif isinstance(found, PoseEstimate):
                found = self._continuities[0].follow(found, camera)
                if isinstance(evidence, ViewsEvidence):
                    self._of_views.on_estimate(evidence, found, self._model)
                self._publish(found, given, latency, self._next_search(given))
                self._optional.publish([found], camera)
                self._of_views.publish_chart()  # after the pose, which does not wait for it
            elif self._several is not None:
                found = replace(found, estimates=tuple(
                    one.follow(each, camera) for one, each
                    in zip(self._continuities, found.estimates, strict=True)))
                if isinstance(evidence, ViewsEvidence):
                    self._of_views.on_estimate(evidence, *found.least_sure(self._several.models))
                self._several.publish(found, given, latency, self._next_search(given))
                self._optional.publish(found.estimates)
                self._of_views.publish_chart()

    def _next_search(self, given: Evidence | PosedViews) -> dict[str, object]:
        """What tells a search from all others on /diagnostics."""
        self._searches += 1
        return {'capture': given.header.stamp_ns, 'search': self._searches}

    def _placed(self, given: Evidence | PosedViews) -> AnyLocalizer[PoseEstimate]:
        """What searches the region that follows from the cameras of the first capture."""
        settings = with_region(self._settings, cameras_of(given), self._model.radius)
        self.get_logger().info(f'region of interest: roi_center {settings.roi_center}, roi_size '
                               f'{settings.roi_size}')
        self._worker.owned.close()
        self._worker.owned = localizer = make_localizer(self._model, settings, self._posed)
        self._use(settings, localizer)
        self._of_views.settings = settings
        self._is_placed = True
        return localizer

    # out

    def _publish(self, estimate: PoseEstimate, given: Evidence | PosedViews, latency: float,
                 search: dict[str, object]) -> None:
        name, what = self._model.name, f'capture {estimate.header.stamp_ns}'
        if isinstance(given, PosedViews):
            what = f'{len(given.views)} views, {what}'
        values = search | {'object': name} | estimate.diagnostics()
        if self._settings.tracking != 'none' or self._posed:
            sigma = position_sigma(estimate.covariance)
            values['standard deviation [mm]'] = f'{1e3 * sigma:.1f}'
        if self.object_frame is not None:
            self.object_frame.broadcast(estimate)
        if estimate.lost:
            self.health.count('lost')
            x, y, z = estimate.pose[:3, 3]
            predicted = (f'; predicted at ({x:.3f}, {y:.3f}, {z:.3f}) m'
                         if estimate.mode == PREDICTED else '')
            text = f'lost: no {name} in {what}{predicted}'
            self.get_logger().warning(text)
            with self.health.lock:
                self.health.warn(text)
                self.health.extra = values
        else:
            messages = estimate_to_messages(estimate)
            for publisher, message in zip(self._poses, messages, strict=True):
                publisher.publish(message)
            if isinstance(given, PosedViews):
                self._overlays.publish_views(given, lambda view: overlay_in_view(
                    view, self._model, estimate.pose, self._settings.interface))
            else:
                self._overlays.publish(
                    estimate.header, given.pinhole, lambda picture, camera:
                    overlay(picture, camera, as_it_appears(
                        self._model, estimate.pose, self._settings.interface), estimate.pose))
            with self.health.lock:
                self.done(latency, f'found {name} in {what}')
                self.health.extra = values
        self._list.publish([name], [estimate])
        if self._markers.get_subscription_count():
            self._marker = self._marker or mesh_to_marker(self._model)
            self._markers.publish(place_markers(self._marker, self._box, estimate))
        self.publish_diagnostics()


def _region(settings: PmclNodeSettings) -> Box:
    return Box(settings.roi_center, settings.roi_size)


def _evidence_of(settings: PmclNodeSettings, model: ObjectModel
                 ) -> Callable[[PosedViews], ViewsEvidence]:
    """What makes the evidence of posed views. model: of the largest object."""
    of_views = DlvSettings()
    builder = ViewsEvidenceBuilder(of_views, settings.evidence != 'edges',
                                   size_in(model, settings))
    return lambda views: builder.build(binned_to_draw(views, of_views, settings, model.radius))


def main() -> int:
    """Entry point."""
    return run(PmclNode)


if __name__ == '__main__':
    sys.exit(main())
