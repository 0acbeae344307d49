"""Contour maps without a part of what they tell, to see what that part is worth."""

from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from pmcl_ros.evidence.contour_map import DIRECTIONS, ContourMap, likelihood_ratios, series

_INSIDE = 0.02  # weight of the inside: its pixels are many, and not independent


def without_sides(of: ContourMap) -> ContourMap:
    """Which side of a contour the object is on is unknown: both are equally likely."""
    return _averaged(of, 2)


def without_directions(of: ContourMap) -> ContourMap:
    """A contour has the same log odds in each direction: of the mean likelihood ratio."""
    return _averaged(of, DIRECTIONS)


def at_one_depth(of: ContourMap) -> ContourMap:
    """A light field is refocused at one depth only, the middle one."""
    middle = of.tensor.shape[2] // 2
    tensor, inside = (np.ascontiguousarray(each[:, :, middle:middle + 1])
                      for each in (of.tensor, of.inside))
    return replace(of, tensor=tensor, inside=inside)


def with_inside(of: ContourMap) -> ContourMap:
    """The object's inside counts, too."""
    return replace(of, numbers=of.numbers.model_copy(update={'inside_weight': _INSIDE}))


def _averaged(of: ContourMap, directions: int) -> ContourMap:
    """Each direction has the mean likelihood ratio of `directions` that are evenly spaced."""
    ratios = likelihood_ratios(of.tensor)
    mean = np.mean([np.roll(ratios, turn, axis=-1)
                    for turn in range(0, DIRECTIONS, DIRECTIONS // directions)], axis=0)
    return replace(of, tensor=series(mean).astype(np.float32))


ABLATIONS: MappingProxyType[str, Callable[[ContourMap], ContourMap]] = MappingProxyType({
    'map-no-sides': without_sides, 'map-no-directions': without_directions,
    'map-one-depth': at_one_depth, 'map-inside': with_inside})


def ablated(of: ContourMap, row: str) -> ContourMap:
    """A map as a row of `ABLATIONS` reads it; others: as it is."""
    return ABLATIONS[row](of) if row in ABLATIONS else of
