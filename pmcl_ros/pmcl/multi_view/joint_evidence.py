"""The contour evidence of several views together: scores of poses, refinement, local models."""

import contextlib
import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.energies import evidence_across
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.pmcl.contour_evidence import ContourEvidence, Feasible, refinement, scene
from pmcl_ros.pmcl.local_model import BEHIND, LocalModel, weighted
from pmcl_ros.pmcl.multi_view.camera_errors import CameraErrors
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.orientation import Orientation
from pmcl_ros.pmcl.posterior import Refine, Score
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.back_end import ContourScore, Renderer
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.gauss_newton import WIDEST, GaussNewton
from pmcl_ros.pmcl.render.scene import Window
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.tracking.near_prior import rigid_score
from pmcl_ros.pmcl.uncertain_cameras import UncertainCameras
from pmcl_ros.pmcl.view_terms import ViewContour, normal_motion
from pmcl_ros.runtime.errors import LocalizationError

_LOG = logging.getLogger(__name__)
_SHARP = 0.5  # px: of a blur that leaves contours as sharp as they are
_FARTHEST = 8.0  # px: as far from a contour is looked for what a view shows of it
_AT_STAGES = 3, 5, 1000  # views at most by which coarse, fine and finest contours are refined


@dataclass(frozen=True)
class Beside:
    """Other objects that are known to be there.

    feasible: (n,) which of poses (n, 4, 4) are outside of them. things: each with its pose
    (4, 4). Poses are in the reference frame of the views.
    """

    feasible: Feasible
    things: Sequence[tuple[ObjectModel, NDArray[np.float64]]]

    def depths(self, renderer: Renderer, view: ContourEvidence, camera: NDArray[np.float64]
               ) -> NDArray[np.float32]:
        """(height, width) depth of their surfaces in a view [m], 0 where there is none."""
        pinhole, nearest = view.edges.pinhole, np.float32(np.inf)
        window = Window(0, 0, (pinhole.width, pinhole.height))
        front = np.full((pinhole.height, pinhole.width), nearest, np.float32)
        for model, pose in self.things:
            drawn = scene(model, view.region, pinhole, window, 0.0, view.interface)
            depth = renderer.depths(drawn, (np.linalg.inv(camera) @ pose)[None])[0]
            front = np.where((depth > 0) & (depth < front), depth, front)
        return np.where(np.isfinite(front), front, np.float32(0))


