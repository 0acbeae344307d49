"""Collects posed views of a moving camera: of each place where it came to rest, or of a plan."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.fixed_cameras import FixedCameraSettings
from pmcl_ros.lightfield.masks import check_size, mask_of_view
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews, encoded
from pmcl_ros.lightfield.readers.pictures import Reduction
from pmcl_ros.lightfield.sweep.assemble import summary
from pmcl_ros.lightfield.sweep.collection import MOST_BYTES, Frames
from pmcl_ros.lightfield.sweep.frame import LeftOut, SweepFrame
from pmcl_ros.lightfield.sweep.selection import FASTEST, distance, distances, moves
from pmcl_ros.lightfield.sweep.settings import ViewSettings
from pmcl_ros.lightfield.unusable_pictures import blurred_pictures
from pmcl_ros.runtime.errors import LightFieldError, SettingsError

_GROUP = 'hand-eye'
_BACK = 1_000_000_000  # ns: no frame comes so late


@dataclass(frozen=True)
class CollectedViews:
    """Posed views, and the last frames that are none of them.

    blurred: which views are beside the others, a part of a sentence each. They stay: a pose that
    all views tell is hardly worse by one of them, and no other view may be there.
    """

    source: PosedViews
    left_out: tuple[LeftOut, ...]
    blurred: tuple[str, ...] = ()

    def describe(self) -> str:
        """One line."""
        views = self.source.views
        left_out = [f'left out: {summary(self.left_out)}'] if self.left_out else []
        return '; '.join([f'{len(views)} posed views in {self.source.header.frame_id}',
                          *self.blurred, *left_out])


class ViewCollection(Frames):
    """Frames of any directions as they come, as views without distortion.

    All have the pinhole of the first frame; those of other cameras are resampled to it.
    frame: of the poses. planned: (n, 4, 4) where views are wanted, one at each; None: anywhere.
    mask: (height, width) of the images, False where they show what moves with the camera.
    Raises SettingsError for planned poses that are nearer to each other than views may be.
    """

    def __init__(self, settings: ViewSettings, frame: str,
                 planned: NDArray[np.float64] | None = None,
                 mask: NDArray[np.bool_] | None = None) -> None:
        super().__init__()
        self._mask = mask
        self._settings, self._frame, self._planned = settings, frame, planned
        self._spots: list[int] = []  # the planned pose of each view
        if planned is not None:
            _check_plan(planned, settings)
        self._views: list[PosedView] = []
        self._pinhole: Pinhole | None = None

    @property
    def cells(self) -> int:
        """Number of views that are wanted."""
        return self._settings.most_views if self._planned is None else len(self._planned)

    @property
    def filled(self) -> int:
        """Number of views that are there."""
        return len(self.frames)

    @property
    def complete(self) -> bool:
        """Whether there are as many views as are wanted; never of an object that drifts."""
        return not self._rolling and self.filled == self.cells

    @property
    def _rolling(self) -> bool:
        """Whether new views replace the oldest."""
        return self._settings.drift > 0 and self._planned is None

    @property
    def missing(self) -> list[int]:
        """Numbers of the planned poses, from 1, that have no view yet; without a plan none."""
        count = 0 if self._planned is None else len(self._planned)
        return [number + 1 for number in range(count) if number not in self._spots]

    @property
    def due(self) -> bool:
        """Whether there are views enough for a pose."""
        return self.filled >= self._settings.least_views

    def add(self, frame: SweepFrame) -> bool:
        """Add a frame; returns whether it is kept. Dropped frames go to `left_out`.

        Raises LightFieldError when the memory is full, or the mask is of another size.
        """
        if self._mask is not None:
            try:
                check_size(self._mask, frame.lens.pinhole, frame.name)
            except LightFieldError:
                self.leave_out(frame.name, 'the mask is of another size')
                raise
        reason = moves(frame, self._settings)
        if reason:
            self.leave_out(frame.name, reason, moved=frame.speed < FASTEST)
            return False
        if self._rolling and self.frames and frame.stamp_ns < self._newest.stamp_ns - _BACK:
            while self.frames:  # the clock was set, or a bag begins anew
                self._forget_oldest()
        spot = self._spot(frame)
        if spot is None:
            return False
        for number, (other, own) in enumerate(zip(self.frames, self._spots, strict=True)):
            apart = distance(frame, other, self._settings.near)
            if own != spot or (self._planned is None and apart >= self._settings.apart):
                continue
            replaced = self._is_blurred(other, frame) or (
                self._rolling and self._newest is not other and not self._is_blurred(frame, other))
            worse, better = (other, frame) if replaced else (frame, other)
            self.leave_out(worse.name, f'{better.name} is there, {1e3 * apart:.1f} mm beside it',
                           True)
            if replaced:
                self.frames[number], self._views[number] = frame, self._view(frame)
            return replaced
        if self._rolling and self.filled == self.cells:
            self._forget_oldest()
        if self.complete:
            self.leave_out(frame.name, f'{len(self.frames)} views are there already (most_views)')
            return False
        size = self._bytes(frame)
        if size > MOST_BYTES:
            self.leave_out(frame.name, 'no room')
            raise LightFieldError(
                f'{frame.name} is given up: {len(self._views) + 1} views need '
                f'{size / 2 ** 30:.1f} GiB; take fewer, or make pixels larger (shrink)')
        self._views.append(self._view(frame))
        self.frames.append(frame)
        self._spots.append(spot)
        return True

    def _spot(self, frame: SweepFrame) -> int | None:
        """The planned pose that a frame is at; a frame at none is left out. 0 without a plan."""
        if self._planned is None:
            return 0
        away = distances(frame.pose, self._planned, self._settings.near)
        spot = int(away.argmin())
        if away[spot] <= self._settings.apart:
            return spot
        self.leave_out(frame.name, f'it is at no planned pose: pose {spot + 1} is the nearest, '
                       f'{1e3 * away[spot]:.0f} mm away')
        return None

    def _is_blurred(self, frame: SweepFrame, beside: SweepFrame) -> bool:
        return bool((frame.sharpness < self._settings.sharpness * beside.sharpness).any())

    @property
    def _newest(self) -> SweepFrame:
        return max(self.frames, key=lambda each: each.stamp_ns)

    def _forget_oldest(self) -> None:
        """Of an object that moves, the newest views tell where it is."""
        oldest = min(range(self.filled), key=lambda number: self.frames[number].stamp_ns)
        self.leave_out(self.frames[oldest].name, 'it is the oldest of an object that drifts')
        for each in (self.frames, self._views, self._spots):
            del each[oldest]

    def assemble(self, _: str = '') -> CollectedViews:
        """The views so far, which stay. Raises LightFieldError where there are none."""
        if not self._views:
            raise LightFieldError(f'there is no view: {summary(self.left_out) or "no frame came"}')
        last = max(each.header.stamp_ns for each in self._views)
        views = tuple(
            replace(each, drift=1e-9 * (last - each.header.stamp_ns) * self._settings.drift)
            for each in self._views)
        cameras = np.array([each.camera_to_reference for each in views])
        ahead = cameras[:, :3, 3] + self._settings.focus * cameras[:, :3, 2]
        return CollectedViews(PosedViews(views), tuple(self.left_out),
                              tuple(blurred_pictures(views, ahead.mean(axis=0))))

    def _bytes(self, frame: SweepFrame) -> int:
        """Of all frames and views, with one more."""
        pinhole = Reduction(1, self._settings.shrink).pinhole(self._pinhole or frame.lens.pinhole)
        images = sum(each.image.nbytes for each in (*self.frames, frame))
        return images + (len(self._views) + 1) * 12 * pinhole.width * pinhole.height

    def _view(self, frame: SweepFrame) -> PosedView:
        if self._pinhole is None:
            self._pinhole = frame.lens.pinhole
        return posed_view(frame, self._pinhole, self._settings, self._frame, _GROUP, self._mask)


def posed_view(frame: SweepFrame, pinhole: Pinhole, settings: ViewSettings | FixedCameraSettings,
               reference: str, group: str, mask: NDArray[np.bool_] | None = None) -> PosedView:
    """What a pinhole at the frame's place sees, shrunk, with the errors of poses in `settings`.

    reference: the frame of the poses. group: of the views whose poses have errors in common.
    mask: (height, width) of the frame's image. Raises LightFieldError as `mask_of_view`.
    """
    reduction = Reduction(1, settings.shrink)
    picture = frame.lens.undistorted(encoded(frame.image, settings.gamma), pinhole)
    return PosedView(Header(frame.stamp_ns, reference), reduction.shrunk(picture),
                     reduction.pinhole(pinhole), frame.pose,
                     (settings.sigma_position, settings.sigma_rotation), group, settings.common,
                     name=frame.name, mask=None if mask is None else mask_of_view(
                         mask, frame.lens, pinhole, reduction, frame.name))


def _check_plan(planned: NDArray[np.float64], settings: ViewSettings) -> None:
    for number in range(1, len(planned)):
        away = distances(planned[number], planned[:number], settings.near)
        if away.min() < settings.apart:
            raise SettingsError(f'planned poses {away.argmin() + 1} and {number + 1} are '
                                f'{1e3 * away.min():.0f} mm apart, views are {settings.apart} m '
                                'apart at least: plan fewer, or set apart')
    if len(planned) > settings.most_views:
        raise SettingsError(f'{len(planned)} poses are planned, most_views is '
                            f'{settings.most_views}: plan fewer, or set most_views')
