"""Images of a moved camera and its poses -> LightField or PosedViews."""

import sys
import time
from collections import deque
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import transform
from pmcl_ros.lightfield.masks import read_mask
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.sweep.collection import Collection
from pmcl_ros.lightfield.sweep.frame import Lens, SweepFrame
from pmcl_ros.lightfield.sweep.plan import SweepPlan
from pmcl_ros.lightfield.sweep.settings import SweepDriverSettings
from pmcl_ros.lightfield.sweep.view_collection import ViewCollection
from pmcl_ros.lightfield.sweep.view_plan import ViewPlan, check_frame
from pmcl_ros.nodes.camera_input import (
    Picture,
    Silence,
    most_waiting,
    pixels_from,
    stamped,
    subscribe_camera,
)
from pmcl_ros.nodes.runtime.base import StageNode
from pmcl_ros.nodes.runtime.pose_source import PoseNames, pose_source
from pmcl_ros.nodes.runtime.repeated_lines import RepeatedLines
from pmcl_ros.nodes.runtime.running import run
from pmcl_ros.nodes.stamped_lenses import StampedLenses
from pmcl_ros.nodes.transport.deferred_publisher import DeferredPublisher
from pmcl_ros.nodes.view_outputs import posed_view_outputs, view_outputs
from pmcl_ros.runtime.errors import (
    LightFieldError,
    PmclError,
    PoseUnavailableError,
    SettingsError,
)
from pmcl_ros.runtime.resources import resolve

_CAMERA = PoseNames('poses', 'camera_pose', 'fixed_frame', 'gap')
_LOOK = 0.05  # s between two looks for poses of images that wait
_LISTEN = 1.0  # s between two looks whether images come


class _Waiting(NamedTuple):
    """An image whose pose has not come yet.

    lens: that was known when it came. came: on the monotonic clock.
    """

    name: str
    header: Header
    image: Picture
    lens: Lens | None
    came: float


