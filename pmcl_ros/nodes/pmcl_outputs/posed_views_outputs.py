"""What pmcl_node says of posed views beside the pose: where to look next, and pictures."""

from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from rclpy.lifecycle import LifecyclePublisher
from sensor_msgs.msg import Image

from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.sweep.view_plan import ViewPlan
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.image import picture_to_message
from pmcl_ros.messages.pose import pose_to_message
from pmcl_ros.nodes.pmcl_settings import PmclNodeSettings
from pmcl_ros.nodes.runtime.base import SMALL, StageNode
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_view.next_view import cap, next_views, position_sigma
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import LocalizationError
from pmcl_ros.runtime.resources import resolve

if TYPE_CHECKING:  # matplotlib is imported for the first subscriber of a chart
    from matplotlib.figure import Figure


class PosedViewsOutputs:
    """How sure the pose is with each further view, and `~/next_view`: what one more would bring.

    For `set_up` of a node. posed: else there are no posed views, and the service says so.
    settings: those with the region that is searched. Raises SettingsError for a wrong plan.
    """

    def __init__(self, node: StageNode, posed: bool, settings: PmclNodeSettings) -> None:
        self._node, self._posed, self.settings = node, posed, settings
        plan = settings.next_view_plan
        self._plan = ViewPlan.load(resolve(plan, 'next_view_plan')) if plan else None
        self._next = node.publisher(PoseStamped, 'next_view', SMALL)
        self._candidates = node.publisher(Image, 'next_view/candidates', SMALL)
        self._sigmas = node.publisher(Image, 'pose/sigma_by_views', SMALL)
        self.forget()

    def start(self) -> None:
        """Serve, while the node is active."""
        self._node.serve('~/next_view', self._answer)

    def forget(self) -> None:
        """Drop what has been found."""
        self._last: tuple[ViewsEvidence, PoseEstimate, ObjectModel] | None = None
        self._cameras: list[NDArray[np.float64]] = []  # of the views that came last
        self._by_number: dict[int, float] = {}  # number of views: largest standard deviation [m]
        self._number = 0  # of the last views

    def on_views(self, views: PosedViews) -> None:
        """Take the cameras of views that have come and will be searched."""
        self._cameras = [each.camera_to_reference for each in views.views]

    def on_estimate(self, evidence: ViewsEvidence, estimate: PoseEstimate, model: ObjectModel
                    ) -> None:
        """Take what was found in some views, for `~/next_view` and the chart; from any thread.

        model: of what the estimate is of.
        """
        number = len(evidence.views)
        # Fewer: another collection has begun. As many: a view of it has been replaced, or the same
        # ones are searched again; what was found by the first ones stays.
        kept = self._by_number if number >= self._number else {}
        self._by_number = {each: sigma for each, sigma in kept.items() if each < number}
        self._number = number
        self._last = None if estimate.lost else (evidence, estimate, model)
        if not estimate.lost:
            self._by_number = self._by_number | {number: position_sigma(estimate.covariance)}

    def publish_chart(self) -> None:
        """Of how sure the poses of this collection were, unless the object was lost just now."""
        last = self._last
        if last is not None and self._sigmas.get_subscription_count():
            from pmcl_ros.drawing.views_picture import sigmas_figure
            sigmas = [self._by_number.get(each + 1, np.nan) for each in range(self._number)]
            _draw(self._sigmas, last[1].header, sigmas_figure(sigmas))

    def _answer(self) -> str:
        if not self._posed:
            raise LocalizationError('a next view needs posed views: set source to posed_views')
        last = self._last  # the thread of the search may replace it
        if last is None or not all(
                any(np.array_equal(each.camera_to_reference, one) for one in self._cameras)
                for each in last[0].views):
            raise LocalizationError('no pose has been found since the node was activated or '
                                    'reset, or the object was lost in the last views, or the '
                                    'views of another collection are being searched: take '
                                    'pictures of the region of interest first, and wait for the '
                                    'pose')
        evidence, estimate, model = last
        there = [each.camera_to_reference for each in evidence.views]
        candidates = self._candidate_cameras(estimate, there)
        found = next_views(estimate.found_in(evidence), model, self.settings, estimate.pose,
                           candidates, evidence.pinhole)
        best = found[0]
        if best.sigma >= best.now:
            raise LocalizationError(
                f'{1e3 * best.now:.2f} mm now; none of {len(found)} views is expected to help: '
                'the pose is as sure as they make it, or they do not see the object '
                f'({"next_view_cap" if self._plan is None else "next_view_plan"})')
        self._next.publish(PoseStamped(header=header_to_message(estimate.header),
                                       pose=pose_to_message(best.camera)))
        if self._candidates.get_subscription_count():
            from pmcl_ros.drawing.views_picture import next_views_figure
            _draw(self._candidates, estimate.header,
                  next_views_figure(found, estimate.pose, there))
        return f'{1e3 * best.now:.2f} mm now, {best.describe()}'

    def _candidate_cameras(self, estimate: PoseEstimate, there: list[NDArray[np.float64]]
                           ) -> NDArray[np.float64]:
        """(n, 4, 4) of the plan, else on a cap about the cameras that are there."""
        of = self.settings
        if self._plan is not None:
            return self._plan.cameras_in(estimate.header.frame_id, of.next_view_plan)
        return cap(estimate.pose, there, of.next_view_cap, of.next_view_candidates)


def _draw(publisher: LifecyclePublisher, header: Header, figure: 'Figure') -> None:
    from pmcl_ros.drawing import charts
    publisher.publish(picture_to_message(header, charts.picture(figure)))
