"""One localisation of one object in one capture, and all its errors."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evaluation.captures import Capture
from pmcl_ros.evaluation.errors import pose_error
from pmcl_ros.evaluation.shared import Shared
from pmcl_ros.evaluation.surface_errors import Surface
from pmcl_ros.evaluation.variants import Variant
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings


@dataclass(frozen=True)
class Trial:
    """One localisation. mode: the row's name. sought: the capture whose object was looked for.

    empty: no object is there. wrong: it is another one, so that all errors are NaN, as with empty.
    translation_mm; ray_mm: signed along the line of sight, positive: too far. axis_deg: of the
    symmetry axis where there is one, else of the whole rotation; dot: its cosine (paper).
    symmetric: whether there is an axis, so that a flip may be forgiven.
    mssd_mm, mspd_px, add_s_mm: as of BOP; diameter_mm: of the object, width_px: of the view.
    credible_level: of the smallest credible region that holds the truth, 0 to 1.
    seconds: from the volume to the pose; dlv_seconds, decode_seconds: for the volume, the views.
    evaluations: poses drawn and scored. renderer: what drew them. pose: (12,) the rows of R | t,
        object to camera, metres.
    """

    capture: str
    mode: str
    seed: int
    sought: str
    film: bool
    empty: bool
    wrong: bool
    translation_mm: float
    ray_mm: float
    axis_deg: float
    dot: float
    flipped: bool
    symmetric: bool
    mssd_mm: float
    mspd_px: float
    add_s_mm: float
    diameter_mm: float
    width_px: int
    credible_level: float
    inside_90: bool
    lost: bool
    score: float
    seconds: float
    dlv_seconds: float
    decode_seconds: float
    evaluations: int
    renderer: str
    pose: tuple[float, ...]

    @property
    def present(self) -> bool:
        """Whether there was something to find: otherwise it should be lost."""
        return not (self.empty or self.wrong)


@dataclass(frozen=True)
class Job:
    """What one trial needs; volume: made in dlv_seconds of views made in decode_seconds."""

    capture: Capture
    sought: Capture
    variant: Variant
    seed: int
    volume: Shared[DepthLikelihoodVolume]
    dlv_seconds: float
    decode_seconds: float


class Worker:
    """Does jobs one after the other, in the thread that made it; keeps what the next may need.

    stopped: asked while a search goes on; when true, the search ends and counts as not done.
    """

    def __init__(self, stopped: Callable[[], bool]) -> None:
        self._stopped = stopped
        self._localizer: Localizer | None = None
        self._settings: tuple[Path, PmclSettings] | None = None  # of the localizer
        self._volume: DepthLikelihoodVolume | None = None
        self._path: Path | None = None  # of the volume

    def run(self, job: Job) -> Trial | None:
        """Do one job; None when it was stopped."""
        model, surface = _model(job.sought.model)
        localizer = self._localizer_of(job, model)
        if self._volume is None or self._path != job.volume.path:
            self._volume, self._path = job.volume.get(), job.volume.path
        started = time.perf_counter()
        estimate = localizer.localize(self._volume, np.random.default_rng(job.seed),
                                      lambda _: not self._stopped())
        seconds = time.perf_counter() - started
        if self._stopped():
            return None
        return _trial(job, estimate, self._volume, model, surface, seconds, localizer.renderer)

    def close(self) -> None:
        """Release the GL context."""
        if self._localizer is not None:
            self._localizer.close()
        self._localizer = self._settings = self._volume = self._path = None

    def _localizer_of(self, job: Job, model: ObjectModel) -> Localizer:
        wanted = job.sought.model, job.variant.search(job.capture)
        if self._localizer is None or self._settings != wanted:
            if self._localizer is not None:
                self._localizer.close()
                self._localizer = None
            self._localizer, self._settings = Localizer(model, wanted[1]), wanted
        return self._localizer


@lru_cache(maxsize=64)
def _model(path: Path) -> tuple[ObjectModel, Surface]:
    model = ObjectModel.load(path)
    return model, Surface.from_model(model)


def _trial(job: Job, estimate: PoseEstimate, volume: DepthLikelihoodVolume, model: ObjectModel,
           surface: Surface, seconds: float, renderer: str) -> Trial:
    wrong = job.sought.object != job.capture.object
    empty = job.capture.truth.empty
    pose = estimate.pose
    truth = job.capture.truth.pose
    known = not (wrong or empty)
    error = pose_error(pose, truth, model.symmetry)

    def if_known(value: float) -> float:
        return value if known else math.nan

    level = model.symmetry.credible_level(truth, pose, estimate.covariance)
    return Trial(
        job.capture.name, job.variant.name, job.seed, job.sought.name, job.capture.truth.film,
        empty, wrong, if_known(1e3 * error.translation), if_known(1e3 * error.ray),
        if_known(float(np.rad2deg(error.rotation))), if_known(error.dot),
        known and error.flipped, model.axis is not None,
        if_known(1e3 * surface.mssd(pose, truth)),
        if_known(surface.mspd(pose, truth, volume.pinhole)),
        if_known(1e3 * surface.add_s(pose, truth)), 1e3 * surface.diameter, volume.pinhole.width,
        if_known(level), known and level <= 0.9, estimate.lost, estimate.score, seconds,
        job.dlv_seconds, job.decode_seconds, estimate.evaluations, renderer, _rows(pose))


def _rows(pose: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(pose[:3].ravel().tolist())
