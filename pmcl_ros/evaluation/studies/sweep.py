"""Compares sweeps with a light-field camera: errors of depth and pose, on generated scenes."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.sweep.assemble import assemble
from pmcl_ros.lightfield.sweep.frame import SweepFrame
from pmcl_ros.lightfield.sweep.plan import SweepPlan
from pmcl_ros.lightfield.sweep.settings import SweepSettings
from pmcl_ros.pipeline import Pipeline
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene
from pmcl_ros.simulation.scenes.render import SyntheticCapture, photographs, render


@dataclass(frozen=True)
class Arm:
    """Errors of an arm: standard deviations of normal deviates.

    aside, turned: from the planned pose to the reached one, which the arm reports [m], [rad].
    unknown, unknown_turn: from the reached pose to the reported one, on each axis [m], [rad].
    """

    aside: float = 0.001
    turned: float = 0.005
    unknown: float = 0.0
    unknown_turn: float = 0.0


def compare(count: int, seed: int, widths: tuple[float, ...], views: int, settings: SceneSettings,
            arm: Arm | None = None) -> Iterator[Trial]:
    """Localise in `count` scenes, each seen by a light-field camera and by sweeps.

    widths: of the sweeps [m], of `views` x `views` pictures with the pixels, the noise and the
    blur of the light-field camera.
    Trials: `capture` is the scene, `mode` the camera; extra: `depth_mm` (median error of the most
    likely depth of the object's pixels), `sigma_mm` (the estimate's standard deviation along the
    ray).
    """
    arm = arm or Arm()
    for number in range(seed, seed + count):
        rng = np.random.default_rng(number)
        scene = random_scene(rng, settings)
        capture = render(scene, rng)
        model = capture.model()
        target = capture.targets[0]
        near, far = Region(target.roi_center, target.roi_size).grown(model.radius)
        fields = {'light-field camera': capture.light_field}
        for width in widths:
            of = SweepSettings(rows=views, columns=views, baseline=width / (views - 1), near=near,
                               far=far)
            plan = SweepPlan.from_grid(views, views, of.baseline)
            poses = [_missed(each.pose, arm.aside, arm.turned, rng) for each in plan.poses]
            middle = views * views // 2
            poses = [np.linalg.inv(poses[middle]) @ each for each in poses]
            # The middle one first: the exposure is that of its picture.
            poses = [poses[middle], *poses[:middle], *poses[middle + 1:]]
            frames = [_reported(each, arm, rng) for each in photographs(scene, poses, rng)]
            fields[f'sweep of {1e3 * width:g} mm'] = assemble(frames, of, 'camera').light_field
        search = PmclSettings(roi_center=target.roi_center, roi_size=target.roi_size)
        for name, light_field in fields.items():
            with Pipeline.for_object(model, search) as pipeline:
                run = pipeline.run(lambda: light_field,  # noqa: B023
                                   np.random.default_rng(number), with_volume=True)
            estimate, volume = run.estimate, run.volume
            assert volume is not None
            ray = target.pose[:3, 3] / np.linalg.norm(target.pose[:3, 3])
            sigma = float(np.sqrt(ray @ estimate.covariance[:3, :3] @ ray))
            yield Trial.judge(
                estimate, target.pose, model, capture=scene.name, mode=name, seed=number,
                extra={'depth_mm': 1e3 * _depth_error(volume, capture, light_field),
                       'sigma_mm': 1e3 * sigma})


def _depth_error(volume: DepthLikelihoodVolume, capture: SyntheticCapture,
                 light_field: LightField) -> float:
    """Median over the pixels whose first surface is the target's [m]."""
    whole, seen = capture.light_field.grid.pinhole, light_field.grid.pinhole
    left, top = round(whole.cx - seen.cx), round(whole.cy - seen.cy)
    window = np.s_[top:top + seen.height, left:left + seen.width]
    error = abs(volume.depth_map() - capture.depth[window])[capture.labels[window] == 0]
    return float(np.nanmedian(error)) if np.isfinite(error).any() else np.nan


def _missed(pose: NDArray[np.float64], shift: float, turn: float, rng: np.random.Generator
            ) -> NDArray[np.float64]:
    """A pose (4, 4) off by normal deviates [m], [rad] in its own frame."""
    # An arm keeps its plane better than its place: joints move little between two pictures.
    by = shift * rng.standard_normal(3) * [1, 1, 0.2]
    return pose @ pose_of(Rotation.from_rotvec(turn * rng.standard_normal(3)), by)


def _reported(frame: SweepFrame, arm: Arm, rng: np.random.Generator) -> SweepFrame:
    """A frame with the pose that the arm reports."""
    by = arm.unknown * rng.standard_normal(3)
    turn = Rotation.from_rotvec(arm.unknown_turn * rng.standard_normal(3))
    return replace(frame, pose=frame.pose @ pose_of(turn, by))
