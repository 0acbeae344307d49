"""Frames of a sweep -> LightField."""

import logging
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.lightfield.readers.pictures import Reduction, linear_light
from pmcl_ros.lightfield.sweep.frame import LeftOut, Lens, SweepFrame
from pmcl_ros.lightfield.sweep.rectify import (
    CornerTracker,
    Rectification,
    largest_window,
)
from pmcl_ros.lightfield.sweep.selection import Layout, good_pictures, one_for_each_cell
from pmcl_ros.lightfield.sweep.settings import SweepSettings
from pmcl_ros.runtime.errors import LightFieldError

_LOG = logging.getLogger(__name__)
_NAMED = 8  # reasons that one line names
_COARSE = 64  # pixels across a view, by whose poses a grid is told
_NUMBER = re.compile(r'-?[0-9]+(\.[0-9]+)?')


@dataclass(frozen=True)
class Sweep:
    """A light field and its frames.

    light_field: stamp and optical frame are those of the reference frame. reference: its name.
    used: (row, column) of a view -> the name of its frame. left_out: all other frames. residual:
    median over the views of the corners' distance from their epipolar lines [px]; NaN: no corner
    was tracked.
    """

    light_field: LightField
    reference: str
    used: dict[tuple[int, int], str]
    left_out: tuple[LeftOut, ...]
    residual: float

    @property
    def source(self) -> LightField:
        """What a pose is looked for in."""
        return self.light_field

    def describe(self) -> str:
        """One line."""
        rows, columns = self.light_field.grid.shape
        pinhole = self.light_field.grid.pinhole
        residual = ('too little texture to check poses' if math.isnan(self.residual)
                    else f'residual {self.residual:.2f} px')
        text = (f'{len(self.used)} of {rows}x{columns} views of {pinhole.width}x{pinhole.height} '
                f'px, reference {self.reference}, {residual}')
        return f'{text}; left out: {summary(self.left_out)}' if self.left_out else text


def summary(left_out: Sequence[LeftOut]) -> str:
    """The first frame left out for each reason, and the numbers of others and of spare ones."""
    alike: dict[str, list[str]] = {}  # but for their numbers
    for each in left_out:
        if not each.spare:
            alike.setdefault(_NUMBER.sub('', each.reason), []).append(str(each))
    spare = sum(each.spare for each in left_out)
    groups = list(alike.values())
    parts = [first + (f' and {len(others)} more like it' if others else '')
             for first, *others in groups[:_NAMED]]
    more = sum(map(len, groups[_NAMED:]))
    parts += [f'{more} more'] if more else []
    parts += [f'{spare} of places with a better one'] if spare else []
    return '; '.join(parts)


def assemble(frames: Sequence[SweepFrame], settings: SweepSettings, frame_id: str,
             middle: NDArray[np.float64] | None = None, left_out: Sequence[LeftOut] = ()
             ) -> Sweep:
    """The light field of a sweep.

    frame_id: the camera's optical frame. middle: (4, 4) the planned pose of the grid's middle;
    None: the grid with most cells filled. left_out: frames that were left out before.
    The views are parallel to the reference, the frame nearest to the centre cell, which gives
    stamp and optical frame. Every view has the true position of its frame; cells without a frame
    have weight 0. The views are cropped to their common part.
    Raises LightFieldError, with the frames that were left out, when fewer than two frames are
    good, or when the poses of most frames contradict their pictures.
    """
    good, left = good_pictures(frames, settings)
    left = [*left_out, *left]
    if len(good) < 2:
        raise LightFieldError(f'of {len(frames) + len(left_out)} frames {len(good)} are good, two '
                              f'or more are needed: {summary(left) or "none came"}')
    layout = Layout.from_poses([each.pose for each in good], settings, middle)
    if not layout.inside.any():
        nearest = settings.baseline * layout.away.min()
        raise LightFieldError(
            f'no frame lies in the grid of {settings.rows}x{settings.columns} views, '
            f'{settings.baseline} m apart: the nearest is {nearest:.3f} m off its middle; do plan '
            'and poses belong together?')
    central = int(np.argmin(np.where(layout.inside, layout.away, np.inf)))
    reference = good[central]
    fitting: list[int] = []
    for number, each in enumerate(good):
        # Of two float32 maps; they are made again for the frames that are used.
        rectified = Rectification.from_frames(each, reference, settings)
        reason = _unfit(rectified, each, reference, settings)
        if reason:
            left.append(LeftOut(each.name, reason))
        else:
            fitting.append(number)
    kept = [good[number] for number in fitting]
    chosen, others = one_for_each_cell(
        kept, Layout(layout.cells[fitting], layout.aside[fitting], layout.away[fitting],
                     layout.shape), fitting.index(central))
    left += others
    seen = {each.name: Rectification.from_frames(each, reference, settings)
            for each in chosen.values()}
    return _build(chosen, seen, reference, left, settings, frame_id)


