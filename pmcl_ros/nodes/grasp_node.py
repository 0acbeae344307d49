"""PoseEstimate -> grasps: ranks the ways to take the object for each of its poses."""

import re
import sys
import time
from collections import deque
from contextlib import ExitStack
from functools import partial
from threading import Lock

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from numpy.typing import NDArray
from std_msgs.msg import Float32MultiArray
from visualization_msgs.msg import MarkerArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import rotate_covariance, transform
from pmcl_ros.grasps.grasp import GraspFile
from pmcl_ros.grasps.ranking import Ranker, Ranking
from pmcl_ros.grasps.settings import GraspSettings
from pmcl_ros.messages.grasp import first_of, grasps_to_messages, grippers_to_markers
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.marker import no_markers
from pmcl_ros.messages.pose import pose_from, pose_with_covariance_from
from pmcl_ros.nodes.runtime.awaited_inputs import AwaitedInputs
from pmcl_ros.nodes.runtime.base import SMALL, StageNode
from pmcl_ros.nodes.runtime.pose_source import PoseNames, pose_source
from pmcl_ros.nodes.runtime.running import run
from pmcl_ros.nodes.runtime.worker import Worker
from pmcl_ros.pmcl.multi_object.scene_estimate import distinct_names
from pmcl_ros.runtime.errors import GraspError, PmclError
from pmcl_ros.runtime.resources import resolve

_ARM = PoseNames('arm', 'arm_pose', 'base_frame', 'max_age')
_ENDED = 'the node was deactivated before grasps were made of it'
_PATIENCE = 0.5  # s: how much later than its pose a covariance may come


