"""What a next view brings: the one that is expected to bring most beside a random one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evaluation.recall import median, share_with_interval, values
from pmcl_ros.evaluation.results import table_and_list
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.pipeline import Pipeline, Run
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_view.next_view import (
    CANDIDATES,
    CAP,
    NextView,
    cap,
    next_views,
    position_sigma,
)
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import SimulationError
from pmcl_ros.simulation.camera_plan import CameraPlan
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera, take_view
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene
from pmcl_ros.simulation.scenes.scene import Scene

_LARGE = 1.0  # m: of a table or a wall
_CLEAR = 0.05  # m: between a camera and these
_HEAD = ('seed', 'scene', 'before', 'best', 'random')


@dataclass(frozen=True)
class ViewGain:
    """The trials of one scene: two views, these and the best candidate, these and a random one.

    Their extra has `sigma_mm`, the largest standard deviation of the position by the estimate, and
    `expected_mm`, that by `next_views` before the view was taken.
    """

    seed: int
    before: Trial
    best: Trial
    random: Trial

    @property
    def begun(self) -> bool:
        """Whether the first two views found the object."""
        return self.before.found


@dataclass(frozen=True)
class ViewGainSettings:
    """Of `view_gain`.

    scenes: how they are drawn. camera: takes the pictures, with so many samples a pixel. apart:
    angle between the first two views about the object [deg]. cap, candidates: as of `cap`.
    """

    scenes: SceneSettings
    camera: OrdinaryCamera
    samples: int = 3
    apart: float = 10.0
    cap: float = CAP
    candidates: int = CANDIDATES


def view_gain(seed: int, of: ViewGainSettings) -> ViewGain:
    """Render the scene of a seed, find its object in two views, look again, find it again.

    Candidates beyond the table or the wall are left out: no arm gets there. Poses are in the frame
    of the scene's own camera, which is between the first two. Raises SimulationError where no
    candidate is left.
    """
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, of.scenes, sensor=of.camera.sensor(rng))
    target = scene.targets[0]
    model = target.model('target')
    settings = PmclSettings(roi_center=target.roi_center, roi_size=target.roi_size)

    def taken(pose: NDArray[np.float64]) -> PosedView:
        return take_view(scene, of.camera, pose, rng, of.samples)

    with Pipeline.for_object(model, settings, posed=True) as pipeline:
        def found(views: Sequence[PosedView]) -> Run[PoseEstimate]:
            return pipeline.run(lambda: PosedViews(tuple(views)), np.random.default_rng(seed))

        def trial(estimate: PoseEstimate, mode: str, expected: float) -> Trial:
            return Trial.judge(
                estimate, target.pose, model, capture=scene.name, mode=mode, seed=seed, extra={
                    'sigma_mm': 1e3 * position_sigma(estimate.covariance),
                    'expected_mm': 1e3 * expected})

        cameras = CameraPlan(arc=(2, of.apart)).cameras(scene)
        views = [taken(each) for each in cameras]
        first = found(views)
        assert isinstance(first.evidence, ViewsEvidence)
        candidates = reachable(scene, cap(first.estimate.pose, list(cameras), of.cap,
                                          of.candidates))
        if not candidates.size:
            raise SimulationError(
                f'seed {seed}: table and wall are before all {of.candidates} candidates of '
                f'{of.cap:g} degrees: give more --candidates, or another --cap')
        best, *others = next_views(first.estimate.found_in(first.evidence), model, settings,
                                   first.estimate.pose, candidates, of.camera.pinhole)
        other = others[int(rng.integers(len(others)))] if others else best

        def looked(view: NextView, mode: str) -> Trial:
            return trial(found([*views, taken(view.camera)]).estimate, mode, view.sigma)

        return ViewGain(seed, trial(first.estimate, 'before', best.now), looked(best, 'best'),
                        looked(other, 'random'))


def reachable(scene: Scene, cameras: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those of cameras (n, 4, 4) on the side of table and wall where the scene's own camera is."""
    inside = np.ones(len(cameras), bool)
    for each in scene.sheets:
        if min(each.size) >= _LARGE and each.opacity == 1:
            into = np.linalg.inv(each.pose)[2]
            inside &= np.sign(into[3]) * (cameras[:, :3, 3] @ into[:3] + into[3]) > _CLEAR
    return cameras[inside]


def summary(scenes: Sequence[ViewGain]) -> str:
    """A Markdown table with a row for each scene, and a list of medians and shares."""
    begun = [each for each in scenes if each.begun]
    wrong = sum(not (each.begun or each.before.lost) for each in scenes)
    lines = [f'{len(scenes)} scenes; the first two views find the object in '
             f'{share_with_interval([each.begun for each in scenes])}; wrong: {wrong}',
             *_lines('these', begun), *_lines('all', scenes)]
    return table_and_list(_HEAD, [_cells(each) for each in scenes], lines)


def _lines(name: str, scenes: Sequence[ViewGain]) -> list[str]:
    if not scenes:
        return []
    rows = {mode: [getattr(each, mode) for each in scenes]
            for mode in ('before', 'best', 'random')}
    sigmas = ', '.join(f'{mode} {median(each, "sigma_mm"):.2f} mm' for mode, each in rows.items())
    errors = ', '.join(f'{mode} {median(each, "translation_mm"):.2f} mm'
                       for mode, each in rows.items())
    found = ', '.join(f'{mode} {sum(one.found for one in each)}' for mode, each in rows.items())
    nearer = values(rows['best'], 'translation_mm') < values(rows['random'], 'translation_mm')
    surer = values(rows['best'], 'sigma_mm') < values(rows['random'], 'sigma_mm')
    return [f'{name}, median standard deviation: {sigmas}; expected with the best '
            f'{median(rows["best"], "expected_mm"):.2f} mm',
            f'{name}, median error: {errors}',
            f'{name}, the best is nearer the truth than the random one: '
            f'{share_with_interval(nearer)}; surer: {share_with_interval(surer)}',
            f'{name}, found: {found} of {len(scenes)}']


def _cells(scene: ViewGain) -> list[str]:
    return [str(scene.seed), scene.before.capture,
            *(_errors(each) for each in (scene.before, scene.best, scene.random))]


def _errors(trial: Trial) -> str:
    """Error, in brackets where lost; standard deviation, and what was expected [mm]."""
    word = f'{trial.translation_mm:.2f}' if trial.near else 'elsewhere'
    return (f'({word})' if trial.lost else word) + (
        f' ± {trial.extra["sigma_mm"]:.2f}, expected {trial.extra["expected_mm"]:.2f}')