def is_grid(poses: Sequence[NDArray[np.float64]], pinhole: Pinhole, settings: SweepSettings
            ) -> bool:
    """Whether most of one camera's poses (n, 4, 4) are of parallel views on one plane.

    They are not where it goes around an object.
    """
    layout = Layout.from_poses(poses, settings)
    # Large pixels suffice for the share of a view that another one shows.
    side = max(min(pinhole.width, pinhole.height) // _COARSE, 1)
    coarse = Reduction(1, side).pinhole(pinhole)
    pixels = np.zeros((coarse.height, coarse.width, 3), np.uint8)
    frames = [SweepFrame(str(number), 0, pixels, Lens(coarse), pose)
              for number, pose in enumerate(poses)]
    allowed = settings.model_copy(update={'plane': settings.plane / side})
    reference = frames[int(np.argmin(np.where(layout.inside, layout.away, np.inf)))]
    unfit = [_unfit(Rectification.from_frames(each, reference, allowed), each, reference, allowed)
             for each in frames]
    return 2 * unfit.count('') > len(frames)


def _unfit(rectified: Rectification, frame: SweepFrame, reference: SweepFrame,
           settings: SweepSettings) -> str:
    """Reason why a frame cannot be rectified to the reference; empty: it can."""
    pinhole = reference.lens.pinhole
    error = rectified.error(pinhole, settings)
    if error > settings.plane:
        return (f'{1e3 * abs(rectified.offset[2]):.1f} mm off the plane of the views: wrong by '
                f'{error:.2f} px at {settings.near} m, {settings.plane:g} are allowed')
    share = rectified.inside(frame).mean()
    if share < settings.overlap:
        return (f'turned away: it shows {100 * share:.0f} % of the reference '
                f'{reference.name}, {100 * settings.overlap:.0f} are needed')
    return ''


def _build(chosen: dict[tuple[int, int], SweepFrame], seen: dict[str, Rectification],
           reference: SweepFrame, left: list[LeftOut], settings: SweepSettings, frame_id: str
           ) -> Sweep:
    whole = np.logical_and.reduce([seen[each.name].inside(each) for each in chosen.values()])
    window = largest_window(whole)
    pinhole = _seen_by(reference.lens.pinhole, window)
    reduction = Reduction(1, settings.shrink)
    reduction.check_memory(settings.rows, settings.columns, pinhole.height, pinhole.width)
    small = reduction.pinhole(pinhole)
    shape = (settings.rows, settings.columns)
    views = np.zeros((*shape, small.height, small.width, 3), np.float32)
    weights = np.zeros(shape, np.float32)
    positions = nominal_positions(*shape)
    centre = settings.rows // 2, settings.columns // 2
    tracker: CornerTracker | None = None
    residuals: list[float] = []
    wrong: list[LeftOut] = []
    used: dict[tuple[int, int], str] = {}
    for cell, frame in sorted(chosen.items(), key=lambda each: each[0] != centre):
        rectified = seen[frame.name]
        view = reduction.shrunk(rectified.picture(linear_light(frame.image, settings.gamma),
                                                  window))
        if tracker is None:
            tracker = CornerTracker(view, settings.gamma)
        else:
            residual = tracker.residual(view, rectified.offset, small, settings.near)
            if residual is None:
                _LOG.info('%s: too little can be tracked to check its pose', frame.name)
            else:
                residuals.append(residual)
                if residual > settings.residual:
                    wrong.append(LeftOut(frame.name, f'its pose does not fit what it shows: '
                                         f'{residual:.1f} px off, {settings.residual:g} are '
                                         'allowed'))
                    continue
        views[cell], weights[cell], used[cell] = view, 1, frame.name
        positions[cell] = rectified.offset[:2] / settings.baseline
    typical = float(np.median(residuals)) if residuals else math.nan
    if not wrong and len(used) < 2:
        raise LightFieldError(f'one view alone, {reference.name}, can be used: {summary(left)}. '
                              'Views that are not parallel, as of a camera that goes around an '
                              'object, are posed views: write views.yaml, or collect posed_views')
    if len(wrong) > len(used) or len(used) < 2:
        raise LightFieldError(
            f'of {len(chosen)} frames {len(wrong)} show things {typical:.1f} px from where their '
            'poses allow them (median): are the poses those of the optical frame, at the time of '
            f'the exposure, and is the camera calibrated? {summary([*wrong, *left])}')
    grid = ViewGrid(small, settings.baseline, positions, weights)
    light_field = LightField(Header(reference.stamp_ns, frame_id), views, grid,
                             1 / settings.gamma)
    return Sweep(light_field, reference.name, used, (*left, *wrong), typical)


def _seen_by(pinhole: Pinhole, window: tuple[slice, slice]) -> Pinhole:
    rows, columns = window
    height, width = rows.stop - rows.start, columns.stop - columns.start
    if width < 1 or height < 1:
        raise LightFieldError('the frames have no part of the scene in common: they are turned '
                              'too far from each other')
    return pinhole.crop(columns.start, rows.start, width, height)
