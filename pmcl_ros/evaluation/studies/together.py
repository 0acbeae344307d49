"""Scenes of several objects, each localised jointly with the others and alone."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.drawing.pictures import outlines
from pmcl_ros.evaluation.errors import is_right, pose_error
from pmcl_ros.evidence.edges import EdgeVolume, edge_volume
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_object.scene_localizer import SceneEstimate, SceneLocalizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.simulation.scenes.group_scene import group_scene, seen_overlap
from pmcl_ros.simulation.scenes.objects import random_opaque, random_transparent
from pmcl_ros.simulation.scenes.random_scene import SceneSettings
from pmcl_ros.simulation.scenes.render import SyntheticCapture, render

ALIKE = 0.002, math.radians(2)  # m, rad: so much worse is as well


@dataclass(frozen=True)
class Found:
    """One pose that was found. translation: [m]; rotation: [rad], between the axes."""

    translation: float
    rotation: float
    lost: bool

    @property
    def near(self) -> bool:
        """Whether the pose is that of the object."""
        return is_right(self.translation, self.rotation)

    @property
    def rank(self) -> int:
        """2: it is found; 1: it is lost, and told so; 0: it is said to be elsewhere."""
        return 1 if self.lost else 2 * self.near

    def as_well_as(self, other: 'Found') -> bool:
        """Ranked not lower; and where both are found, off by at most 2 mm and 2 degrees more."""
        return self.rank > other.rank or (self.rank == other.rank and (
            self.rank < 2 or self._as_near_as(other)))

    def placed_as_well_as(self, other: 'Found') -> bool:
        """The same by the pose alone, whether lost or not."""
        return not other.near or self._as_near_as(other)

    def _as_near_as(self, other: 'Found') -> bool:
        return (self.translation <= other.translation + ALIKE[0]
                and self.rotation <= other.rotation + ALIKE[1])


@dataclass(frozen=True)
class Together:
    """One scene. together, alone: of its objects. copies: whether two of them are alike.

    overlap: of the smaller of two outlines, at most. depth: of the deepest pair [m].
    absent, absent_alone: whether one that is not there was told to be lost, so searched.
    seconds: the joint search takes, with those for each alone. picture: outlines of what is found.
    """

    seed: int
    name: str
    copies: bool
    overlap: float
    together: tuple[Found, ...]
    alone: tuple[Found, ...]
    depth: float
    absent: bool
    absent_alone: bool
    seconds: float
    picture: NDArray[np.uint8]


def together(seed: int, count: int, settings: SceneSettings, samples: int) -> Together:
    """Render the scene of a seed, and look for its objects, and for one that is not there.

    An object alone is searched for in the same volume and region; of two copies the nearer counts.
    """
    rng = np.random.default_rng(seed)
    group = group_scene(rng, count, settings)
    capture = render(group.scene, rng, samples)
    models = [capture.model(k) for k in range(count)]
    models = [models[k] for k in group.copies]
    other = random_transparent(rng) if rng.random() < 0.5 else random_opaque(rng)
    missing = ObjectModel('missing', other.vertices, other.faces, other.axis, True)
    target = capture.targets[0]
    search = PmclSettings(roi_center=target.roi_center, roi_size=target.roi_size,
                          renderer='numba')
    edges = _edges(capture, [*models, missing], search)
    with SceneLocalizer([*models, missing], search) as localizer:
        started = time.perf_counter()
        found = localizer.localize(edges, np.random.default_rng(seed))
        seconds = time.perf_counter() - started
    truths = [[each.pose for each, same in zip(capture.targets, group.copies, strict=True)
               if same == copy] for copy in group.copies]
    alone = tuple(min((_found(one, truth, model) for truth in near), key=lambda e: e.translation)
                  for one, near, model in zip(found.alone, truths, models, strict=False))
    jointly = _matched(found.estimates[:count], truths, models)
    return Together(seed, group.scene.name, len(set(group.copies)) < count,
                    seen_overlap(capture.targets, group.scene.sensor.grid.pinhole), jointly, alone,
                    found.depth, found.estimates[-1].lost, found.alone[-1].lost, seconds,
                    _picture(capture, found, [*models, missing]))


def _edges(capture: SyntheticCapture, models: Sequence[ObjectModel], search: PmclSettings
           ) -> EdgeVolume:
    """The evidence for all of the models in the region."""
    region = Region(search.roi_center, search.roi_size)
    labels = depth_labels(*region.grown(max(each.radius for each in models)),
                          DlvSettings().edge_labels)
    views = capture.light_field.views.shape[0]
    return edge_volume(capture.light_field, labels, views)


def _matched(estimates: Sequence[PoseEstimate], truths: Sequence[Sequence[NDArray[np.float64]]],
             models: Sequence[ObjectModel]) -> tuple[Found, ...]:
    """Each estimate against its truth; copies each against another one, what is found first."""
    free = [list(near) for near in truths]
    taken: list[int] = []
    result: dict[int, Found] = {}
    for k in sorted(range(len(estimates)), key=lambda k: estimates[k].lost):
        left = [truth for truth in free[k] if id(truth) not in taken]
        errors = [_found(estimates[k], truth, models[k]) for truth in left]
        best = min(range(len(left)), key=lambda j: errors[j].translation)
        taken.append(id(left[best]))
        result[k] = errors[best]
    return tuple(result[k] for k in range(len(estimates)))


def _found(estimate: PoseEstimate, truth: NDArray[np.float64], model: ObjectModel) -> Found:
    error = pose_error(estimate.pose, truth, model.symmetry)
    return Found(error.translation, error.rotation, estimate.lost)


def _picture(capture: SyntheticCapture, found: SceneEstimate, models: Sequence[ObjectModel]
             ) -> NDArray[np.uint8]:
    there = [(model, each.pose, name) for model, each, name
             in zip(models, found.estimates, found.names, strict=True) if not each.lost]
    return outlines(capture.light_field.picture(), capture.light_field.grid.pinhole, there)
