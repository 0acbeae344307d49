"""Times the contour map of pictures and of a light field, and a pose from a picture by it."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.bench.dlv import FAR, NEAR, light_field_like_f01
from pmcl_ros.evidence.build_map import REFOCUSED, build_map
from pmcl_ros.evidence.contour_net import contour_net
from pmcl_ros.evidence.refocusing import refocused
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.pipeline import Pipeline
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera, take_view
from pmcl_ros.simulation.scenes.random_scene import Kind, SceneSettings, random_scene

_CAMERA = OrdinaryCamera(width=640, height=480, fx=600, cx=319.5, cy=239.5)
_SIZES = (320, 320), (640, 480), (1500, 1125)
_KINDS: tuple[Kind, ...] = ('glass', 'glass handle', 'opaque block')


@dataclass(frozen=True)
class MapTimes:
    """Medians of several runs, of which the first is not counted.

    ms, cpu_ms: in all, by the clock and of all cores. shares: of the time by the clock, by part;
    parts of a map are timed one by one beside the whole. error_mm: of the worst pose, if any.
    """

    ms: float
    cpu_ms: float
    shares: dict[str, float]
    error_mm: float | None = None


@dataclass(frozen=True)
class MapBench:
    """times: of contour maps and of poses, by what they are made of."""

    times: dict[str, MapTimes]

    def lines(self) -> list[str]:
        """The lines to print."""
        return [f'{name:>38}: {row.ms:5.0f} ms, CPU time {row.cpu_ms:5.0f} ms; '
                + ', '.join(f'{part} {100 * share:.0f} %' for part, share in row.shares.items())
                + ('' if row.error_mm is None else f'; {row.error_mm:.1f} mm from the truth')
                for name, row in self.times.items()]


def bench_map(repeats: int = 9, sizes: tuple[tuple[int, int], ...] = _SIZES, side: int = 328,
              camera: OrdinaryCamera = _CAMERA, kinds: tuple[Kind, ...] = _KINDS) -> MapBench:
    """Maps of noise, which take as long as others; poses of generated objects, one picture each.

    sizes: of pictures [px]. side: of a view of the light field, which is like an F01's. kinds: of
    objects, as `camera` sees them. A pose begins with the picture in memory and ends with the
    estimate; each run has another seed.
    """
    times = {f'map of {width}x{height} px': _of_picture(width, height, repeats)
             for width, height in sizes}
    times[f'map of 7x7 views of {side}x{side} px'] = _of_light_field(side, repeats)
    times |= {f'pose of {kind}, {camera.width}x{camera.height} px': _of_pose(kind, camera, repeats)
              for kind in kinds}
    return MapBench(times)


def _of_picture(width: int, height: int, repeats: int) -> MapTimes:
    noise = np.random.default_rng(0).random((height, width, 3), np.float32)
    pinhole = Pinhole(width, height, width, width, (width - 1) / 2, (height - 1) / 2)
    view = PosedView(Header(), noise, pinhole, np.eye(4))

    def once() -> dict[str, float]:
        return {'network': _timed(lambda: contour_net()(noise))[0]}

    return _medians(lambda: build_map(view, DlvSettings(near=NEAR, far=FAR)), once, repeats)


def _of_light_field(side: int, repeats: int) -> MapTimes:
    light_field, settings = light_field_like_f01(side), DlvSettings(near=NEAR, far=FAR)
    depths = depth_labels(NEAR, FAR, REFOCUSED)
    picture = np.random.default_rng(0).random((side, side, 3), np.float32)

    def once() -> dict[str, float]:
        return {'refocusing': _timed(lambda: refocused(light_field, depths, settings.views))[0],
                'network': _timed(lambda: [contour_net()(picture) for _ in depths])[0]}

    return _medians(lambda: build_map(light_field, settings), once, repeats)


def _of_pose(kind: Kind, camera: OrdinaryCamera, repeats: int) -> MapTimes:
    rng = np.random.default_rng(0)
    scene = random_scene(rng, SceneSettings(kinds=(kind,), empty=0.0, outside=0.0,
                                            field=camera.field), sensor=camera.sensor(rng))
    view, target = take_view(scene, camera, np.eye(4), rng, 4), scene.targets[0]
    model = target.model('target')
    settings = PmclSettings(roi_center=target.roi_center, roi_size=target.roi_size)
    seeds = iter(range(repeats + 1))
    seconds: dict[str, float] = {}
    errors: list[float] = []
    with Pipeline.for_object(model, settings) as pipeline:
        def pose() -> None:
            run = pipeline.run(lambda: view, np.random.default_rng(next(seeds)))
            seconds.update({part: run.seconds[part] for part in ('evidence', 'pose')})
            errors.append(pose_error(run.estimate.pose, target.pose, model.symmetry).translation)

        times = _medians(pose, lambda: dict(seconds), repeats)
    return MapTimes(times.ms, times.cpu_ms, times.shares, 1e3 * max(errors))


def _medians(whole: Callable[[], object], parts: Callable[[], dict[str, float]], repeats: int
             ) -> MapTimes:
    """whole, parts: run in turns; parts: returns how long each took [s]."""
    whole()  # compiles, and fills caches
    parts()
    runs = [(*_timed(whole), parts()) for _ in range(repeats)]
    wall, cpu = (float(np.median([run[k] for run in runs])) for k in range(2))
    shares = {part: float(np.median([run[2][part] for run in runs])) / wall for part in runs[0][2]}
    return MapTimes(1e3 * wall, 1e3 * cpu, shares)


def _timed(step: Callable[[], object]) -> tuple[float, float]:
    """Seconds by the clock, and of all cores."""
    began, busy = time.perf_counter(), time.process_time()
    step()
    return time.perf_counter() - began, time.process_time() - busy
