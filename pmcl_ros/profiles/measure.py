"""Views and boxes -> the profile of the surface of revolution that they show."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evidence.build_map import build_map
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.profiles.fit import deviations, normal_equations, refined, with_usual_edge
from pmcl_ros.profiles.foot import standing_on_foot
from pmcl_ros.profiles.measured import MeasuredProfile
from pmcl_ros.profiles.outline import LEAST_SIDE, Box, BoxedView, Cylinder, cylinder_in
from pmcl_ros.profiles.revolution import Revolution
from pmcl_ros.profiles.search import PosedMap, searched
from pmcl_ros.runtime.errors import ProfileError

Stage = tuple[float, float, int]  # blur, reach, steps

_LOG = logging.getLogger(__name__)
_KNOT = 0.0025  # m between knots of the profile, along it
_ALIKE = 0.95  # of the evidence: with so much of it a stem is on a foot, not on a cone
_AROUND = 20.0  # px about a box that the object may reach into
# Rounds: blur of the maps while the profile is searched; then stages: while it is refined, with
# the standard deviation of the contour's offset [px], and the number of steps.
_ROUNDS = ((3.0, ((3.0, 6.0, 8), (1.0, 3.0, 6))), (1.5, ((1.0, 3.0, 6), (0.5, 1.5, 8))))


def measured(views: Sequence[PosedView], boxes: Mapping[int, Box], up: NDArray[np.float64],
             height: float | None = None) -> MeasuredProfile:
    """The surface of revolution that views show in boxes.

    boxes: by number of the view, in two views at least, or in one with the height [m] of the
    object. up: (3,) about the direction of its axis in the reference frame.
    Raises ProfileError where the boxes are impossible or hold no outline, and as `build_map`.
    """
    boxed = [BoxedView(views[k].pinhole, views[k].camera_to_reference, box, f'view {k}')
             for k, box in boxes.items()]
    about = cylinder_in(boxed, up, height)
    maps = [each for k, view in enumerate(views)
            if (each := _map_of(view, boxes.get(k), about, k)) is not None]
    for blur, stages in _ROUNDS:
        surface = _fitted(searched([each.blurred(blur) for each in maps], about, _KNOT), maps,
                          stages, height)
        stem = standing_on_foot(surface, _KNOT)
        if stem is not None:
            stem = _fitted(stem, maps, stages, height)
            if _evidence(stem, maps, stages[-1]) > _ALIKE * _evidence(surface, maps, stages[-1]):
                surface = stem
        about = replace(about, frame=surface.centred)
    blur, reach, steps = _ROUNDS[-1][1][-1]
    finest = [each.blurred(blur) for each in maps]
    if height is None:
        surface = with_usual_edge(surface, finest, reach, steps)
    found = normal_equations(surface, finest, reach)
    least = maps[0].evidence.profile.least
    mean = found.evidence / max(found.length, 1.0)
    _LOG.info('outline of %.0f px, %.2f nat/px%s', found.length, mean,
              ', a stem on a foot' if surface.on_foot else '')
    if mean < least:
        raise ProfileError(f'no outline fits: its evidence is {mean:.2f} nat/px, {least:.2f} at '
                           'least are expected; take the pictures from nearer, from other sides, '
                           'before a plain background, and check boxes and camera poses')
    return MeasuredProfile(surface, deviations(surface, finest, reach, height), mean, least)


def _fitted(surface: Revolution, maps: Sequence[PosedMap], stages: Sequence[Stage],
            height: float | None) -> Revolution:
    """The surface, refined in stages."""
    for blur, reach, steps in stages:
        surface = refined(surface, [each.blurred(blur) for each in maps], reach, steps, height)
    return surface


def _evidence(surface: Revolution, maps: Sequence[PosedMap], stage: Stage) -> float:
    """Of all contours, also those before the surface, by which surfaces are compared [nat]."""
    blur, reach, _ = stage
    return normal_equations(replace(surface, on_foot=True), [each.blurred(blur) for each in maps],
                            reach).evidence


def _map_of(view: PosedView, drawn: Box | None, about: Cylinder, number: int) -> PosedMap | None:
    """The evidence of a view in the box that is drawn there, or that follows from the others.

    None where that is out of view.
    """
    if drawn is not None:
        return _map(view, drawn, True)
    box = about.box_in(view.pinhole, view.camera_to_reference)
    seen = np.minimum([box[0] + box[2], box[1] + box[3]], [view.pinhole.width, view.pinhole.height]
                      ) - np.maximum(box[:2], 0)
    if not (np.isfinite(box).all() and (seen >= LEAST_SIDE).all()):
        _LOG.warning('view %d does not see the object in the boxes of the others: it is left out',
                     number)
        return None
    return _map(view, box, False)


def _map(view: PosedView, box: Box, drawn: bool) -> PosedMap:
    left, top = (max(int(each - _AROUND), 0) for each in box[:2])
    right = min(int(box[0] + box[2] + _AROUND) + 1, view.pinhole.width)
    bottom = min(int(box[1] + box[3] + _AROUND) + 1, view.pinhole.height)
    crop = left, top, right - left, bottom - top
    evidence = build_map(view, DlvSettings(crop=crop))
    return PosedMap(evidence, view.camera_to_reference,
                    (box[0] - left, box[1] - top, box[0] + box[2] - left, box[1] + box[3] - top),
                    drawn)
