"""PoseEstimate: the pose of an object in one capture, its covariance, particles and modes."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.evidence.posed_evidence import AssumedCameras, ViewsEvidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import retract, rotate_covariance
from pmcl_ros.pmcl.multi_view.camera_errors import CameraScale

FOLLOWED = 'followed'  # the mode of an estimate that was found near a prediction
_JUDGED = 'support', 'evidence', 'inside', 'least_support', 'least_evidence', 'least_weight'


@dataclass(frozen=True)
class PoseMode:
    """A mode of the posterior.

    pose: (4, 4), object to camera, metres. weight: its share of the posterior, 0 to 1. score: of
    the pose, in the unit of the search mode.
    """

    pose: NDArray[np.float64]
    weight: float
    score: float


@dataclass(frozen=True)
class PoseEstimate:
    """The pose of the mesh frame in the camera's optical frame.

    pose: (4, 4) float64, object to camera, metres.
    covariance: (6, 6) float64, x, y, z [m^2], then rotations about the fixed axes of the camera's
        frame [rad^2]; a free axis of symmetry has variance pi^2 / 3.
    degrees_of_freedom: of the Student's t of the errors, whose 90 % region is that of the Gaussian
        with this covariance (`geometry/student_t.py`); inf: the Gaussian.
    particles: (n, 4, 4) the last population. log_weights: (n,) normalised.
    score: of the pose: evidence [nat] in the mode default, mean likelihood in the mode faithful.
    lost: the data support no pose.
    modes: of the posterior, by weight, largest first; the estimate is of the first. A mode without
        support has weight 0, or is left out while an object is tracked. Empty in the mode
        faithful.
    support: mean evidence along the weakest part of the contour (`support.py`), evidence: along
        all of it [nat / px]; NaN in the mode faithful.
    inside: mean log odds that the pixels which it covers show a solid [nat / px], of several views
        their mean; NaN where the evidence does not tell.
    evaluations: number of poses that were rendered and scored.
    incomplete: the support is too small, but the evidence of the whole contour is sufficient.
    in_view: share of the mesh's vertices in the image.
    least_support, least_evidence, least_weight: the thresholds that support, evidence and the
        weight of the first mode were compared with; the first depends on the others.
    disagreement: of several views: median square by which each alone would move the contour,
        relative to what the model error of one view lets expect; NaN of one view.
    beyond: of several views: mean evidence for other contours beyond this one's [nat / px]; NaN of
        one view.
    camera_scale: the scale error of the cameras' poses, by its size; None: not looked for.
    hidden: numbers of the views that do not show it there, and were not used.
    cameras: those that it was found with, where it is lost with those given (of the views that
        are used).
    evidence_of: kind of the other evidence that it was found in and that its numbers are of, where
        edges lose the object or are unsure of it; else empty.
    """

    header: Header
    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    particles: NDArray[np.float64]
    log_weights: NDArray[np.float64]
    score: float
    lost: bool
    mode: str
    modes: tuple[PoseMode, ...] = ()
    support: float = math.nan
    evidence: float = math.nan
    inside: float = math.nan
    evaluations: int = 0
    incomplete: bool = False
    in_view: float = 1.0
    least_support: float = math.nan
    least_evidence: float = math.nan
    least_weight: float = math.nan
    disagreement: float = math.nan
    beyond: float = math.nan
    camera_scale: CameraScale | None = None
    hidden: tuple[int, ...] = ()
    cameras: AssumedCameras | None = None
    evidence_of: str = ''
    degrees_of_freedom: float = math.inf

    @property
    def quaternion(self) -> NDArray[np.float64]:
        """(4,) x, y, z, w of the orientation."""
        return _quaternion(self.pose)

    def moved(self, deviation: NDArray[np.float64]) -> 'PoseEstimate':
        """The pose and its particles moved by a tangent vector (6,), as of `se3.retract`."""
        return replace(self, pose=retract(self.pose, deviation[None])[0], particles=retract(
            self.particles, np.tile(deviation, (len(self.particles), 1))))

    def in_frame(self, camera: NDArray[np.float64]) -> 'PoseEstimate':
        """The same in the frame that a camera's pose (4, 4) leads to, from the camera's frame."""
        return replace(
            self, pose=camera @ self.pose,
            covariance=rotate_covariance(self.covariance, camera[:3, :3]),
            particles=camera @ self.particles,
            modes=tuple(replace(each, pose=camera @ each.pose) for each in self.modes))

    def found_in(self, evidence: ViewsEvidence) -> ViewsEvidence:
        """What it was found in, of the evidence that was searched: views used, and cameras."""
        used = evidence.without(self.hidden)
        return used if self.cameras is None else used.with_cameras(self.cameras)

    def as_dict(self) -> dict[str, Any]:
        """The fields of the command line's JSON (docs/reference/commands.md)."""
        return {'position': self.pose[:3, 3].tolist(),
                'orientation_xyzw': self.quaternion.tolist(),
                'covariance': self.covariance.ravel().tolist(),
                **({'degrees_of_freedom': self.degrees_of_freedom}
                   if math.isfinite(self.degrees_of_freedom) else {}),
                'score': self.score, 'lost': self.lost,
                **({'why_lost': self._why_lost} if self._why_lost else {}),
                **({'camera_scale': {'error': self.camera_scale.error,
                                     'sigma': self.camera_scale.sigma}}
                   if self.camera_scale and not self.lost else {}),
                **({'hidden_views': list(self.hidden)} if self.hidden else {}),
                **({'evidence_of': self.evidence_of} if self.evidence_of else {}),
                **{name: value for name in _JUDGED
                   if math.isfinite(value := getattr(self, name))},
                'modes': [{'position': each.pose[:3, 3].tolist(),
                           'orientation_xyzw': _quaternion(each.pose).tolist(),
                           'weight': each.weight, 'score': each.score} for each in self.modes]}

    def diagnostics(self) -> dict[str, object]:
        """What /diagnostics shows of it (docs/reference/messages.md)."""
        values: dict[str, object] = {'mode': self.mode, 'score': self.score}
        if self.modes:
            first, second, *_ = [*(each.weight for each in self.modes), 0.0]
            values |= {'support': self.support, 'evidence': self.evidence, 'weight': first,
                       'weight of the runner-up': second}
        if math.isfinite(self.inside):
            values['inside'] = self.inside
        if math.isfinite(self.least_support):
            values['least support'] = self.least_support
        if math.isfinite(self.degrees_of_freedom):
            values['degrees of freedom'] = self.degrees_of_freedom
        if math.isfinite(self.disagreement):
            values |= {'disagreement': self.disagreement, 'evidence beyond': self.beyond}
        if self.camera_scale and not self.lost:
            values |= {'camera scale error [%]': 100 * self.camera_scale.error,
                       'camera scale error, standard deviation [%]': 100 * self.camera_scale.sigma}
        if self.hidden:
            values['hidden views'] = ' '.join(map(str, self.hidden))
        if self.evidence_of:
            values['evidence of'] = self.evidence_of
        return values

    def describe(self) -> str:
        """One line for people."""
        x, y, z = self.pose[:3, 3]
        sigma = 1e3 * np.sqrt(np.diag(self.covariance)[:3])
        found = 'lost; best hypothesis' if self.lost else 'found'
        return (f'{found} at ({x:.4f}, {y:.4f}, {z:.4f}) m, orientation xyzw '
                f'({", ".join(f"{q:.4f}" for q in self.quaternion)}), score {self.score:.3g}, '
                f'standard deviation ({", ".join(f"{s:.1f}" for s in sigma)}) mm'
                + (f'; {self._why_lost}' if self._why_lost else ''))

    @property
    def _why_lost(self) -> str:
        """The number that decides (docs/concepts/lost.md); '' where none here does."""
        if not self.lost:
            return ''
        if self.support == -math.inf:
            return 'nothing in view looks like it'
        if self.evidence < self.least_evidence:
            return (f'lost as its contour has {self.evidence:.2f} nat/px of evidence, '
                    f'{self.least_evidence:.2f} are needed')
        # Before the support: in a contour map more of it is needed where the weight is low.
        if self.modes and self.modes[0].weight < self.least_weight:
            return (f'lost as other poses are as likely: this one has '
                    f'{100 * self.modes[0].weight:.0f} % of the posterior; has it a symmetry to '
                    'declare?')
        if self.support < self.least_support:
            return (f'lost as the weakest part of its contour has {self.support:.2f} nat/px of '
                    f'evidence, {self.least_support:.2f} are needed')
        return ''


def _quaternion(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(Rotation.from_matrix(pose[:3, :3]).as_quat())