@dataclass(frozen=True)
class JointEvidence:
    """Evidence of an object's poses in several views.

    Poses are in the frame of the first camera that sees the region. views: what each that sees it
    shows. cameras: (n, 4, 4) of these, to that frame. errors: of the cameras. region: a box there
    that holds the region of interest. box: (4, 4) from that frame into that of the region of
    interest, and half its size (3,) [m]. numbers: of the views, among all. constraint: (n,) which
    of poses (n, 4, 4) are feasible besides. fronts: in each view (height, width) depth of other
    objects, which may hide this one; 0 for none [m].
    """

    model: ObjectModel
    views: tuple[ContourEvidence, ...]
    cameras: NDArray[np.float64]
    errors: CameraErrors
    region: Region
    box: tuple[NDArray[np.float64], NDArray[np.float64]]
    numbers: tuple[int, ...]
    constraint: Feasible | None = None
    fronts: tuple[NDArray[np.float32], ...] = ()

    @classmethod
    def from_views(cls, evidence: ViewsEvidence, renderer: Renderer, model: ObjectModel,
                   settings: PmclSettings, beside: Beside | None = None) -> 'JointEvidence':
        """Of the views that see the region of interest, which is a box in the reference frame.

        beside: other objects, in that frame. Raises LocalizationError where none does.
        """
        seen = regions_seen(evidence, model, settings)
        posed, views = [evidence.views[number] for number in seen], []
        for each, region in zip(posed, seen.values(), strict=True):
            window = region.window(each.evidence.pinhole, model.radius)
            grid = PixelGrid.from_crop(each.evidence.pinhole,
                                       (window.left, window.top, *window.size), 1)
            # The evidence of a picture is the same at all depths; labels say where to expect it.
            depths = depth_labels(*region.grown(model.radius), len(each.evidence.depths))
            edges = replace(each.evidence.on(grid), depths=depths)
            views.append(ContourEvidence.from_edges(edges, renderer, model, settings, None, None,
                                                    None, region, each.camera_to_reference))
        first = posed[0].camera_to_reference
        cameras = np.linalg.inv(first) @ np.array([each.camera_to_reference for each in posed])
        into = first.copy()
        into[:3, 3] -= settings.roi_center
        errors = (CameraErrors.from_views(posed) if evidence.errors is None
                  else CameraErrors(evidence.errors[list(seen)]))
        return cls(model, tuple(views), cameras, errors, views[0].region,
                   (into, np.array(settings.roi_size) / 2), tuple(seen),
                   None if beside is None else lambda poses: beside.feasible(first @ poses),
                   () if beside is None else tuple(
                       beside.depths(renderer, each, view.camera_to_reference)
                       for each, view in zip(views, posed, strict=True)))

    def feasible(self, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,) which of poses (n, 4, 4) are in the region, turned as the object can be."""
        into, half = self.box
        places = poses[:, :3, 3] @ into[:3, :3].T + into[:3, 3]
        inside = (np.abs(places) <= half + 1e-9).all(axis=1)
        if self.orientation is not None:
            inside &= self.orientation.allows(poses[:, :3, :3])
        if self.constraint is not None:
            inside &= self.constraint(poses)
        return np.asarray(inside)

    @property
    def orientation(self) -> Orientation | None:
        """Of the object, if it is not any, in the frame of the poses."""
        return self.views[0].orientation

    @property
    def independent(self) -> float:
        """Number of views whose model errors are independent that these are worth."""
        return self.independent_with(np.zeros((0, 3)))

    def independent_with(self, places: NDArray[np.float64]) -> float:
        """The same with further cameras at places (k, 3)."""
        middle = np.array(self.views[0].region.center)
        sights = middle - np.concatenate([self.cameras[:, :3, 3], places])
        sights /= np.linalg.norm(sights, axis=1, keepdims=True)
        angles = np.arccos(np.clip(sights @ sights.T, -1, 1))
        return float(len(sights) ** 2 / self.views[0].error.between_views(angles).sum())

    def spread(self, count: int) -> list[int]:
        """Indices of `count` views, the first and others as far apart as possible."""
        axes = self.cameras[:, :3, 2]
        places = self.cameras[:, :3, 3]
        kept = [0]
        while len(kept) < min(count, len(self.views)):
            apart = np.linalg.norm(axes[:, None] - axes[kept], axis=2)
            apart += np.linalg.norm(places[:, None] - places[kept], axis=2)
            kept.append(int(apart.min(axis=1).argmax()))
        return sorted(kept)

    def optimizers(self) -> list[GaussNewton]:
        """Gauss-Newton on coarse contours, fine ones, those of the images."""
        return [self._optimizer(stage, self.spread(count))
                for stage, count in enumerate(_AT_STAGES)]

    def _optimizer(self, stage: int, chosen: Sequence[int]) -> GaussNewton:
        off = self.uncertain
        return GaussNewton([self.views[number].expansion(
            stage, float(off[number]), self.cameras[number]) for number in chosen], self.region)

    def refinement(self, optimizer: GaussNewton, tries: int | None = None) -> Refine:
        """Refines poses by Gauss-Newton steps, and evaluates them there."""
        return refinement(optimizer, self.feasible, tries)

    def open(self, stack: contextlib.ExitStack) -> 'JointContours':
        """What draws contours at the resolution of the images, until the stack is closed."""
        blurs, widest = [], float(self.uncertain.max())
        while widest > _SHARP:
            blurs.append(widest)
            widest /= 2
        levels = [[each.edges.blurred(blur) for each in self.views] for blur in blurs]
        levels.append([each.edges for each in self.views])
        return JointContours(self, [stack.enter_context(each.score()) for each in self.views],
                             levels)

    @property
    def uncertain(self) -> NDArray[np.float64]:
        """(n,) standard deviation with which each camera sees the region off [px]."""
        return self.errors.pixels([each.edges.pinhole for each in self.views],
                                  [each.region.center[2] for each in self.views])


def regions_seen(evidence: ViewsEvidence, model: ObjectModel, settings: PmclSettings
                 ) -> dict[int, Region]:
    """Boxes before the cameras that hold the region of interest, by the numbers of the views.

    Only of views that see it. A picture of one colour there does not, where others do: a covered
    lens is no evidence that nothing is there. Raises LocalizationError where none sees it.
    """
    seen, blank = {}, []
    for number, each in enumerate(evidence.views):
        try:
            region = Region.before_camera(each.camera_to_reference, settings.roi_center,
                                          settings.roi_size)
            window = region.window(each.evidence.pinhole, model.radius)
        except LocalizationError as error:
            _LOG.info('view %d says nothing: %s', number, error)
        else:
            seen[number] = region
            if each.view is not None and _is_blank(each.view, each.evidence.pinhole, window):
                blank.append(number)
    for number in blank if len(blank) < len(seen) else []:
        _LOG.info('view %d says nothing: its picture is of one colour where the region is',
                  number)
        del seen[number]
    if not seen:
        raise LocalizationError(
            f'none of the {len(evidence.views)} views sees the region of interest at '
            f'{settings.roi_center} m of size {settings.roi_size} m in the frame '
            f'{evidence.header.frame_id!r}: are poses and region of the same frame?')
    return seen


def _is_blank(view: PosedView, pinhole: Pinhole, window: Window) -> bool:
    """Whether a view's picture is of one colour in a window of another size of it, or a crop."""
    ends = np.array([[window.left, window.top], np.add((window.left, window.top), window.size)])
    scale = np.array([view.pinhole.fx / pinhole.fx, view.pinhole.fy / pinhole.fy])
    (left, top), (right, bottom) = np.rint(
        scale * (ends - 0.5 - (pinhole.cx, pinhole.cy))
        + (view.pinhole.cx + 0.5, view.pinhole.cy + 0.5)).astype(int).clip(0).tolist()
    return view.is_of_one_colour(left, top, right - left, bottom - top)


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

    levels: the evidence of the views, ever sharper; the last is as it is.
    """

    joint: JointEvidence
    scores: Sequence[ContourScore]
    levels: Sequence[Sequence[EvidenceVolume]]

    def contours(self, pose: NDArray[np.float64], motions: NDArray[np.float64], level: int = -1
                 ) -> list[ViewContour]:
        """In each view, of a pose (4, 4); motions: (k,) of the cameras."""
        joint = self.joint
        cameras = joint.errors.moved(joint.cameras, motions)
        seen = [score.points(np.linalg.inv(camera) @ pose)
                for score, camera in zip(self.scores, cameras, strict=True)]
        if joint.fronts:
            seen = [_not_hidden(*each) for each in zip(seen, joint.fronts, strict=True)]
        return [ViewContour(points, edges, view.profile, camera=camera)
                for points, view, edges, camera in zip(
                    seen, joint.views, self.levels[level], cameras, strict=True)]

    def share(self, pose: NDArray[np.float64]) -> float:
        """Of the contour of a pose (4, 4) in all views, that is not hidden by other objects."""
        if not self.joint.fronts:
            return 1.0
        whole = sum(float(score.points(np.linalg.inv(camera) @ pose).lengths.sum())
                    for score, camera in zip(self.scores, self.joint.cameras, strict=True))
        motions = np.zeros(self.joint.errors.number)
        return float(self.points(pose, motions).lengths.sum()) / max(whole, 1e-9)

    def rigid_score(self, pose: NDArray[np.float64]) -> Score | None:
        """Evidence (n,) of poses (n, 4, 4) by the rigid contours of one (4, 4) in all views.

        Cameras are where they are told to be. None: no view sees a contour.
        """
        into = np.linalg.inv(self.joint.cameras)
        scores = [(camera, rigid_score(camera @ pose, points, view.edges))
                  for camera, score, view in zip(into, self.scores, self.joint.views, strict=True)
                  if len((points := score.points(camera @ pose)).lengths)]
        if not scores:
            return None
        return lambda poses: np.sum([score(camera @ poses) for camera, score in scores], axis=0)

    def points(self, pose: NDArray[np.float64], motions: NDArray[np.float64]) -> ContourPoints:
        """All of them, one view after the other."""
        return reduce(lambda one, other: one.joined(other),
                      (each.points for each in self.contours(pose, motions)))

    def local_model(self, pose: NDArray[np.float64], sure: bool, motions: NDArray[np.float64],
                    scale: float | None, level: int = -1) -> LocalModel:
        """At a pose (4, 4); sure: with its uncertainty.

        scale: as of `UncertainCameras`; None: the cameras are taken to be where they are.
        """
        joint = self.joint
        uncertain = None
        if joint.errors.number and scale is not None:
            uncertain = UncertainCameras(joint.errors.seen(joint.cameras, pose), motions, scale)
        contours = self.contours(pose, motions, level)
        return LocalModel.from_views(pose, joint.model.symmetry, contours,
                                     joint.views[0].error if sure else None, uncertain)

    def fits(self, pose: NDArray[np.float64], motions: NDArray[np.float64]) -> list[ViewFit]:
        """How each view agrees with a pose (4, 4), with its camera moved by motions (k,)."""
        joint = self.joint
        uncertain = joint.errors.pixels([each.edges.pinhole for each in joint.views],
                                        [float((np.linalg.inv(camera) @ pose)[2, 3])
                                         for camera in joint.cameras])
        made = []
        for number, view, contour, wide in zip(joint.numbers, joint.views,
                                               self.contours(pose, motions), uncertain,
                                               strict=True):
            alone = LocalModel.from_views(pose, joint.model.symmetry, [contour], view.error)
            step = np.linalg.solve(alone.information, alone.gradient)
            expected = np.trace(alone.moments @ alone.model_error)
            made.append(ViewFit(
                number, float(np.sqrt(step @ alone.moments @ step)),
                _apart(contour, pose, alone.basis), float(np.sqrt(expected)),
                float(wide), alone.evidence / max(alone.length, 1e-9), alone.evidence))
        return made


def _not_hidden(points: ContourPoints, front: NDArray[np.float32]) -> ContourPoints:
    """A contour without its part behind other objects, where that is not seen through them.

    front: (height, width) depth of these, 0 for none [m]. As their material is unknown, what is
    behind them counts if it has evidence, all in all.
    """
    height, width = front.shape
    column, row = np.rint(points.pixels.T).astype(int)
    before = front[row.clip(0, height - 1), column.clip(0, width - 1)]
    hidden = (before > 0) & (points.depths > before + BEHIND)
    if float(points.lengths[hidden] @ points.evidence[hidden]) >= 0:
        return points
    return weighted(points, np.where(hidden, 0.0, 1.0))


def _apart(view: ViewContour, pose: NDArray[np.float64], basis: NDArray[np.float64]) -> float:
    """By how much a rigid motion fits the evidence across a view's contour better [px, rms].

    Found by least squares from where along each normal the evidence is, as far as `_FARTHEST`.
    """
    assert view.camera is not None
    points, turn = view.points, view.camera[:3, :3]
    before = np.linalg.inv(view.camera) @ pose
    basis = np.concatenate([turn.T @ basis[:3], turn.T @ basis[3:]])
    shifts = np.linspace(-_FARTHEST, _FARTHEST, 4 * round(_FARTHEST) + 1)
    table = evidence_across(view.edges, points.pixels, points.normals, points.depths,
                            view.profile, shifts)
    chances = np.exp(table - table.max(axis=1, keepdims=True))
    chances /= chances.sum(axis=1, keepdims=True)
    off = chances @ shifts
    weight = points.lengths / (chances @ shifts ** 2 - off ** 2 + 1)
    motion = normal_motion(points, view.edges.pinhole, before[:3, 3]) @ basis
    least = basis.T @ np.diag(1 / WIDEST ** 2) @ basis
    weighted = weight[:, None] * motion
    step = np.linalg.solve(weighted.T @ motion + least, weighted.T @ off)
    return float(np.sqrt((points.lengths @ (motion @ step) ** 2)
                         / max(float(points.lengths.sum()), 1.0)))


def disagreement(fits: Sequence[ViewFit]) -> float:
    """Mean square by which views are off, in units of the model error of one view."""
    return float(sum(each.off ** 2 for each in fits)
                 / max(sum(each.expected ** 2 for each in fits), 1e-12))
