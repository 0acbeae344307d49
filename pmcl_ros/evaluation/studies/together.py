"""Compares the joint localisation of several objects with single ones, on generated scenes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.drawing.pictures import contact_sheet, displayed, outlines
from pmcl_ros.drawing.view_overlay import outlines_in_view
from pmcl_ros.evaluation.recall import median, share
from pmcl_ros.evaluation.results import table_and_list
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.geometry.pose_error import RIGHT_BOUNDS
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.readers.read import Source
from pmcl_ros.pipeline import Pipeline
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_object.penetration import MAX_PENETRATION
from pmcl_ros.pmcl.multi_object.scene_estimate import SceneEstimate
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.simulation.camera_plan import CameraPlan
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera, take_view
from pmcl_ros.simulation.scenes.group_scene import group_scene, seen_overlap
from pmcl_ros.simulation.scenes.objects import random_opaque, random_transparent
from pmcl_ros.simulation.scenes.random_scene import SceneSettings
from pmcl_ros.simulation.scenes.render import render
from pmcl_ros.simulation.scenes.scene import Scene

# The ordinary camera of studies in posed views.
CAMERA = {'width': 640, 'height': 480, 'fx': 600.0, 'cx': 319.5, 'cy': 239.5}
_ALIKE = 2.0, 2.0  # mm, degrees: so much worse still counts as equally good
_HEAD = ('seed', 'objects', 'overlap', 'alone', 'together', 'as well', 'deepest', 'missing one',
         'time')


@dataclass(frozen=True)
class Together:
    """The trials of one scene.

    copies: whether two of its objects are copies. overlap: largest share of an outline that two
    objects cover. together, alone: a trial for each object, the last one for an object that is
    not there. depth: how deep the deepest pair lies in each other [m]. seconds: of the joint
    search with those for each object. picture: outlines of the objects found.
    """

    seed: int
    name: str
    copies: bool
    overlap: float
    together: tuple[Trial, ...]
    alone: tuple[Trial, ...]
    depth: float
    seconds: float
    picture: NDArray[np.uint8]

    @property
    def pairs(self) -> list[tuple[Trial, Trial]]:
        """(together, alone) of the objects that are there."""
        return list(zip(self.together[:-1], self.alone[:-1], strict=True))


def together(seed: int, count: int, settings: SceneSettings, samples: int,
             plan: CameraPlan | None = None) -> Together:
    """Render the scene of a seed, and localise its objects and one that is not there.

    An object alone is localised with the same evidence and region; of two copies the nearer one
    counts. plan: of the posed views of an ordinary camera; None: a light field.
    """
    rng = np.random.default_rng(seed)
    camera = None if plan is None else OrdinaryCamera.make(CAMERA)
    group = group_scene(rng, count, settings, None if camera is None else camera.sensor(rng))
    source = (render(group.scene, rng, samples).light_field if camera is None or plan is None
              else _posed_views(group.scene, camera, plan, rng, samples))
    targets = group.scene.targets
    made = [each.model(f'target {k}') for k, each in enumerate(targets)]
    models = [made[k] for k in group.copies]
    other = random_transparent(rng) if rng.random() < 0.5 else random_opaque(rng)
    models.append(ObjectModel('missing', other.vertices, other.faces, other.axis, True))
    search = PmclSettings(roi_center=targets[0].roi_center, roi_size=targets[0].roi_size,
                          renderer='numba')
    with Pipeline.for_objects(models, search, {'views': settings.views}, 'pmcl together',
                              plan is not None) as pipeline:
        run = pipeline.run(lambda: source, np.random.default_rng(seed))
    found, seconds = run.estimate, run.seconds['pose']
    truths = [[each.pose for each, same in zip(targets, group.copies, strict=True)
               if same == copy] for copy in group.copies]

    def trial(estimate: PoseEstimate, k: int, truth: NDArray[np.float64], mode: str) -> Trial:
        return Trial.judge(estimate, truth, models[k], capture=group.scene.name, mode=mode,
                           seed=seed, empty=k == count)

    alone = [min((trial(found.alone[k], k, truth, 'alone') for truth in truths[k]),
                 key=lambda each: each.translation_mm) for k in range(count)]
    jointly = _judged(found.estimates, truths, partial(trial, mode='together'))
    nowhere = np.eye(4)
    return Together(
        seed, group.scene.name, len(set(group.copies)) < count,
        seen_overlap(targets, group.scene.sensor.grid.pinhole),
        (*jointly, trial(found.estimates[-1], count, nowhere, 'together')),
        (*alone, trial(found.alone[-1], count, nowhere, 'alone')), found.depth, seconds,
        _picture(source, found, models))


def _judged(estimates: Sequence[PoseEstimate], truths: Sequence[Sequence[NDArray[np.float64]]],
            trial: Callable[[PoseEstimate, int, NDArray[np.float64]], Trial]) -> list[Trial]:
    """The trial of each object. truths: of each and its copies, poses (4, 4).

    Each copy is judged against another truth; those that were found choose first.
    """
    made: dict[int, Trial] = {}
    taken: list[int] = []
    for k in sorted(range(len(truths)), key=lambda k: estimates[k].lost):
        trials = {id(truth): trial(estimates[k], k, truth) for truth in truths[k]
                  if id(truth) not in taken}
        nearest = min(trials, key=lambda each: trials[each].translation_mm)
        taken.append(nearest)
        made[k] = trials[nearest]
    return [made[k] for k in range(len(truths))]


def rank(trial: Trial) -> int:
    """2: the object is found; 1: it is reported as lost; 0: it is claimed elsewhere."""
    return 1 if trial.lost else 2 * trial.near


def as_well_as(one: Trial, other: Trial) -> bool:
    """Ranked not lower; and where both are found, off by at most 2 mm and 2 degrees more."""
    return rank(one) > rank(other) or (rank(one) == rank(other) and (
        rank(one) < 2 or _as_near_as(one, other)))


def placed_as_well_as(one: Trial, other: Trial) -> bool:
    """The same by the pose alone, whether lost or not."""
    return not other.near or _as_near_as(one, other)


def _as_near_as(one: Trial, other: Trial) -> bool:
    return (one.translation_mm <= other.translation_mm + _ALIKE[0]
            and one.axis_deg <= other.axis_deg + _ALIKE[1])


def summary(scenes: Sequence[Together]) -> str:
    """A Markdown table with a row for each scene, and a list of shares over all scenes."""
    pairs = [pair for each in scenes for pair in each.pairs]
    singles = [pair for each in scenes if not each.copies for pair in each.pairs]
    lines = [
        f'{len(scenes)} scenes, {len(pairs)} objects; localised as well together as alone: '
        f'{_share([as_well_as(*pair) for pair in pairs])}; where no two are alike: '
        f'{_share([as_well_as(*pair) for pair in singles])}',
        'by the pose alone, lost or not: '
        f'{_share([placed_as_well_as(*pair) for pair in pairs])}',
        _ranks('alone', [other for _, other in pairs]),
        _ranks('together', [one for one, _ in pairs]),
        f'pairs deeper in each other than {1e3 * MAX_PENETRATION:.0f} mm: '
        f'{_share([each.depth > MAX_PENETRATION for each in scenes])} of scenes, the deepest '
        f'{1e3 * max(each.depth for each in scenes):.1f} mm',
        'the missing one reported as lost: '
        f'{_share([each.together[-1].lost for each in scenes])}, alone '
        f'{_share([each.alone[-1].lost for each in scenes])}',
        f'median time {np.median([each.seconds for each in scenes]):.1f} s']
    return table_and_list(_HEAD, [_cells(each) for each in scenes], lines)


def _ranks(name: str, trials: Sequence[Trial]) -> str:
    near = [each for each in trials if each.near]
    found, lost, elsewhere = (_share([rank(each) == k for each in trials]) for k in (2, 1, 0))
    mm, degrees = RIGHT_BOUNDS
    return (f'{name}: found {found}, lost {lost}, elsewhere {elsewhere}; within {mm / 10:g} cm '
            f'and {degrees:g} degrees, lost or not, {_share([each.near for each in trials])}, '
            f'their median error {median(near, "translation_mm"):.1f} mm')


def _cells(scene: Together) -> list[str]:
    as_well = [as_well_as(*pair) for pair in scene.pairs]
    return [str(scene.seed), scene.name + (', two alike' if scene.copies else ''),
            f'{100 * scene.overlap:.0f} %', _errors(scene.alone[:-1]),
            _errors(scene.together[:-1]), f'{sum(as_well)} of {len(as_well)}',
            f'{1e3 * scene.depth:.1f} mm', 'lost' if scene.together[-1].lost else 'found',
            f'{scene.seconds:.0f} s']


def _errors(trials: Sequence[Trial]) -> str:
    """Errors [mm]; in brackets where the object is lost; 'elsewhere' where the pose is wrong."""
    words = [f'{each.translation_mm:.1f}' if each.near else 'elsewhere' for each in trials]
    return ', '.join(f'({word})' if each.lost else word
                     for word, each in zip(words, trials, strict=True))


def _share(flags: Sequence[bool]) -> str:
    return f'{100 * share(flags):.0f} % ({sum(flags)} of {len(flags)})' if flags else 'none'


def _posed_views(scene: Scene, camera: OrdinaryCamera, plan: CameraPlan,
                 rng: np.random.Generator, samples: int) -> PosedViews:
    """In the frame of the scene's own camera, with the errors of the plan."""
    poses = plan.cameras(scene)
    sigma = 1e-3 * plan.sigma_mm, float(np.deg2rad(plan.sigma_deg))
    return PosedViews(tuple(
        replace(take_view(scene, camera, pose, rng, samples), camera_to_reference=reported,
                sigma=sigma, group='arm', common=plan.common)
        for pose, reported in zip(poses, plan.reported(poses, rng), strict=True)))


def _picture(source: Source, found: SceneEstimate, models: Sequence[ObjectModel]
             ) -> NDArray[np.uint8]:
    there = [(model, each.pose, name) for model, each, name
             in zip(models, found.estimates, found.names, strict=True) if not each.lost]
    if isinstance(source, PosedViews):
        return contact_sheet([outlines_in_view(each, there, None) for each in source.views])
    return outlines(displayed(source), source.pinhole, there)
