"""Evidence or PosedViews -> PoseEstimate: looks for one object, or several, in each capture."""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image
from visualization_msgs.msg import MarkerArray

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evidence.build_views import ViewsEvidenceBuilder
from pmcl_ros.evidence.contour_net import contour_net
from pmcl_ros.evidence.edges import EdgeVolume, edges_from_likelihood
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.marker import no_markers, region_to_marker
from pmcl_ros.nodes.evidence_input import ENDED, EvidenceInput
from pmcl_ros.nodes.pmcl_outputs.objects import OneObject, SeveralObjects
from pmcl_ros.nodes.pmcl_outputs.optional_outputs import OptionalOutputs
from pmcl_ros.nodes.pmcl_outputs.overlays import Overlays
from pmcl_ros.nodes.pmcl_outputs.posed_views_outputs import PosedViewsOutputs
from pmcl_ros.nodes.pmcl_settings import PmclNodeSettings
from pmcl_ros.nodes.posed_views_input import subscribe_posed_views
from pmcl_ros.nodes.runtime.awaited_inputs import AwaitedInputs
from pmcl_ros.nodes.runtime.base import SMALL, StageNode
from pmcl_ros.nodes.runtime.pose_source import PoseNames, pose_source
from pmcl_ros.nodes.runtime.running import run
from pmcl_ros.nodes.runtime.worker import Worker
from pmcl_ros.nodes.transport.losses import MissingCaptures
from pmcl_ros.pipeline import (
    AnyLocalizer,
    Evidence,
    apparent_size,
    binned_to_draw,
    cameras_of,
)
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_object.scene_estimate import SceneEstimate
from pmcl_ros.pmcl.multi_view.incremental_search import IncrementalSearch
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Box, with_region
from pmcl_ros.pmcl.tracking.continuity import Continuity
from pmcl_ros.pmcl.tracking.tracker import Tracker
from pmcl_ros.runtime.errors import LocalizationError, PoseUnavailableError

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
        self._posed = settings.source == 'posed_views'
        self._overlays = Overlays(self)
        self._markers = self.publisher(MarkerArray, 'markers', SMALL)
        self._camera_poses = (
            pose_source(self, _CAMERA, settings.track_camera, settings.track_frame)
            if settings.tracking == 'camera' else None)
        if self._posed and settings.evidence != 'edges':
            contour_net()  # a broken file is an error here, not at the first views
        self.objects: OneObject | SeveralObjects = (
            SeveralObjects if settings.several else OneObject)(
                self, settings, self._overlays, self._markers)
        self._worker: Worker[AnyLocalizer[Any]] = Worker(partial(self.objects.localizer, settings))
        self.configured.callback(self._worker.close)
        self.health.back_end = self._worker.owned.renderer
        self.get_logger().info(
            f'looks for {", ".join(self.objects.names)} with {self.health.back_end}')
        self._use(settings)
        self._optional = OptionalOutputs(self, settings, self.objects.names, self.objects.models,
                                         self._in_scene)
        self._of_views = PosedViewsOutputs(self, self._posed, settings)

    def _use(self, settings: PmclNodeSettings) -> None:
        """Search with the worker's localizer, in the region that the settings say."""
        region, models = Box(settings.roi_center, settings.roi_size), self.objects.models
        self.objects.box = region_to_marker(region)
        self._continuities = [Continuity(each.symmetry, region) for each in models]
        self._evidence_of = _evidence_of(settings, max(models, key=lambda each: each.radius))
        self._tracker: Tracker | None = None
        self._incremental: IncrementalSearch | None = None
        localizer = self._worker.owned
        if isinstance(localizer, MultiViewLocalizer):
            self._incremental = IncrementalSearch(localizer)
            self._tracker = Tracker(self._incremental, models[0], settings)
        elif isinstance(localizer, Localizer):
            self._tracker = Tracker(localizer, models[0], settings)

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
            views = subscribe_posed_views(self, self._on_evidence)
            AwaitedInputs(self, lambda: [views])
        else:
            self.subscribe(CameraInfo, 'center/camera_info', self._on_camera, SMALL)
            self.subscribe(Image, 'center/image', self._overlays.on_picture, SMALL)
            self._input = EvidenceInput(self, self._settings, self._on_evidence,
                                        both=self._settings.searches_again)
            AwaitedInputs(self, self._input.ways)
            if self._settings.mode != 'faithful':  # which takes their volume
                self._told_source = False
                self.subscribe(PoseArray, 'posed_views/poses', self._on_excluded, SMALL)
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
        for frame in self.objects.frames:
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

    def _on_excluded(self, _: PoseArray) -> None:
        self.health.count('posed views that source excludes')
        if not self._told_source:
            self._told_source = True
            self.get_logger().warning('posed views have come, which source light_field excludes: '
                                      'set source to posed_views to search in them')

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
                  camera: NDArray[np.float64] | None, _: AnyLocalizer[Any]) -> None:
        with self.watched('search'):
            if not self._is_placed:
                self._place(given)
            evidence = self._evidence_of(given) if isinstance(given, PosedViews) else given
            if self._settings.mode != 'faithful' and isinstance(evidence, DepthLikelihoodVolume):
                evidence = edges_from_likelihood(evidence)
            found = self._find(evidence, camera)
            latency = time.monotonic() - began
            if self._worker.stopping:
                self.dropped(f'capture {evidence.header.stamp_ns}: {ENDED}')
                return
            if isinstance(evidence, ViewsEvidence):
                self._of_views.on_estimate(evidence, *found.least_sure(self.objects.models))
            self._searches += 1
            self.objects.publish(found, given, latency, {'capture': given.header.stamp_ns,
                                                         'search': self._searches})
            self._optional.publish(found.estimates, camera)
            self._of_views.publish_chart()  # after the pose, which does not wait for it

    def _find(self, evidence: Evidence, camera: NDArray[np.float64] | None) -> SceneEstimate:
        """What is found in one capture, by the poses that are nearest to those of the last."""
        def progress(_: float) -> bool:
            return not self._worker.stopping

        found: PoseEstimate | SceneEstimate
        if self._tracker is not None and isinstance(evidence, EdgeVolume | ViewsEvidence):
            found = self._tracker.track(evidence, self._random, progress, camera)
        else:
            found = self._worker.owned.localize(evidence, self._random, progress)
        if isinstance(found, PoseEstimate):
            found = SceneEstimate.of_one(self.objects.names[0], found)
        return replace(found, estimates=tuple(
            one.follow(each, camera) for one, each
            in zip(self._continuities, found.estimates, strict=True)))

    def _place(self, given: Evidence | PosedViews) -> None:
        """Search in the region that follows from the cameras of the first capture."""
        settings = with_region(self._settings, cameras_of(given), self.objects.models[0].radius)
        self.get_logger().info(f'region of interest: roi_center {settings.roi_center}, roi_size '
                               f'{settings.roi_size}')
        self._worker.owned.close()
        self._worker.owned = self.objects.localizer(settings)
        self._use(settings)
        self._of_views.settings = settings
        self._is_placed = True


def _evidence_of(settings: PmclNodeSettings, model: ObjectModel
                 ) -> Callable[[PosedViews], ViewsEvidence]:
    """What makes the evidence of posed views. model: of the largest object."""
    of_views = DlvSettings()
    builder = ViewsEvidenceBuilder(of_views, settings.evidence != 'edges',
                                   apparent_size(model, settings))
    return lambda views: builder.build(binned_to_draw(views, of_views, settings, model.radius))


def main() -> int:
    """Entry point."""
    return run(PmclNode)


if __name__ == '__main__':
    sys.exit(main())
