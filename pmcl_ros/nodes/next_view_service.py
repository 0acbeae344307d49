"""`~/next_view` of pmcl_node: from where one more picture would make the pose surest."""

from geometry_msgs.msg import PoseStamped

from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.pose import pose_to_message
from pmcl_ros.nodes.pmcl_settings import PmclNodeSettings
from pmcl_ros.nodes.runtime.base import SMALL, StageNode
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_view.next_view import cap, next_views
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import LocalizationError


class NextViewService:
    """Ranks cameras on a cap about the object, and publishes the best on `next_view`.

    For `set_up` of a node. model: None: there are no posed views, and it answers so.
    """

    def __init__(self, node: StageNode, model: ObjectModel | None, settings: PmclNodeSettings
                 ) -> None:
        self._node, self._model, self._settings = node, model, settings
        self._publisher = node.publisher(PoseStamped, 'next_view', SMALL)
        self.forget()

    def start(self) -> None:
        """Serve, while the node is active."""
        self._node.serve('~/next_view', self._answer)

    def forget(self) -> None:
        """Drop the last pose."""
        self._last: tuple[ViewsEvidence, PoseEstimate] | None = None

    def on_estimate(self, evidence: ViewsEvidence, estimate: PoseEstimate) -> None:
        """Remember what was found in some views; from any thread."""
        self._last = None if estimate.lost else (evidence, estimate)

    def _answer(self) -> str:
        if self._model is None:
            raise LocalizationError('a next view needs posed views: set source to posed_views')
        if self._last is None:
            raise LocalizationError('no pose has been found since the node was activated or '
                                    'reset, or the object was lost in the last views: take '
                                    'pictures of the region of interest first')
        evidence, estimate = self._last
        cameras = cap(estimate.pose, [each.camera_to_reference for each in evidence.views],
                      self._settings.next_view_cap, self._settings.next_view_candidates)
        best = next_views(evidence, self._model, self._settings, estimate.pose, cameras,
                          evidence.pinhole)[0]
        self._publisher.publish(PoseStamped(header=header_to_message(estimate.header),
                                            pose=pose_to_message(best.camera)))
        x, y, z = best.camera[:3, 3]
        return (f'{1e3 * best.now:.2f} mm now, {1e3 * best.sigma:.2f} mm with a view from '
                f'({x:.3f}, {y:.3f}, {z:.3f}) m in {estimate.header.frame_id}: next_view')
