"""Errors of measured profiles, and of poses that are found with them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pmcl_ros.evaluation.recall import share_with_interval
from pmcl_ros.evaluation.results import table_and_list
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.grasps.revolution import Profile
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.pipeline import Pipeline
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.profiles.measure import measured
from pmcl_ros.profiles.measured import MeasuredProfile
from pmcl_ros.profiles.outline import Box
from pmcl_ros.runtime.errors import ProfileError
from pmcl_ros.simulation.camera_plan import CameraPlan
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera, take_view
from pmcl_ros.simulation.scenes.objects import SceneObject, random_transparent
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene
from pmcl_ros.simulation.scenes.scene import Scene, Target
from pmcl_ros.simulation.scenes.shapes.vessels import resampled

_VIEWS, _APART = 3, 60.0  # pictures of a vessel, degrees from the first to the last
_FILLED = 0.8  # of the picture's smaller side: the diagonal of a vessel that is measured
_STEEP = np.deg2rad([10.0, 30.0])  # limits of the angle at which cameras look down on it
_BOX = 2.0  # px: standard deviation of the sides of a box that is drawn
_RULER = 0.0005  # m: standard deviation of a height that is measured
_STEP = 0.0002  # m between points of a profile
_UNDER = 0.9  # of the foot's radius: nearer to the axis is the underside
_NEAR = 0.005, np.deg2rad(5.0)  # m, rad: of a pose that counts
_HEAD = 'seed', 'vessel', 'largest', 'mean', 'expected', 'within 2', 'by the profile', 'by the CAD'


@dataclass(frozen=True)
class ProfileTrial:
    """One vessel: the deviations of its measured profile [mm], and what was found by it.

    largest, mean: distances between the measured profile and the true one, without the underside.
    expected: median standard deviation. within: share of the profile that is within twice of its
    own. All are None where no profile was found.
    by_profile, by_cad: in another scene, with the measured mesh and the true one.
    """

    seed: int
    vessel: str
    largest: float | None
    mean: float | None
    expected: float | None
    within: float | None
    by_profile: Trial | None
    by_cad: Trial | None


@dataclass(frozen=True)
class ProfileStudy:
    """Of `profile_trial`: the camera, and its samples a pixel.

    with_cad: whether the vessel is looked for with its true mesh too. with_height: whether its
    height is given, as measured by a ruler.
    """

    camera: OrdinaryCamera
    samples: int = 3
    with_cad: bool = False
    with_height: bool = False


def profile_trial(seed: int, of: ProfileStudy) -> ProfileTrial:
    """Measure the vessel of a seed where it stands alone, find it in another scene.

    The first scene has no clutter, and cameras so near that the vessel fills `_FILLED` of the
    picture, 10 to 30 degrees above the table; boxes are given in the first and the last view. The
    second one is of the standard distribution.
    """
    rng = np.random.default_rng(seed)
    vessel = random_transparent(rng)
    alone = _scene(rng, of, replace(vessel, way='upright'), clutter=0)
    other = _scene(rng, of, vessel)
    views = _taken(rng, of, alone, _round(rng, of, alone))
    model = alone.targets[0].model('true')
    arc = CameraPlan(arc=(_VIEWS, _APART)).cameras(other)
    others = PosedViews(_taken(rng, of, other, arc))
    found: MeasuredProfile | None = None
    try:
        boxes = {k: _drawn(rng, views[k], alone.targets[0]) for k in (0, len(views) - 1)}
        found = measured(views, boxes, alone.world_from_camera[2],
                         float(np.ptp(_true(model)[:, 1]) + rng.normal(0, _RULER))
                         if of.with_height else None)
    except ProfileError:
        pass
    by_cad = _localised(seed, others, other, model) if of.with_cad else None
    if found is None:
        return ProfileTrial(seed, vessel.name, *5 * (None,), by_cad)
    distances = profile_distances(found, model)
    return ProfileTrial(seed, vessel.name, 1e3 * float(distances.max()),
                        1e3 * float(distances.mean()), 1e3 * float(np.median(found.rows[:, 2])),
                        _within(found, model),
                        _localised(seed, others, other, found.model), by_cad)


def profile_distances(found: MeasuredProfile, model: ObjectModel) -> NDArray[np.float64]:
    """(n,) distances between the measured and the true profile, of points of both [m].

    Both have their origins at mid-height. The underside is left out: no camera above the table
    sees it.
    """
    true = _true(model)
    low, high = true[:, 1].min(), true[:, 1].max()
    foot = true[true[:, 1] < low + 0.003, 0].max()
    seen = ~((true[:, 0] < _UNDER * foot) & (true[:, 1] < (low + high) / 2)
             & (true[:, 1] < low + 0.02)) & (true[:, 1] < high - 1e-6)
    heights, radii, _ = found.rows.T
    wall = np.stack([radii, heights], axis=1)
    ends = np.array([[0, heights[0]], [0, heights[-1]]])
    closed = resampled(np.concatenate([ends[:1], wall, ends[1:]]), _STEP, 2)
    return np.concatenate([cKDTree(closed).query(true[seen])[0],
                           cKDTree(true).query(resampled(wall, _STEP, 2))[0]])


def _within(found: MeasuredProfile, model: ObjectModel) -> float:
    """The share of the measured profile that is within twice its standard deviation."""
    heights, radii, sigma = found.rows.T
    off, _ = cKDTree(_true(model)).query(np.stack([radii, heights], axis=1))
    return float(np.mean(off < 2 * sigma))


def _true(model: ObjectModel) -> NDArray[np.float64]:
    """Points (n, 2) of the true profile: radius and height [m]."""
    return np.concatenate([resampled(each, _STEP, 2)
                           for each in Profile.from_model(model).segments])


def _scene(rng: np.random.Generator, of: ProfileStudy, vessel: SceneObject, clutter: int = 5
           ) -> Scene:
    settings = SceneSettings(kinds=('glass',), empty=0.0, outside=0.0, views=3, clutter=clutter,
                             field=min(of.camera.field, 1.5))
    return random_scene(rng, settings, objects=(vessel,), sensor=of.camera.sensor(rng))


def _round(rng: np.random.Generator, of: ProfileStudy, scene: Scene) -> NDArray[np.float64]:
    """(n, 4, 4) cameras about the target, in the frame of the scene's own camera."""
    target, up = scene.targets[0], scene.world_from_camera[2]
    middle = target.pose[:3, 3]
    distance = float(np.linalg.norm(np.ptp(target.vertices, axis=0))) / (
        _FILLED * of.camera.field)
    look = middle / np.linalg.norm(middle)
    level = look - (look @ up) * up
    level /= np.linalg.norm(level)
    steep = rng.uniform(*_STEEP)
    poses = []
    for angle in np.deg2rad(_APART) * np.linspace(-0.5, 0.5, _VIEWS):
        ahead = Rotation.from_rotvec(angle * up).apply(np.cos(steep) * level) - np.sin(steep) * up
        right = np.cross(ahead, up)
        right /= np.linalg.norm(right)
        aside, roll = rng.normal(0, 0.03, 2), rng.normal(0, 0.1)
        turn = np.stack([right, np.cross(ahead, right), ahead], axis=1)
        poses.append(pose_of(turn @ Rotation.from_rotvec([*aside, roll]).as_matrix(),
                             middle - distance * ahead))
    return np.array(poses)