class SweepDriver(StageNode):
    """Collects the frames of a sweep and publishes them as one light field, or as posed views.

    Posed views are published whenever there is one more.
    """

    name = 'sweep_driver'
    settings_class = SweepDriverSettings

    def set_up(self, settings: SweepDriverSettings) -> None:
        """Read the mask, and the plan: where collect is plan, or grid with a plan."""
        self._middle = self._planned = None
        if settings.collect == 'plan':
            if not settings.plan:
                raise SettingsError('collect is plan, and plan is empty: set it to a YAML file '
                                    'with `poses` (docs/howto/posed_views.md)')
            wanted = ViewPlan.load(resolve(settings.plan, 'plan'))
            check_frame(wanted, settings.fixed_frame, settings.plan)
            self._planned = wanted.cameras
        elif settings.plan and settings.collect == 'grid':
            plan = SweepPlan.load(resolve(settings.plan, 'plan'))
            check_frame(plan, settings.fixed_frame, settings.plan)
            settings = settings.model_copy(update={'rows': plan.rows, 'columns': plan.columns,
                                                   'baseline': plan.baseline})
            self._middle = plan.middle
        self._mask = read_mask(resolve(settings.mask, 'mask')) if settings.mask else None
        self._settings = settings
        self._collection = self._new_collection()
        self._poses = pose_source(self, _CAMERA, settings.poses, settings.fixed_frame,
                                  transform(settings.mount_position, settings.mount_rpy),
                                  settings.mount_parent)
        self._outputs = view_outputs(self)
        self._posed_outputs = posed_view_outputs(self)
        self.get_logger().info(_described_mount(settings))
        self.get_logger().info(self._described_sweep())

    def _described_sweep(self) -> str:
        settings = self._settings
        if settings.collect == 'grid':
            return (f'a sweep is {settings.rows}x{settings.columns} views, {settings.baseline} m '
                    'apart, ' + ('at the planned poses' if self._middle is not None
                                 else 'wherever the camera goes'))
        when = {'rest': 'wherever the camera comes to rest', 'service': 'at each call of ~/take',
                'plan': 'at the planned poses'}[settings.collect]
        return f'collects up to {self._collection.cells} posed views, {when}'

    def start(self) -> None:
        """Listen."""
        self._lenses = StampedLenses(self._settings.rectified)
        self._waiting: deque[_Waiting] = deque()
        self._collecting, self._ending, self._number = False, False, 0
        self._wanted = 0  # pictures that ~/take asked for
        self._lines = RepeatedLines()
        self._deferred = DeferredPublisher(self, self._outputs, 'no subscriber of views or center')
        self._posed = DeferredPublisher(self, self._posed_outputs, 'no subscriber of posed_views')
        self._poses.start()
        self._silence = Silence(self, [subscribe_camera(
            self, self._settings, 'image', 'camera_info', self._on_image, self._lenses.add)])
        self.every(_LISTEN, self._listen)
        self._look = self.every(_LOOK, self._take_waiting)
        self.serve('~/start', self._start_sweep)
        self.serve('~/finish', self._finish)
        self.serve('~/take', self._take)
        self._collection = self._new_collection()
        self._frame_id: str | None = None
        if self._settings.at_once:
            self._start_sweep()
        self._report_progress()

    def _new_collection(self) -> Collection | ViewCollection:
        if self._settings.collect == 'grid':
            return Collection(self._settings, self._middle)
        return ViewCollection(self._settings, self._settings.fixed_frame, self._planned,
                              self._mask)

    # in

    def _take(self) -> str:
        if self._settings.collect != 'service':
            raise LightFieldError(f'collect is {self._settings.collect}: pictures are taken '
                                  'without a call; set it to service')
        if not self._collecting:
            raise LightFieldError('no collection is going on: call ~/start')
        self._wanted += 1
        return 'the next picture at rest is taken'

    def _start_sweep(self) -> str:
        forgotten = len(self._collection.frames) if self._collecting else 0
        self._collection = self._new_collection()
        self._waiting.clear()
        self._collecting, self._auto, self._frame_id = True, self._settings.auto_finish, None
        self._number = self._wanted = 0
        self.health.extra.pop('left out last', None)
        self._report_progress()
        return 'collecting' + (f'; {forgotten} frames of an unfinished sweep are forgotten'
                               if forgotten else '')

    def _listen(self) -> None:
        if self._collecting:  # a camera that nobody needs may be off
            self._silence.look()
        else:
            self._silence.broken()

    def _on_image(self, message: Picture) -> None:
        self._silence.broken()
        self.health.frames_in += 1
        if not self._collecting:
            self.health.count('frames outside of sweeps')
            return
        asked = self._settings.collect == 'service'
        if asked and not self._wanted:
            return
        self._number += 1
        name = f'frame {self._number}'
        header = stamped(message)
        self._frame_id = self._frame_id or header.frame_id
        if header.frame_id != self._frame_id:
            raise LightFieldError(f'{name} is of {header.frame_id!r}, those before it of '
                                  f'{self._frame_id!r}: a sweep is of one camera; '
                                  'fixed_cameras takes several at rest')
        self._wanted -= asked
        self._waiting.append(_Waiting(name, header, message, self._lenses.last, time.monotonic()))
        self._look.reset()
        self._take_waiting()
        while len(self._waiting) > most_waiting(len(message.data)):
            self._give_up(self._waiting.popleft(),
                          f'{len(self._waiting)} younger ones wait too')

    def _take_waiting(self) -> None:
        """Collect the images whose poses are known by now, in their order."""
        taken = False
        try:
            while self._waiting and (kept := self._take_first()) is not None:
                taken = kept or taken
        finally:  # an image that cannot be used takes nothing from those before it
            if not self._waiting:
                self._look.cancel()
            if taken:
                self._on_taken()

    def _take_first(self) -> bool | None:
        """Whether the first image that waits is collected; None: it goes on waiting."""
        first = self._waiting[0]
        lens = self._lenses.at(first.header.stamp_ns, first.lens)
        try:
            moving = self._poses.interpolated(
                first.header.stamp_ns, self._settings.camera_frame or first.header.frame_id,
                self._settings.gap)
        except PoseUnavailableError as error:
            self._give_up(self._waiting.popleft(), str(error))
            return False
        if lens is None or moving is None:
            if time.monotonic() - first.came < self._settings.patience:
                return None
            self._give_up(self._waiting.popleft(), self._why_no_lens() if lens is None
                          else self._poses.missing)
            return False
        self._waiting.popleft()
        if self.health.level == DiagnosticStatus.WARN:  # what was missing is there again
            self.health.recovered()
        try:
            pixels = pixels_from(first.image, self._settings.bits)
            frame = SweepFrame(first.name, first.header.stamp_ns, pixels, lens, moving.pose,
                               moving.speed, moving.angular_speed)
        except PmclError as error:
            self._leave_out(first.name, str(error))
            raise LightFieldError(f'left out: {self._collection.left_out[-1]}') from None
        kept = self._collection.add(frame)
        if not kept:
            self._on_left_out()
        return kept

    def _on_taken(self) -> None:
        self._report_progress()
        if self._ending:
            return
        if self._auto and self._collection.complete:
            self._auto = False  # what fails now is the user's to finish, or to start again
            self._finish()
        elif self._collection.due:
            self._publish()

    def _why_no_lens(self) -> str:
        topic = self.resolve_topic_name('camera_info')
        return self._lenses.refused or (f'no camera_info has come on {topic} (publishers: '
                                 f'{self.count_publishers(topic)}): publish it there, or '
                                 'remap the topic')

    def _leave_out(self, name: str, reason: str) -> None:
        self._collection.leave_out(name, reason)
        self._on_left_out()

    def _on_left_out(self) -> None:
        """Say why; what ~/take asked for is still to come, unless it is there, or enough are."""
        left_out = self._collection.left_out[-1]
        self.health.extra |= {'frames left out': self._collection.left_out_count,
                              'left out last': str(left_out)}
        if self._settings.collect != 'service':
            return
        if left_out.spare or self._collection.complete:
            self.get_logger().warning(f'~/take: no further view, as {left_out}')
        else:
            self._wanted += 1
            self.get_logger().info(f'~/take: another picture, as {left_out}',
                                   throttle_duration_sec=1.0)

    def _give_up(self, waiting: _Waiting, reason: str) -> None:
        self._leave_out(waiting.name, reason)
        with self.health.lock:
            self.health.dropped += 1
            self.health.warn(reason)
        # Poses may be missing for a while, as where a board is out of view: for each picture then.
        if line := self._lines(f'dropped {waiting.name}, {waiting.header.stamp_ns}: {reason}'):
            self.get_logger().warning(line)

    # out

    def _finish(self) -> str:
        """Publish what there is; after a sweep has ended, the same again."""
        if not self._collecting and not self._collection.frames:
            raise LightFieldError('no sweep is going on: call ~/start')
        self._ending = True  # what is taken now is published at the end, once
        with self.watched('image'):
            self._take_waiting()
        self._ending = False
        while self._waiting:
            self._give_up(self._waiting.popleft(), 'its pose had not come when the sweep ended')
        try:
            text = self._publish()
        except LightFieldError as error:  # the frames are kept: more may mend it
            raise LightFieldError(f'nothing to publish of this sweep yet: {error}') from None
        self._collecting = False
        self._report_progress()
        self.health.extra['last sweep'] = text
        self.publish_diagnostics()
        return text

    def _publish(self) -> str:
        """Publish what has been collected; returns what it is."""
        sweep = self._collection.assemble(self._frame_id or '')
        made = sweep.source
        self.get_logger().info(f'sweep: {sweep.describe()}')
        for each in sweep.left_out:
            self.get_logger().debug(f'left out {each}')
        capture = f'sweep {made.header.stamp_ns}'
        if isinstance(made, PosedViews):
            self._posed.publish(lambda: made, capture)
        else:
            self._deferred.publish(lambda: made, capture)
        return sweep.describe()

    def _report_progress(self) -> None:
        """Progress, for /diagnostics."""
        self.health.extra |= {
            'sweep': 'collecting' if self._collecting else 'none',
            'views': f'{self._collection.filled} of {self._collection.cells}',
            'frames kept': len(self._collection.frames),
            'frames left out': self._collection.left_out_count}
        if self._planned is not None and isinstance(self._collection, ViewCollection):
            self.health.extra['planned poses without a view'] = ', '.join(
                map(str, self._collection.missing)) or 'none'


def _described_mount(settings: SweepDriverSettings) -> str:
    """Of which frame the poses count as, or where the camera is in theirs."""
    if not any(settings.mount_position + settings.mount_rpy):
        return ("the poses count as those of the camera's optical frame: mount_position and "
                'mount_rpy are 0')
    place, turn = (', '.join(f'{each:g}' for each in values)
                   for values in (settings.mount_position, settings.mount_rpy))
    return (f'the camera is mounted at mount_position ({place}) m, mount_rpy ({turn}) rad in '
            + (settings.mount_parent or 'the frame whose poses camera_pose has'))


def main() -> int:
    """Entry point."""
    return run(SweepDriver)


if __name__ == '__main__':
    sys.exit(main())
