"""Images of several cameras at rest, whose poses are known -> PosedViews."""

import sys
import time
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo

from pmcl_ros.geometry.se3 import transform
from pmcl_ros.lightfield.fixed_cameras import FixedCameraSettings
from pmcl_ros.lightfield.masks import check_size, read_mask
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.sweep.frame import Lens, SweepFrame
from pmcl_ros.lightfield.sweep.view_collection import posed_view
from pmcl_ros.lightfield.sweep.view_plan import ViewPlan, check_frame
from pmcl_ros.messages.camera_info import lens_from
from pmcl_ros.nodes.camera_input import (
    Picture,
    Silence,
    most_waiting,
    pixels_from,
    stamped,
    subscribe_camera,
)
from pmcl_ros.nodes.runtime.base import StageNode
from pmcl_ros.nodes.runtime.pose_source import PoseNames, TfPoses, tf2
from pmcl_ros.nodes.runtime.repeated_lines import RepeatedLines
from pmcl_ros.nodes.runtime.running import run
from pmcl_ros.nodes.transport.approximate_synchronizer import ApproximateSynchronizer
from pmcl_ros.nodes.transport.deferred_publisher import DeferredPublisher
from pmcl_ros.nodes.view_outputs import posed_view_outputs
from pmcl_ros.runtime.errors import MessageError, SettingsError
from pmcl_ros.runtime.resources import resolve

_GROUP = 'cameras'
_CAMERA = PoseNames('camera_poses', '', 'fixed_frame', '')
_LOOK = 0.2  # s between two looks for pictures that have waited too long


class _Waiting(NamedTuple):
    """A picture that waits for those of the other cameras. came: on the monotonic clock."""

    frame: SweepFrame
    came: float


