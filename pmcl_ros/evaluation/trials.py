"""Localises one object in one capture, and measures all errors of the estimate."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evaluation.captures import Capture
from pmcl_ros.evaluation.surface_errors import Surface
from pmcl_ros.evaluation.variants import Variant
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.pose_error import is_right, pose_error
from pmcl_ros.geometry.student_t import median_length
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.readers.read import Source
from pmcl_ros.pipeline import AnyLocalizer, Evidence, make_localizer
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.second_search import evidence_of

Camera = tuple[Calibration, Path]  # with its white image, or a folder of white images
Value = TypeVar('Value')


@dataclass(frozen=True)
class Trial:
    """One localisation, in all studies. What a study does not measure keeps its default.

    Errors and pose of several views are in the frame of the first camera.

    capture: the picture or scene. mode: the row's name. sought: the capture whose object was
    looked for.
    empty: no object is there. wrong: it is another one, so that all errors are NaN, as with empty.
    translation_mm; told_mm: the median of it that the estimate lets expect, by its covariance and
    tails; bound_mm: the median by the Cramér-Rao bound of several views, a Gaussian; ray_mm:
    signed along the line of sight, positive: too far. axis_deg: of the symmetry axis where there
    is one, else of the whole rotation; dot: its cosine (paper).
    symmetric: whether there is an axis, so that a flip may be forgiven.
    mssd_mm, mspd_px, add_s_mm: as of BOP; diameter_mm: of the object, width_px: of the view.
    credible_level: of the smallest credible region that holds the truth, 0 to 1.
    evidence_found, evidence_truth: of the pose found and the true one, in the mode default [nat].
    seconds: from the evidence to the pose; dlv_seconds, decode_seconds: for evidence, views.
    evaluations: poses drawn and scored. renderer: what drew them. pose: (12,) the rows of R | t,
        object to camera, metres.
    extra: numbers of one study, by name; not written to files of trials.
    """

    capture: str
    mode: str
    seed: int
    sought: str = ''
    film: bool = False
    empty: bool = False
    wrong: bool = False
    translation_mm: float = math.nan
    told_mm: float = math.nan
    bound_mm: float = math.nan
    ray_mm: float = math.nan
    axis_deg: float = math.nan
    dot: float = math.nan
    flipped: bool = False
    symmetric: bool = False
    mssd_mm: float = math.nan
    mspd_px: float = math.nan
    add_s_mm: float = math.nan
    diameter_mm: float = math.nan
    width_px: int = 0
    credible_level: float = math.nan
    inside_90: bool = False
    lost: bool = False
    score: float = math.nan
    evidence_found: float = math.nan
    evidence_truth: float = math.nan
    seconds: float = math.nan
    dlv_seconds: float = math.nan
    decode_seconds: float = math.nan
    evaluations: int = 0
    renderer: str = ''
    pose: tuple[float, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict, hash=False)

    @classmethod
    def judge(cls, estimate: PoseEstimate, truth: NDArray[np.float64], model: ObjectModel,
              **others: Any) -> 'Trial':
        """The trial of an estimate against the true pose (4, 4), object to camera.

        others: further fields; with `empty` or `wrong` the errors are NaN.
        """
        fields: dict[str, Any] = {
            'symmetric': model.axis is not None, 'lost': estimate.lost, 'score': estimate.score,
            'evaluations': estimate.evaluations, 'pose': tuple(estimate.pose[:3].ravel().tolist())}
        if not (others.get('empty') or others.get('wrong')):
            error = pose_error(estimate.pose, truth, model.symmetry)
            level = model.symmetry.credible_level(truth, estimate.pose, estimate.covariance,
                                                  estimate.degrees_of_freedom)
            dimensions = model.symmetry.tangent_basis(estimate.pose).shape[1]
            expected = median_length(estimate.covariance[:3, :3], dimensions,
                                     estimate.degrees_of_freedom)
            fields |= {
                'translation_mm': 1e3 * error.translation, 'ray_mm': 1e3 * error.ray,
                'told_mm': 1e3 * expected,
                'axis_deg': float(np.rad2deg(error.rotation)), 'dot': error.dot,
                'flipped': error.flipped, 'credible_level': level, 'inside_90': level <= 0.9}
        return cls(**fields, **others)

    @property
    def near(self) -> bool:
        """Whether the pose is right (`is_right`), lost or not."""
        return is_right(1e-3 * self.translation_mm, np.deg2rad(self.axis_deg))

    @property
    def found(self) -> bool:
        """Whether the object is localised: the pose is right, and not reported as lost."""
        return self.near and not self.lost

    @property
    def present(self) -> bool:
        """Whether there was something to find: otherwise it should be lost."""
        return not (self.empty or self.wrong)


@dataclass(frozen=True)
class Job:
    """What one trial is of. sought: the capture whose object is looked for."""

    capture: Capture
    sought: Capture
    variant: Variant
    seed: int


class _Last(Generic[Value]):
    """The last value that was made, and the time it took; kept until another key is wanted."""

    def __init__(self, release: Callable[[Value], None] = lambda _: None) -> None:
        self._release = release
        self._key: object = None
        self._value: Value | None = None
        self.seconds = 0.0

    def get(self, key: object, make: Callable[[], Value]) -> Value:
        if self._value is None or self._key != key:
            self.clear()  # its memory is free before the next value is made
            started = time.perf_counter()
            self._value, self._key = make(), key
            self.seconds = time.perf_counter() - started
        return self._value

    def clear(self) -> None:
        if self._value is not None:
            self._release(self._value)
            self._value = None


class Worker:
    """Does jobs one after the other, in the thread that made it.

    camera: of raw pictures, calibration and white image; None where there are none.
    stopped: asked while a search goes on; when true, the search ends and counts as not done.

    Keeps the source, the evidence and the localizer of the last job for the next one: jobs
    that share them should follow each other.
    """

    def __init__(self, camera: Camera | None, stopped: Callable[[], bool]) -> None:
        self._camera, self._stopped = camera, stopped
        self._source = _Last[Source]()
        self._pictures: tuple[Path, tuple[Path, ...]] | None = None  # of that
        self._evidence = _Last[Evidence]()
        self._localizer = _Last[AnyLocalizer[PoseEstimate]](lambda localizer: localizer.close())

    def run(self, job: Job) -> Trial | None:
        """Do one job; None when it was stopped."""
        capture, variant = job.capture, job.variant
        model, surface = _model(job.sought.load_model, job.sought.model)
        decoders = self._decoders  # made once, not timed
        pictures = capture.source, capture.pictures
        if pictures != self._pictures:  # the evidence can hold the source of the last job
            self._evidence.clear()
        self._pictures = pictures
        source = self._source.get(pictures, lambda: capture.read(decoders))
        settings = variant.volume(capture, model, source)
        search = variant.search(capture)
        key = (pictures, variant.base, *variant.chosen.values(), settings, search.roi_center,
               model.diameter)
        evidence = self._evidence.get(
            key, lambda: variant.build(source, settings, capture, model))
        posed = isinstance(source, PosedViews)
        localizer = self._localizer.get((job.sought.model, search, posed),
                                        lambda: make_localizer(model, search, posed))
        started = time.perf_counter()
        estimate = localizer.localize(evidence, np.random.default_rng(job.seed),
                                      lambda _: not self._stopped())
        seconds = time.perf_counter() - started
        if self._stopped():
            return None
        truth_pose = capture.truth.pose
        of_poses = (_by_evidence(localizer, evidence, estimate, truth_pose)
                    if job.sought.object == capture.object and not capture.truth.empty else {})
        if isinstance(source, PosedViews):  # errors are told in the frame of the first camera
            into = np.asarray(np.linalg.inv(source.views[0].camera_to_reference), float)
            estimate, truth_pose = estimate.in_frame(into), into @ truth_pose
        return _trial(job, estimate, truth_pose, evidence.pinhole, model, surface,
                      seconds=seconds,
                      dlv_seconds=self._evidence.seconds,
                      decode_seconds=self._source.seconds, renderer=localizer.renderer, **of_poses)

    def close(self) -> None:
        """Release the GL context."""
        self._localizer.clear()

    @cached_property
    def _decoders(self) -> Decoders | None:
        return None if self._camera is None else Decoders(*self._camera)


def evidence_beside_truth(localizer: AnyLocalizer[PoseEstimate], evidence: Evidence,
                          estimate: PoseEstimate, truth: NDArray[np.float64]
                          ) -> NDArray[np.float64] | None:
    """(2,) of the pose found and the true one (4, 4) [nat]; None: the mode faithful has none."""
    poses = np.stack([estimate.pose, truth])
    if isinstance(localizer, Localizer) and isinstance(evidence, EvidenceVolume):
        return localizer.evidence(evidence_of(estimate, evidence), poses)
    if isinstance(localizer, MultiViewLocalizer) and isinstance(evidence, ViewsEvidence):
        return localizer.evidence(evidence, poses)
    return None


def _by_evidence(localizer: AnyLocalizer[PoseEstimate], evidence: Evidence,
                 estimate: PoseEstimate, truth: NDArray[np.float64]) -> dict[str, float]:
    """The fields of a trial that evidence at the true pose (4, 4) gives."""
    both = evidence_beside_truth(localizer, evidence, estimate, truth)
    if both is None:
        return {}
    fields = dict(zip(('evidence_found', 'evidence_truth'), both.tolist(), strict=True))
    if isinstance(localizer, MultiViewLocalizer) and isinstance(evidence, ViewsEvidence):
        fields['bound_mm'] = 1e3 * median_length(localizer.bound(evidence, truth)[:3, :3])
    return fields


@lru_cache(maxsize=64)
def _model(load: Callable[[Path], ObjectModel], path: Path) -> tuple[ObjectModel, Surface]:
    model = load(path)
    return model, Surface.from_model(model)


def _trial(job: Job, estimate: PoseEstimate, truth: NDArray[np.float64], pinhole: Pinhole,
           model: ObjectModel, surface: Surface, **measured: Any) -> Trial:
    """The trial of a job. truth: (4, 4). measured: the rest of its fields."""
    wrong, empty = job.sought.object != job.capture.object, job.capture.truth.empty
    pose = estimate.pose
    if not (wrong or empty):
        measured |= {'mssd_mm': 1e3 * surface.mssd(pose, truth),
                     'mspd_px': surface.mspd(pose, truth, pinhole),
                     'add_s_mm': 1e3 * surface.add_s(pose, truth)}
    return Trial.judge(
        estimate, truth, model, capture=job.capture.name, mode=job.variant.name, seed=job.seed,
        sought=job.sought.name, film=job.capture.truth.film, empty=empty, wrong=wrong,
        diameter_mm=1e3 * surface.diameter, width_px=pinhole.width, **measured)