class GraspNode(StageNode):
    """Publishes the grasps of each pose once, best first, or none and says why.

    Ranking many grasps takes seconds: it is done on a thread of its own, so that no pose of the
    arm is missed meanwhile. One pose of the object may wait, the newest.
    """

    name = 'grasp_node'
    settings_class = GraspSettings

    def set_up(self, settings: GraspSettings) -> None:
        """Load the object and its grasps."""
        self._settings = settings
        self._model, self._gripper, grasps = GraspFile.read(resolve(settings.grasps, 'grasps'))
        self._ranker = Ranker(self._model, self._gripper, grasps, settings)
        self._mount = transform(settings.mount_position, settings.mount_rpy)
        self._arm = pose_source(self, _ARM, settings.arm, settings.base_frame)
        self.get_logger().info(
            f'{len(grasps)} grasps of {self._model.name}; poses of {self._gripper.parent_link} in '
            f'{settings.base_frame}')
        self._ranked = [self.publisher(PoseArray, 'grasps', SMALL),
                        self.publisher(PoseArray, 'pre_grasps', SMALL),
                        self.publisher(Float32MultiArray, 'grasps/details', SMALL)]
        self._best = [self.publisher(PoseStamped, 'grasp', SMALL),
                      self.publisher(PoseStamped, 'pre_grasp', SMALL)]
        self._markers = self.publisher(MarkerArray, 'grasp_markers', SMALL)
        self._output = Lock()  # held while grasps, or none, are published
        self._losses = 0
        self._worker: Worker[ExitStack] = Worker(ExitStack)  # of which the thread alone is wanted
        self.configured.callback(self._worker.close)

    def start(self) -> None:
        """Listen."""
        self._done: int | None = None  # the last stamp of which a covariance has come
        # Poses that wait for their covariance, and when they came.
        self._held: deque[tuple[float, Header, NDArray[np.float64]]] = deque()
        self._handled: int | None = None  # the stamp of the last pose or loss
        self._reported: int | None = None  # the capture of the localizer's last report
        self._last_report: tuple[str, str, str] | None = None
        self._worker.resume()
        self.active.callback(self.publish_last, self._markers, no_markers())
        self.active.callback(self._stop)
        self._arm.start()
        poses = [
            self.subscribe(PoseWithCovarianceStamped, 'pose_with_covariance', self._on_both,
                           SMALL),
            self.subscribe(PoseStamped, 'pose', self._on_pose, SMALL)]
        AwaitedInputs(self, lambda: [[each] for each in poses])  # either is enough
        self._name = (_name_in([each.topic_name for each in poses])
                      or distinct_names([self._model.name])[0])
        if self._settings.localizer:
            namespace = self.get_namespace().rstrip('/')
            self._localizer = f'{namespace}/{self._settings.localizer}'.lstrip('/')
            self.subscribe(DiagnosticArray, '/diagnostics', self._on_diagnostics, SMALL)
        self.every(_PATIENCE / 2, self._wait_no_longer)

    # in

    def _on_both(self, message: PoseWithCovarianceStamped) -> None:
        header, pose, covariance = pose_with_covariance_from(message)
        self._done = header.stamp_ns
        self._held = deque(each for each in self._held if each[1].stamp_ns > self._done)
        self._take(header, pose, covariance)

    def _on_pose(self, message: PoseStamped) -> None:
        header, pose = pose_from(message)
        if header.stamp_ns != self._done:  # else its covariance came first
            self._held.append((time.monotonic(), header, pose))

    def _wait_no_longer(self) -> None:
        due = []
        while self._held and time.monotonic() - self._held[0][0] >= _PATIENCE:
            due.append(self._held.popleft())
        if not due:
            return
        *earlier, (_, header, pose) = due
        if earlier:
            self.dropped(f'{len(earlier)} poses: a newer one came before grasps were made of them',
                         len(earlier))
        shift, turn = self._settings.assumed_sigma
        self.get_logger().warning(
            f'poses come without pose_with_covariance: {shift} m and {turn} rad are assumed '
            '(assumed_sigma)', once=True)
        self._take(header, pose, np.diag(np.repeat([shift ** 2, turn ** 2], 3)))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._localizer:
                self._on_report(status, header_from(message.header).stamp_ns)

    def _on_report(self, status: DiagnosticStatus, stamp_ns: int) -> None:
        """Tell a loss once; of a localizer that names no capture it is of the report's stamp."""
        values = {each.key: each.value for each in status.values}
        capture, search = values.get('capture', ''), values.get('search', '')
        report = capture, search, status.message
        if report == self._last_report:  # it comes again each second
            return
        self._last_report, overtaken = report, False
        if capture.isdecimal():
            stamp_ns = int(capture)
            # A pose may overtake the reports of earlier captures, which come on another topic.
            # After its own report an older capture is a new one: the clock was set back.
            overtaken = (self._handled is not None and stamp_ns < self._handled
                         and self._reported != self._handled)
            self._reported = stamp_ns
        if status.level != DiagnosticStatus.WARN or not self._is_lost(status) or overtaken:
            return
        self._handled = stamp_ns
        waiting = [each for each in self._held if each[1].stamp_ns > stamp_ns]
        if count := len(self._held) - len(waiting):
            self.dropped(f'{count} poses: the object was lost before their covariance came', count)
        self._held = deque(waiting)
        with self._output:
            self._losses += 1
            self._none(Header(stamp_ns, self._settings.base_frame), status.message)

    def _is_lost(self, status: DiagnosticStatus) -> bool:
        """Whether the object is, alone or among several, of which each has a value of its name."""
        return status.message.startswith('lost') or any(
            each.key == self._name and each.value == 'lost' for each in status.values)

    def _take(self, header: Header, pose: NDArray[np.float64], covariance: NDArray[np.float64]
              ) -> None:
        self._handled = header.stamp_ns
        replaced = self._worker.offer(partial(self._make_grasps, header, pose, covariance,
                                              time.monotonic(), self._losses))
        if replaced is not None:
            self.dropped(f'capture {replaced.args[0].stamp_ns}: a newer one came before grasps '
                         'were made of it')

    def _stop(self) -> None:
        waited = self._worker.stop()
        if waited is not None:
            self.dropped(f'capture {waited.args[0].stamp_ns}: {_ENDED}')

    # on the worker's thread

    def _make_grasps(self, header: Header, pose: NDArray[np.float64],
                     covariance: NDArray[np.float64], began: float, losses: int,
                     _: object) -> None:
        """losses: how many there were when the pose came."""
        base = Header(header.stamp_ns, self._settings.base_frame)
        with self.watched('ranking'):
            try:
                ranking = self._rank(header, pose, covariance)
            except PmclError as error:
                self.health.frames_in += 1
                with self._output:
                    if losses == self._losses and not self._worker.stopping:
                        self._publish_none(base, str(error))
                raise  # logged and counted as an error
            with self._output:
                if self._worker.stopping:
                    self.dropped(f'capture {header.stamp_ns}: {_ENDED}')
                elif losses != self._losses:
                    self.dropped(f'capture {header.stamp_ns}: the object was lost before grasps '
                                 'were made of it')
                else:
                    self.health.frames_in += 1
                    if ranking.candidates:
                        self._some(base, ranking, time.monotonic() - began)
                    else:
                        self._none(base, ranking.describe())

    def _rank(self, header: Header, pose: NDArray[np.float64], covariance: NDArray[np.float64]
              ) -> Ranking:
        if header.frame_id == self._settings.base_frame:  # of posed views
            return self._ranker.rank(pose, covariance)
        if header.frame_id != self._settings.camera_frame:
            raise GraspError(f'the pose is in frame {header.frame_id!r}, expected camera_frame '
                             f'{self._settings.camera_frame!r} or base_frame '
                             f'{self._settings.base_frame!r}')
        camera = self._arm.nearest(header.stamp_ns, self._settings.mount_parent,
                                   self._settings.max_age) @ self._mount
        return self._ranker.rank(camera @ pose, rotate_covariance(covariance, camera[:3, :3]))

    # out, on either thread

    def _some(self, header: Header, ranking: Ranking, latency: float) -> None:
        self._publish(header, ranking)
        best = ranking.candidates[0]
        with self.health.lock:
            self.health.extra = {'object': self._model.name, 'best grasp': best.grasp.name,
                                 'probability': f'{best.probability:.3f}'}
            self.done(latency, f'{ranking.describe()}, in capture {header.stamp_ns}')
        self.publish_diagnostics()

    def _none(self, header: Header, why: str) -> None:
        text = why if why.startswith('no grasp') else f'no grasp: {why}'
        self._publish_none(header, text)
        self.get_logger().warning(text)
        self.publish_diagnostics()

    def _publish_none(self, header: Header, why: str) -> None:
        self._publish(header, Ranking((), {}))
        with self.health.lock:
            self.health.extra = {'object': self._model.name}  # no best grasp any more
            self.health.warn(why)

    def _publish(self, header: Header, ranking: Ranking) -> None:
        messages = grasps_to_messages(header, ranking.candidates, self._gripper,
                                      self._settings.approach)
        for publisher, message in zip(self._ranked, messages, strict=True):
            publisher.publish(message)
        if ranking.candidates:
            for publisher, message in zip(self._best, messages[:2], strict=True):
                publisher.publish(first_of(message))
        if self._markers.get_subscription_count():
            self._markers.publish(grippers_to_markers(header, ranking.candidates, self._gripper,
                                                      self._settings.approach))


def _name_in(topics: list[str]) -> str:
    """The object's name among several, as its pose topics (remapped) have it; empty: none has."""
    names = (re.search(r'/objects/([^/]+)/pose(_with_covariance)?$', each) for each in topics)
    return next((each[1] for each in names if each), '')


def main() -> int:
    """Entry point."""
    return run(GraspNode)


if __name__ == '__main__':
    sys.exit(main())
