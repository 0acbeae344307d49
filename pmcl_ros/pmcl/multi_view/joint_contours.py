"""Contours of poses in several views at the resolution of the images: evidence, local models."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.energies import evidence_across
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence
from pmcl_ros.pmcl.multi_view.other_objects import not_hidden, not_masked
from pmcl_ros.pmcl.nuisances import Nuisances
from pmcl_ros.pmcl.posterior import Score
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.contour_score import ContourScore
from pmcl_ros.pmcl.render.gauss_newton import WIDEST
from pmcl_ros.pmcl.support import evidence_beyond
from pmcl_ros.pmcl.tracking.near_prior import rigid_score
from pmcl_ros.pmcl.view_terms import ViewContour, displaced, normal_motion

_SHARP = 0.5  # px: of a blur that leaves contours as sharp as they are
_FARTHEST = 8.0  # px: as far from a contour is looked for what a view shows of it


@dataclass(frozen=True)
class ViewFit:
    """How a view agrees with a pose.

    number: of the view. off: by how much it alone would move the contour, apart: likewise, where
    it is looked for farther away [px, rms]. expected, uncertain: standard deviations of that by
    the model error and by the errors of the camera's pose. evidence: mean along its contour
    [nat / px], total: of all of it [nat].
    """

    number: int
    off: float
    apart: float
    expected: float
    uncertain: float
    evidence: float
    total: float

    @property
    def allowed(self) -> float:
        """Standard deviation of `apart` [px]."""
        return float(np.hypot(self.expected, self.uncertain))


@dataclass(frozen=True)
class JointContours:
    """Contours of poses in all views, at the resolution of the images.

    levels: the evidence of the views, ever sharper; the last is as it is. displacement: standard
    deviation of where contours are found in all views, outwards [px]. Nuisances (k + 1,) are those
    of `Nuisances`: motions of the cameras, and the displacement.
    """

    joint: JointEvidence
    scores: Sequence[ContourScore]
    levels: Sequence[Sequence[EvidenceVolume]]
    displacement: float
    _last: dict[bytes, '_Contours'] = field(  # what `_drawn` made last, by its arguments
        init=False, repr=False, compare=False, default_factory=dict)

    @classmethod
    def opened(cls, joint: JointEvidence, stack: contextlib.ExitStack, displacement: float = 0.0
               ) -> 'JointContours':
        """What draws contours at the resolution of the images, until the stack is closed."""
        blurs, widest = [], float(joint.uncertain.max())
        while widest > _SHARP:
            blurs.append(widest)
            widest /= 2
        levels = [[each.volume.blurred(blur) for each in joint.views] for blur in blurs]
        levels.append([each.volume for each in joint.views])
        return cls(joint, [stack.enter_context(each.score()) for each in joint.views], levels,
                   displacement)

    @property
    def nominal(self) -> NDArray[np.float64]:
        """(k + 1,) nuisances: cameras as reported, contours where they are."""
        return np.zeros(self.joint.errors.number + 1)

    @property
    def exact(self) -> bool:
        """Whether nothing moves contours but the pose."""
        return self.joint.errors.number == 0 and self.displacement == 0

    def contours(self, pose: NDArray[np.float64], nuisances: NDArray[np.float64], level: int = -1
                 ) -> list[ViewContour]:
        """In each view, of a pose (4, 4), with nuisances (k + 1,)."""
        return self._drawn(pose, nuisances, level).views

    def _drawn(self, pose: NDArray[np.float64], nuisances: NDArray[np.float64], level: int = -1
               ) -> '_Contours':
        """The last ones are kept: of a mode that was found several things are asked."""
        asked = b'/'.join((pose.tobytes(), nuisances.tobytes(),
                           bytes([level % len(self.levels)])))
        if asked not in self._last:
            self._last.clear()
            self._last[asked] = _Contours(self.joint, pose.copy(),
                                          self._draw(pose, nuisances, level))
        return self._last[asked]

    def _draw(self, pose: NDArray[np.float64], nuisances: NDArray[np.float64], level: int
              ) -> list[ViewContour]:
        joint, off = self.joint, self.displacement * float(nuisances[-1])
        cameras = joint.errors.moved(joint.cameras, nuisances[:-1])
        seen = [score.points(np.linalg.inv(camera) @ pose)
                for score, camera in zip(self.scores, cameras, strict=True)]
        seen = [points if masked is None else not_masked(points, masked)
                for points, masked in zip(seen, joint.masked, strict=True)]
        if joint.fronts:
            seen = [not_hidden(*each) for each in zip(seen, joint.fronts, strict=True)]
        return [ViewContour(displaced(points, volume, view.profile, off) if off else points,
                            volume, view.profile, camera=camera)
                for points, view, volume, camera in zip(
                    seen, joint.views, self.levels[level], cameras, strict=True)]

    def share(self, pose: NDArray[np.float64]) -> float:
        """Of the contour of a pose (4, 4) in all views, that neither other objects nor masks hide.
        """
        if not self.joint.fronts and all(each is None for each in self.joint.masked):
            return 1.0
        whole = sum(float(score.points(np.linalg.inv(camera) @ pose).lengths.sum())
                    for score, camera in zip(self.scores, self.joint.cameras, strict=True))
        return float(self.points(pose, self.nominal).lengths.sum()) / max(whole, 1e-9)

    def rigid_score(self, pose: NDArray[np.float64]) -> Score | None:
        """Evidence (n,) of poses (n, 4, 4) by the rigid contours of one (4, 4) in all views.

        Cameras are where they are reported to be. None: no view sees a contour.
        """
        into = np.linalg.inv(self.joint.cameras)
        scores = [(camera, rigid_score(camera @ pose, points, view.volume))
                  for camera, score, view in zip(into, self.scores, self.joint.views, strict=True)
                  if len((points := score.points(camera @ pose)).lengths)]
        if not scores:
            return None
        return lambda poses: np.sum([score(camera @ poses) for camera, score in scores], axis=0)

    def points(self, pose: NDArray[np.float64], nuisances: NDArray[np.float64]) -> ContourPoints:
        """The points of `contours`, one view after the other."""
        return reduce(lambda one, other: one.joined(other),
                      (each.points for each in self.contours(pose, nuisances)))

    def local_model(self, pose: NDArray[np.float64], sure: bool, nuisances: NDArray[np.float64],
                    scale: float | None, level: int = -1) -> LocalModel:
        """At a pose (4, 4), with nuisances (k + 1,); sure: with its uncertainty.

        scale: as of `Nuisances`, which are eliminated; None: they are taken to be what they are.
        """
        joint = self.joint
        given = None
        if not self.exact and scale is not None:
            given = Nuisances(joint.errors.seen(joint.cameras, pose), self.displacement,
                              nuisances, scale)
        contours = self.contours(pose, nuisances, level)
        return LocalModel.from_views(pose, joint.model.symmetry, contours,
                                     joint.views[0].error if sure else None, given)

    def fits(self, pose: NDArray[np.float64], nuisances: NDArray[np.float64]) -> list[ViewFit]:
        """How each view agrees with a pose (4, 4), with nuisances (k + 1,)."""
        joint = self.joint
        uncertain = joint.errors.pixels([each.volume.pinhole for each in joint.views],
                                        [float((np.linalg.inv(camera) @ pose)[2, 3])
                                         for camera in joint.cameras])
        made, drawn = [], self._drawn(pose, nuisances)
        for number, contour, alone, wide in zip(joint.numbers, drawn.views, drawn.alone,
                                                uncertain, strict=True):
            off, expected = _off(alone)
            made.append(ViewFit(
                number, off, _apart(contour, pose, alone.basis), expected, float(wide),
                alone.evidence / max(alone.length, 1e-9), alone.evidence))
        return made

    def disagreement(self, pose: NDArray[np.float64], nuisances: NDArray[np.float64]) -> float:
        """Median over views of (`off` / `expected`)^2, as of `ViewFit`: about 1 where they agree.

        pose: (4, 4). nuisances: (k + 1,). One view of several in which something hides a part of
        the object does not decide. 0 where no view shows a contour.
        """
        alone = [_off(each) for each in self._drawn(pose, nuisances).alone if each.length > 0]
        return float(np.median([off ** 2 / max(expected ** 2, 1e-12) for off, expected in alone]
                               or [0.0]))

    def beyond(self, pose: NDArray[np.float64], nuisances: NDArray[np.float64]) -> float:
        """Mean evidence for other contours beyond those of a pose (4, 4) [nat / px].

        Those of the other objects that are known to be there (`joint.fronts`) are none.
        """
        views = self.contours(pose, nuisances)
        fronts: Sequence[NDArray[np.float32] | None] = self.joint.fronts or [None] * len(views)
        lengths = np.concatenate([each.points.lengths for each in views])
        evidence = np.concatenate([
            evidence_beyond(each.points, each.volume, each.profile,
                            None if front is None else front > 0)
            for each, front in zip(views, fronts, strict=True)])
        return float(lengths @ evidence / max(lengths.sum(), 1e-9))


@dataclass(frozen=True)
class _Contours:
    """The contour of a pose (4, 4) in each view."""

    joint: JointEvidence
    pose: NDArray[np.float64]
    views: list[ViewContour]

    @cached_property
    def alone(self) -> list[LocalModel]:
        """In each view, by its contour alone, with its uncertainty."""
        return [LocalModel.from_views(self.pose, self.joint.model.symmetry, [contour], view.error)
                for contour, view in zip(self.views, self.joint.views, strict=True)]


def _off(alone: LocalModel) -> tuple[float, float]:
    """`off` and `expected` of a `ViewFit`, by the local model of a view alone."""
    step = np.linalg.solve(alone.information, alone.gradient)
    expected = np.trace(alone.moments @ alone.model_error)
    return float(np.sqrt(step @ alone.moments @ step)), float(np.sqrt(expected))


def _apart(view: ViewContour, pose: NDArray[np.float64], basis: NDArray[np.float64]) -> float:
    """By how much a rigid motion fits the evidence across a view's contour better [px, rms].

    Found by least squares from where along each normal the evidence is, as far as `_FARTHEST`.
    """
    assert view.camera is not None
    points, turn = view.points, view.camera[:3, :3]
    before = np.linalg.inv(view.camera) @ pose
    basis = np.concatenate([turn.T @ basis[:3], turn.T @ basis[3:]])
    shifts = np.linspace(-_FARTHEST, _FARTHEST, 4 * round(_FARTHEST) + 1)
    table = evidence_across(view.volume, points.pixels, points.normals, points.depths,
                            view.profile, shifts)
    chances = np.exp(table - table.max(axis=1, keepdims=True))
    chances /= chances.sum(axis=1, keepdims=True)
    off = chances @ shifts
    weight = points.lengths / (chances @ shifts ** 2 - off ** 2 + 1)
    motion = normal_motion(points, view.volume.pinhole, before[:3, 3]) @ basis
    least = basis.T @ np.diag(1 / WIDEST ** 2) @ basis
    weighted = weight[:, None] * motion
    step = np.linalg.solve(weighted.T @ motion + least, weighted.T @ off)
    return float(np.sqrt((points.lengths @ (motion @ step) ** 2)
                         / max(float(points.lengths.sum()), 1.0)))