class FixedCameras(StageNode):
    """Joins the pictures of about one stamp and publishes each set as posed views."""

    name = 'fixed_cameras'
    settings_class = FixedCameraSettings

    def set_up(self, settings: FixedCameraSettings) -> None:
        """Read the poses, or prepare to listen to /tf."""
        self._settings = settings
        self._masks = {camera: read_mask(resolve(path, 'masks')) for camera, path in zip(
            settings.cameras, settings.masks, strict=False) if path}  # or one empty path for all
        self._tf, self._poses = None, {}
        if settings.camera_poses or settings.mounted:
            self._poses = _read_poses(settings)
        elif tf2() is not None:
            self._tf = TfPoses(self, _CAMERA, settings.fixed_frame)
        else:
            raise SettingsError('camera_poses is empty, and tf2_ros cannot be imported (it is '
                                'part of a full ROS, not on PyPI): set it, or camera_mounts '
                                '(docs/howto/fixed_cameras.md)')
        self._outputs = posed_view_outputs(self)

    def start(self) -> None:
        """Listen."""
        settings = self._settings
        self._lenses: dict[str, Lens] = {}
        self._last: dict[str, int] = {}  # stamps [ns] of the last usable pictures
        self._early: dict[str, Picture] = {}  # the last picture of a camera without a lens
        self._sets: ApproximateSynchronizer[_Waiting] = ApproximateSynchronizer(
            settings.cameras, round(1e9 * settings.slop))
        self._room = 0  # pictures of a camera that may wait for others
        self._lines = RepeatedLines()
        self._too_early = range(0)  # stamps [ns]: too soon after the last set (period)
        self._posed = DeferredPublisher(self, self._outputs, '')
        if self._tf is not None:
            self._tf.start()
        image = 'image_rect' if settings.rectified else 'image_raw'
        self._silence = Silence(self, [
            subscribe_camera(self, settings, f'{each}/{image}', f'{each}/camera_info',
                             partial(self._on_image, each), partial(self._on_info, each))
            for each in settings.cameras])
        self.every(_LOOK, self._look)

    def _on_info(self, camera: str, message: CameraInfo) -> None:
        self._lenses.pop(camera, None)  # where this is refused, the one before it is outdated
        self._lenses[camera] = lens_from(message, self._settings.rectified)
        if camera in self._early:
            self._add(camera, self._early.pop(camera))

    def _on_image(self, camera: str, message: Picture) -> None:
        self._silence.broken()
        self.health.frames_in += 1
        self.health.count(f'pictures of {camera}')
        if camera in self._lenses:
            self._add(camera, message)
            return
        before = self._early.pop(camera, None)
        self._early[camera] = message  # its camera_info may be on its way
        if before is not None:
            raise MessageError(f'no camera_info that can be used has come on {camera}/camera_info')

    def _add(self, camera: str, message: Picture) -> None:
        """Add a picture to the sets; a PmclError where it cannot be used."""
        header = stamped(message)
        pose = (self._poses[camera] if self._tf is None
                else self._tf.nearest(0, header.frame_id, 0))  # the newest: it does not move
        frame = SweepFrame(f'frame {header.stamp_ns}', header.stamp_ns, pixels_from(
            message, self._settings.bits), self._lenses[camera], pose)
        if camera in self._masks:
            check_size(self._masks[camera], frame.lens.pinhole, frame.name)
        self._last[camera] = header.stamp_ns
        self._sets.add(camera, frame.stamp_ns, _Waiting(frame, time.monotonic()))
        self._room = most_waiting(len(self._settings.cameras) * frame.image.nbytes)
        self._join()

    def _look(self) -> None:
        self._join()
        self._silence.look()

    def _join(self) -> None:
        """Publish the sets that are complete, the oldest first; give up those that will not be."""
        while pictures := self._sets.oldest():
            missing = [each for each in self._settings.cameras if each not in pictures]
            waited = time.monotonic() - min(each.came for each in pictures.values())
            if missing and not self._sets.decided and (
                    self._sets.longest <= self._room and waited < self._settings.patience):
                return
            self._sets.pop()
            frames = {camera: each.frame for camera, each in pictures.items()}
            stamp_ns = max(each.stamp_ns for each in frames.values())
            if missing:
                self._give_up(stamp_ns, missing)
            elif stamp_ns not in self._too_early:
                self._too_early = range(stamp_ns, stamp_ns + round(1e9 * self._settings.period))
                self._posed.publish(partial(self._views, frames), f'set {stamp_ns}')

    def _give_up(self, stamp_ns: int, missing: list[str]) -> None:
        reason = f'no usable picture of {" or ".join(missing)} within {self._settings.slop} s'
        # Is a camera dead, or its clock another? It differs from line to line: not what is one.
        after = {each: 1e-9 * (self._last[each] - stamp_ns) for each in missing
                 if each in self._last}
        last = ''.join(f'; the last of {each} is {abs(later):.3f} s '
                       f'{"later" if later > 0 else "earlier"}' for each, later in after.items())
        with self.health.lock:
            self.health.dropped += 1
            self.health.warn(reason + last)
        if line := self._lines(f'dropped set {stamp_ns}: {reason}'):
            self.get_logger().warning(line + last)

    def _views(self, frames: dict[str, SweepFrame]) -> PosedViews:
        settings, pinhole = self._settings, next(iter(frames.values())).lens.pinhole
        return PosedViews(tuple(posed_view(each, pinhole, settings, settings.fixed_frame, _GROUP,
                                           self._masks.get(camera))
                                for camera, each in frames.items()))


def _read_poses(settings: FixedCameraSettings) -> dict[str, NDArray[np.float64]]:
    """The pose (4, 4) of each camera; SettingsError where the file has others."""
    if settings.mounted:
        mounts = np.reshape(settings.camera_mounts, (-1, 6))
        return {camera: transform(each[:3], each[3:].tolist())
                for camera, each in zip(settings.cameras, mounts, strict=True)}
    plan = ViewPlan.load(resolve(settings.camera_poses, 'camera_poses'))
    check_frame(plan, settings.fixed_frame, settings.camera_poses)
    if len(plan.poses) != len(settings.cameras):
        raise SettingsError(f'{settings.camera_poses} has {len(plan.poses)} poses, there are '
                            f'{len(settings.cameras)} cameras ({", ".join(settings.cameras)}): '
                            'give one for each, in this order')
    return dict(zip(settings.cameras, plan.cameras, strict=True))


def main() -> int:
    """Entry point."""
    return run(FixedCameras)


if __name__ == '__main__':
    sys.exit(main())
