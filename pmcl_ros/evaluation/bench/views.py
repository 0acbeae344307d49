"""Times the pose in posed views: a search, and from the pose by one view less."""

import multiprocessing
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evidence.build_views import ViewsEvidenceBuilder
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.pipeline import apparent_size
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_view.incremental_search import IncrementalSearch
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.simulation.camera_plan import CameraPlan
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera, take_view
from pmcl_ros.simulation.scenes.random_scene import Kind, SceneSettings, random_scene
from pmcl_ros.simulation.scenes.scene import Scene, Target

_CAMERA = OrdinaryCamera(width=640, height=480, fx=600, cx=319.5, cy=239.5)
# With an axis of symmetry, and without; both are said to be clear.
_KINDS: tuple[Kind, ...] = ('glass', 'glass handle')
_ARC = 60.0  # degrees, over which the views are spread
T = TypeVar('T')


@dataclass(frozen=True)
class KindTimes:
    """Of one kind of object, for 1, 2, ... views [s].

    evidence: of the last of them, network included. whole: a search of the whole region. further:
    from what was found by one view less. error_mm: of the pose by all views, both ways. peak:
    memory of the process, which did nothing else [MiB].
    """

    evidence: list[float]
    whole: list[float]
    further: list[float]
    error_mm: tuple[float, float]
    peak: float


@dataclass(frozen=True)
class ViewsBench:
    """geometry: of the data. kinds: times by kind of object."""

    geometry: str
    kinds: dict[str, KindTimes]

    def lines(self) -> list[str]:
        """The lines to print."""
        lines = [self.geometry,
                 '        object  views  evidence of one more  search  from the last pose']
        for kind, times in self.kinds.items():
            rows = zip(times.evidence, times.whole, times.further, strict=True)
            lines += [f'{kind:>14}{number:7d}{evidence:20.2f} s{whole:6.2f} s{further:20.2f} s'
                      for number, (evidence, whole, further) in enumerate(rows, 1)]
        return lines + [f'{kind}: {times.error_mm[0]:.1f} mm from the truth by a search, '
                        f'{times.error_mm[1]:.1f} mm from the last pose; {times.peak:.0f} MiB at '
                        'most' for kind, times in self.kinds.items()]


def bench_views(count: int = 9, camera: OrdinaryCamera = _CAMERA, seed: int = 0,
                kinds: tuple[Kind, ...] = _KINDS) -> ViewsBench:
    """Views come one after the other, from the ends of an arc inwards. kinds: of objects."""
    times: dict[str, KindTimes] = {}
    for kind in kinds:
        rng = np.random.default_rng(seed)
        scene = random_scene(rng, SceneSettings(kinds=(kind,), empty=0.0, field=camera.field),
                             sensor=camera.sensor(rng))
        # In a process that made no pictures, and searched for no other object.
        with ProcessPoolExecutor(1, multiprocessing.get_context('spawn')) as pool:
            times[kind] = pool.submit(_timed, scene.targets[0],
                                      _pictures(scene, camera, count, rng), seed).result()
    return ViewsBench(f'{count} views of {camera.width}x{camera.height} px over {_ARC:.0f} '
                      'degrees, objects said to be clear', times)


def _pictures(scene: Scene, camera: OrdinaryCamera, count: int, rng: np.random.Generator
              ) -> list[PosedView]:
    views = [take_view(scene, camera, each, rng, 2)
             for each in CameraPlan(arc=(count, _ARC)).cameras(scene)]
    return [view for pair in zip(views, views[::-1], strict=True) for view in pair][:count]


def _timed(target: Target, views: list[PosedView], seed: int) -> KindTimes:
    model = replace(target.model('target'), clear=True)
    settings = PmclSettings(roi_center=target.roi_center, roi_size=target.roi_size)

    def builder() -> ViewsEvidenceBuilder:
        return ViewsEvidenceBuilder(DlvSettings(), size_in=apparent_size(model, settings))

    def off(estimate: PoseEstimate) -> float:
        return 1e3 * pose_error(estimate.pose, target.pose, model.symmetry).translation

    times = KindTimes([], [], [], (np.nan, np.nan), np.nan)
    with MultiViewLocalizer(model, settings) as localizer:
        localizer.localize(builder().build(PosedViews(tuple(views[:1]))),
                           np.random.default_rng(seed))  # templates are made once
        all_given = [PosedViews(tuple(views[:number])) for number in range(1, len(views) + 1)]
        incremental, kept = IncrementalSearch(localizer), builder()
        for given in map(_received, all_given):
            evidence = _timed_by(times.evidence, partial(kept.build, given))
            further = _timed_by(times.further, partial(
                incremental.localize, evidence, np.random.default_rng(seed)))
        del incremental, kept, evidence
        for given in all_given:
            whole = _timed_by(times.whole, partial(
                localizer.localize, builder().build(given), np.random.default_rng(seed)))
    return replace(times, error_mm=(off(whole), off(further)), peak=_peak())


def _received(views: PosedViews) -> PosedViews:
    """As a node has them: each message brings all pictures anew."""
    return PosedViews(tuple(replace(each, picture=each.picture.copy()) for each in views.views))


def _peak() -> float:
    """Memory that this process has had at most [MiB] (Linux); `getrusage` counts its parent's."""
    status = Path('/proc/self/status').read_text()
    return int(status.partition('VmHWM:')[2].split()[0]) / 1024


def _timed_by(seconds: list[float], do: Callable[[], T]) -> T:
    """What it returns; how long it took is added to the list."""
    began = time.perf_counter()
    result = do()
    seconds.append(time.perf_counter() - began)
    return result