def _taken(rng: np.random.Generator, of: ProfileStudy, scene: Scene, cameras: NDArray[np.float64]
           ) -> tuple[PosedView, ...]:
    return tuple(take_view(scene, of.camera, pose, rng, of.samples) for pose in cameras)


def _drawn(rng: np.random.Generator, view: PosedView, target: Target) -> Box:
    """The box about a target, as drawn by hand."""
    into = np.linalg.inv(view.camera_to_reference) @ target.pose
    pixels = view.pinhole.project(target.vertices @ into[:3, :3].T + into[:3, 3])
    left, top, right, bottom = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)]) + (
        rng.normal(0, _BOX, 4))
    return float(left), float(top), float(right - left), float(bottom - top)


def _localised(seed: int, views: PosedViews, scene: Scene, model: ObjectModel) -> Trial:
    """The trial of looking for a model in views of a scene."""
    target = scene.targets[0]
    settings = PmclSettings(roi_center=target.roi_center, roi_size=target.roi_size)
    with Pipeline.for_object(model, settings, posed=True) as pipeline:
        run = pipeline.run(lambda: views, np.random.default_rng(seed))
    return Trial.judge(run.estimate, target.pose, model, capture=scene.name, mode=model.name,
                       seed=seed)


def summary(trials: Sequence[ProfileTrial]) -> str:
    """A Markdown table with a row for each vessel, and a list of medians and shares."""
    largest = np.array([np.inf if each.largest is None else each.largest for each in trials])
    quarter, most = np.quantile(largest, (0.25, 0.75), method='nearest')  # inf is among them
    half = np.median(largest)
    measured = [each for each in trials if each.largest is not None]
    lines = [f'profiles: {len(measured)} of {len(trials)}; largest deviation, median of all '
             f'{half:.2f} mm, quartiles {quarter:.2f} and {most:.2f} mm; at most 1 mm in '
             f'{share_with_interval(largest <= 1)}']
    if measured:
        lines.append(
            f'mean deviation {_median(measured, lambda each: each.mean):.2f} mm, expected '
            f'{_median(measured, lambda each: each.expected):.2f} mm; within twice that in '
            f'{100 * _median(measured, lambda each: each.within):.0f} % of a profile (medians)')
    for name, by in (('by the profile', [each.by_profile for each in trials]),
                     ('by the CAD', [each.by_cad for each in trials])):
        if not any(by):
            continue
        near = np.array([_is_near(each) for each in by])
        claimed = np.array([_is_near(each) and each is not None and not each.lost for each in by])
        off = [each.translation_mm for each in by if each is not None]
        lines.append(f'{name}: within 5 mm and 5 degrees in {share_with_interval(near)}, '
                     f'claimed too in {share_with_interval(claimed)}; '
                     f'median error {np.median(off):.2f} mm')
    return table_and_list(_HEAD, [_cells(each) for each in trials], lines)


def _is_near(trial: Trial | None) -> bool:
    return (trial is not None and trial.translation_mm <= 1e3 * _NEAR[0]
            and trial.axis_deg <= np.rad2deg(_NEAR[1]))


def _median(trials: Sequence[ProfileTrial], value: Callable[[ProfileTrial], float | None]
            ) -> float:
    return float(np.median([number for each in trials if (number := value(each)) is not None]))


def _cells(of: ProfileTrial) -> list[str]:
    numbers = ['none' if each is None else f'{each:.2f}'
               for each in (of.largest, of.mean, of.expected, of.within)]
    return [str(of.seed), of.vessel, *numbers, *(_errors(each) for each in (
        of.by_profile, of.by_cad))]


def _errors(trial: Trial | None) -> str:
    """Errors in mm and degrees, in brackets where lost."""
    if trial is None:
        return 'none'
    word = f'{trial.translation_mm:.1f} mm, {trial.axis_deg:.1f}°'
    return f'({word})' if trial.lost else word
