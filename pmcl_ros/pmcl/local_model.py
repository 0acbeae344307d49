"""Second-order model of the evidence about a pose, its covariance, and Gauss-Newton on it.

The evidence is that of one view, or the sum over several.

To first order, a small motion of the object moves each point of its contour along its normal in
the image. The evidence along the normals is smooth: it gives the evidence of all poses nearby
from one rendering, without the steps of a rasteriser.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.energies import evidence_across, region_across
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.model_error import FACING, ModelError
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.creases import CreasePoints
from pmcl_ros.pmcl.render.gauss_newton import LEAST_CURVATURE, LEAST_SHOWN, WIDEST

_STEP = 1.0  # px: along the normals, for differences; about half the width of an edge's energy
# px: along a contour, beyond which contributions share no noise. Contrast is normalised by that of
# a neighbourhood of 12 px (Gaussian), and texture is coarse where it is out of focus.
_REACH = 20.0
_STRETCH = 3.0  # px: of a contour, one point in the covariances between points
_LEAST_FREE = 0.25  # share of the degrees of freedom that remain, however short the contour is
_LEAST_VARIANCE = 0.05  # of the slope of a contribution: no capture is without noise
_FARTHEST = 1.0  # px, rms along the contour: largest step; the model does not hold farther off
_NEGLIGIBLE = 1e-3  # weight of a point of a contour; points of less are left out


@dataclass(frozen=True)
class LocalModel:
    """Evidence about a pose, expanded in the tangent space there (`Symmetry.tangent_basis`).

    evidence, length: of the contour, sums over it [nat, px].
    basis: (6, d), columns of the tangent space.
    gradient: (d,) of the evidence. information: (d, d) minus its second derivative, H.
    variability: (d, d) covariance of the gradient over the noise of such captures, J.
    model_error: (d, d) covariance of the pose by the model error (`ModelError`).
    moments: (d, d) mean over the contour of the products of its motions [px^2].
    nuisance: of uncertain cameras, else None.
    """

    evidence: float
    length: float
    basis: NDArray[np.float64]
    gradient: NDArray[np.float64]
    information: NDArray[np.float64]
    variability: NDArray[np.float64]
    model_error: NDArray[np.float64]
    moments: NDArray[np.float64]
    nuisance: 'Nuisance | None' = None

    @classmethod
    def from_contour(cls, pose: NDArray[np.float64], symmetry: Symmetry,
                     points: ContourPoints, edges: EvidenceVolume, profile: ContourProfile,
                     error: ModelError | None, creases: CreasePoints | None = None
                     ) -> 'LocalModel':
        """The model about `pose` (4, 4), whose contour's points in one view are `points`.

        As `from_views`. creases: seen in this pose, if any count.
        """
        return cls.from_views(pose, symmetry, [ViewContour(points, edges, profile, creases)],
                              error)

    @classmethod
    def from_views(cls, pose: NDArray[np.float64], symmetry: Symmetry,
                   views: Sequence['ViewContour'], error: ModelError | None,
                   uncertain: 'UncertainCameras | None' = None) -> 'LocalModel':
        """The model about `pose` (4, 4), by its contour in all views.

        symmetry: of the object. error: of the model; None: gradient and information only, without
        the covariances, at a tenth of the cost. uncertain: errors of the views' cameras, which are
        eliminated: gradient, information and what follows are those of the pose alone.
        """
        basis = symmetry.tangent_basis(pose)
        terms = [_Terms.from_view(each, pose, basis) for each in views]
        length = sum(each.length for each in terms)
        least = basis.T @ np.diag(1 / WIDEST ** 2) @ basis
        moments = sum((each.moments for each in terms), least)
        weak = LEAST_CURVATURE * least
        evidence = sum(each.evidence for each in terms)
        nuisance = None
        if uncertain is not None:
            nuisance, terms = uncertain.eliminated(basis, terms)
            evidence += nuisance.evidence
        gradient = np.sum([each.gradient for each in terms], axis=0)
        information = sum((each.information for each in terms), weak)
        variability, off = information, np.zeros_like(information)
        if error is not None and length > 0:
            stretched = [each.stretches() for each in terms if len(each.points.lengths)]
            each, curved = (np.concatenate(values) for values in zip(
                *((one.each, one.curved) for one in stretched), strict=True))
            distance, same_side, alike = _pairs(stretched, error)
            together = np.where(same_side, np.clip(1 - distance / _REACH, 0, None), 0) * alike
            # The slopes at the best pose are smaller than at the true one, as d directions of them
            # were fitted. A stretch of _REACH counts as one degree of freedom.
            free = max(1 - len(gradient) * _REACH / length, _LEAST_FREE)
            noise = _LEAST_VARIANCE * sum((each.moments for each in terms), least)
            variability = each.T @ (together @ each) / free + noise
            # The model error moves the contour; the pose follows by weighted least squares.
            follow = np.linalg.solve(information, curved.T)
            off = follow @ ((error.covariance(distance, same_side) * alike) @ follow.T)
            # The limit of `same_side` can make eigenvalues negative.
            values, vectors = np.linalg.eigh((off + off.T) / 2)
            off = (vectors * np.maximum(values, 0)) @ vectors.T
        return cls(evidence, length, basis, gradient, information, variability, off,
                   moments / max(length, 1.0), nuisance)

    @property
    def scale(self) -> float:
        """Factor that turns the evidence into a log likelihood.

        The noise of neighbouring contributions is correlated, so their sum is overconfident.
        Scaled by d / tr(H^-1 J), at most 1, the posterior is on average as wide as the estimates
        scatter (Godambe's information; magnitude adjustment of Ribatet, Cooley, Davison 2012).
        Where cameras are uncertain it is that of the views as their cameras are.
        """
        if self.nuisance is not None:
            return self.nuisance.scale
        loss = float(np.trace(np.linalg.solve(self.information, self.variability)))
        return len(self.gradient) / max(loss, len(self.gradient))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(6, 6) of the posterior, without the model's error."""
        return self.basis @ np.linalg.inv(self.scale * self.information) @ self.basis.T

    @property
    def step(self) -> NDArray[np.float64]:
        """(6,) tangent vector to the best pose nearby: a Gauss-Newton step of bounded length."""
        step = np.asarray(self.basis @ np.linalg.solve(self.information, self.gradient), float)
        return step * min(1.0, _FARTHEST / max(self.motion(step), 1e-9))

    def motion(self, step: NDArray[np.float64]) -> float:
        """How far a tangent vector (6,) moves the contour, rms along it [px]."""
        each = self.basis.T @ step
        return float(np.sqrt(each @ self.moments @ each))


def normal_motion(points: ContourPoints, pinhole: Pinhole, origin: NDArray[np.float64]
                  ) -> NDArray[np.float64]:
    """(n, 6) px that a contour's points move along their normals in the image.

    Per metre of shift along x, y, z and radian of turn about these axes through `origin` (3,). A
    contour on a smooth surface slides over it as the object turns, but along the line of sight and
    the contour only: to first order it moves as the point of the surface does.
    """
    place, z = _places(points, pinhole), points.depths
    across = points.normals * [pinhole.fx, pinhole.fy] / z[:, None]
    along = -(across * place[:, :2]).sum(axis=1) / z
    shift = np.concatenate([across, along[:, None]], axis=1)
    return np.concatenate([shift, np.cross(place - origin, shift)], axis=1)


@dataclass(frozen=True)
class ViewContour:
    """The contour of a pose in one view, and the evidence there.

    creases: seen in this pose, if any count. camera: (4, 4) of the view, in the frame of the pose;
    None: that frame. curvature: of the evidence, in units of the least, where it is not that of
    `edges` but of a view that is expected.
    """

    points: ContourPoints
    edges: EvidenceVolume
    profile: ContourProfile
    creases: CreasePoints | None = None
    camera: NDArray[np.float64] | None = None
    curvature: float | None = None


@dataclass(frozen=True)
class Nuisance:
    """Motions of uncertain cameras that fit best, as a function of the pose.

    For a tangent vector x (d,) of the pose they change by offset (k,) - follow (k, d) x. evidence:
    of the present motions, by their prior [nat]. scale: as of `UncertainCameras`.
    """

    offset: NDArray[np.float64]
    follow: NDArray[np.float64]
    evidence: float
    scale: float


@dataclass(frozen=True)
class UncertainCameras:
    """Errors of the cameras' poses as motions z (k,) of unit prior variance.

    root: (views, 6, k) tangent vector of the object, in its frame, by which view v sees it off.
    motions: (k,) those with which the views' cameras are drawn now. scale: that turns evidence
    into a log likelihood.
    """

    root: NDArray[np.float64]
    motions: NDArray[np.float64]
    scale: float

    def eliminated(self, basis: NDArray[np.float64], terms: Sequence['_Terms']
                   ) -> 'tuple[Nuisance, list[_Terms]]':
        """The best motions, and the terms of the views without them, by the Schur complement.

        With the pose's x and z the evidence is a sum over views of g'y - y'H y / 2, y = x + L z,
        less z'z / (2 scale).
        """
        root = basis.T @ self.root
        curved = np.array([each.information for each in terms]) @ root  # (v, d, k) H L
        prior = np.eye(root.shape[2]) / self.scale
        inverse = np.linalg.inv(np.einsum('vdk,vdl->kl', root, curved) + prior)
        pull = np.einsum('vdk,vd->k', root, [each.gradient for each in terms])
        pull -= self.motions / self.scale
        whole = curved.sum(axis=0)
        offset, follow = inverse @ pull, inverse @ whole.T
        # Of a view's gradient and curvature so much is left to the pose.
        left = np.eye(basis.shape[1]) - whole @ inverse @ root.transpose(0, 2, 1)
        made = [each.transformed(one) for each, one in zip(terms, left, strict=True)]
        # The prior pulls the motions back, and with them the pose.
        back = whole @ inverse @ self.motions / self.scale / len(made)
        made = [replace(each, gradient=each.gradient + back) for each in made]
        evidence = -float(self.motions @ self.motions) / (2 * self.scale)
        return Nuisance(offset, follow, evidence, self.scale), made


@dataclass(frozen=True)
class _Terms:
    """What one view adds to a local model: sums over its contour, and (m, d) of its points.

    each: of the gradient; curved: of the information, before the motion. places: (m, 3) [m] and
    directions: (m, 3) of the points and their normals, in the frame of the pose. scale: (m,)
    px / m at the points. sight: (3,) unit, from the camera to the object.
    """

    evidence: float
    length: float
    gradient: NDArray[np.float64]
    information: NDArray[np.float64]
    moments: NDArray[np.float64]
    each: NDArray[np.float64]
    curved: NDArray[np.float64]
    points: ContourPoints
    places: NDArray[np.float64]
    directions: NDArray[np.float64]
    scale: NDArray[np.float64]
    sight: NDArray[np.float64]

    @classmethod
    def from_view(cls, view: ViewContour, pose: NDArray[np.float64], basis: NDArray[np.float64]
                  ) -> '_Terms':
        """Of a view of `pose` (4, 4), whose tangent space has the basis (6, d)."""
        edges, points, creases = view.edges, view.points, view.creases
        turn, place = np.eye(3), np.zeros(3)
        if view.camera is not None:
            turn, place = view.camera[:3, :3], view.camera[:3, 3]
            pose = np.linalg.inv(view.camera) @ pose
            basis = np.concatenate([turn.T @ basis[:3], turn.T @ basis[3:]])
        shifts = _STEP * np.array([-1, -0.5, 0, 0.5, 1])
        table = evidence_across(edges, points.pixels, points.normals, points.depths, view.profile,
                                shifts)
        table += points.outer[:, None] * region_across(
            edges, points.pixels, points.normals, points.depths, shifts)
        if creases is not None and creases.shown:
            table = np.concatenate([table, creases.evidence(edges, shifts)])
            points = points.joined(creases.points)
        before, inside, here, outside, after = table.T
        length = float(points.lengths.sum())
        motion = normal_motion(points, edges.pinhole, pose[:3, 3]) @ basis
        slope = (outside - inside) / _STEP
        weight = points.lengths[:, None]
        bend = points.lengths @ (2 * here - before - after) / max(length, 1.0) / _STEP ** 2
        # The curvature at an edge grows with its height: no edge, no information.
        shown = np.maximum(here, 0) + LEAST_SHOWN
        shown *= length / max(float(points.lengths @ shown), 1e-9)
        if view.curvature is None:
            curvature = max(float(bend), LEAST_CURVATURE) * shown[:, None]
        else:
            curvature = np.full((len(slope), 1), view.curvature * LEAST_CURVATURE)
            slope = np.zeros(len(slope))
        each, curved = weight * slope[:, None] * motion, weight * curvature * motion
        normals = np.concatenate([points.normals, np.zeros((len(weight), 1))], axis=1)
        focal = np.sqrt(edges.pinhole.fx * edges.pinhole.fy)
        return cls(float(points.lengths @ here) + points.covered, length, each.sum(axis=0),
                   motion.T @ curved, motion.T @ (weight * motion), each, curved, points,
                   _places(points, edges.pinhole) @ turn.T + place, normals @ turn.T,
                   focal / points.depths, turn @ (pose[:3, 3] / np.linalg.norm(pose[:3, 3])))

    def transformed(self, by: NDArray[np.float64]) -> '_Terms':
        """With gradient and curvature multiplied by a matrix (d, d)."""
        return replace(self, gradient=by @ self.gradient, information=by @ self.information,
                       moments=by @ self.moments @ by.T, each=self.each @ by.T,
                       curved=self.curved @ by.T)

    def stretches(self) -> '_Terms':
        """With stretches of about `_STRETCH` px in place of points."""
        number = np.floor(self.points.along / _STRETCH)
        new = (np.diff(number) != 0) | (np.diff(self.points.piece) != 0)
        first = np.flatnonzero(np.concatenate([[True], new]))
        weight = self.points.lengths[:, None]
        total = np.add.reduceat(weight, first)
        each, curved = (np.add.reduceat(values, first) for values in (self.each, self.curved))
        pixels, places, scale = (np.add.reduceat(weight * values, first) / total for values in (
            self.points.pixels, self.places, self.scale[:, None]))
        directions = np.add.reduceat(weight * self.directions, first)
        directions = directions / np.maximum(
            np.linalg.norm(directions, axis=1, keepdims=True), 1e-9)
        return replace(self, each=each, curved=curved, places=places, directions=directions,
                       scale=scale[:, 0], points=replace(self.points, pixels=pixels))


def _pairs(views: Sequence[_Terms], error: ModelError
           ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """Of all pairs of stretches: distance [px], whether on one side, alikeness of their views.

    (n, n) each. Between views distances are those of the places, in pixels there.
    """
    if len(views) == 1:
        pixels, normals = views[0].points.pixels, views[0].directions
        distance = cdist(pixels, pixels)
        return distance, normals @ normals.T > FACING, np.ones(())
    owner = np.repeat(np.arange(len(views)), [len(each.scale) for each in views])
    places, normals, scale = (np.concatenate([getattr(each, name) for each in views])
                              for name in ('places', 'directions', 'scale'))
    distance = cdist(places, places) * np.sqrt(np.multiply.outer(scale, scale))
    sights = np.array([each.sight for each in views])
    angle = np.arccos(np.clip(sights @ sights.T, -1, 1))
    return distance, normals @ normals.T > FACING, error.between_views(angle)[owner][:, owner]


def _places(points: ContourPoints, pinhole: Pinhole) -> NDArray[np.float64]:
    """(n, 3) a contour's points in the camera's frame [m]."""
    x, y = points.pixels.T
    z = points.depths
    return np.stack([(x - pinhole.cx) / pinhole.fx * z, (y - pinhole.cy) / pinhole.fy * z, z],
                    axis=-1)


@dataclass(frozen=True)
class Observation:
    """The contour and the evidence of an object at a pose.

    pose: (4, 4), object to camera [m]. points: of its contour, as if no other object were there.
    depth: (height, width) float32 of its surface in the image [m], 0 elsewhere.
    local: model of the evidence about the pose. in_view: share of the object in the image.
    """

    pose: NDArray[np.float64]
    points: ContourPoints
    depth: NDArray[np.float32]
    local: LocalModel
    in_view: float

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(6, 6) of the pose [m, rad], with the model error; none about an axis of symmetry."""
        error = self.local.basis @ self.local.model_error @ self.local.basis.T
        return self.local.covariance + error


def weighted(points: ContourPoints, weights: NDArray[np.float64]) -> ContourPoints:
    """A contour with the lengths multiplied by weights (m,), 0 to 1, without points of about 0."""
    kept = weights > _NEGLIGIBLE
    return replace(
        points, pixels=points.pixels[kept], normals=points.normals[kept],
        depths=points.depths[kept], lengths=(points.lengths * weights)[kept],
        energies=points.energies[kept], evidence=points.evidence[kept],
        piece=points.piece[kept], along=points.along[kept], outer=points.outer[kept])


def gauss_newton(pose: NDArray[np.float64],
                 local_model_at: Callable[[NDArray[np.float64]], LocalModel], steps: int,
                 converged: float, feasible: Callable[[NDArray[np.float64]], bool] = lambda _: True
                 ) -> tuple[NDArray[np.float64], LocalModel]:
    """Refine a pose (4, 4) by Gauss-Newton steps on local models of the evidence.

    Returns the best pose reached in `steps` steps, and the model there.
    local_model_at: the local model at a pose. converged: length of the step to stop at [px, rms
    along the contour]. feasible: whether a pose is allowed.
    """
    best, local = pose, local_model_at(pose)
    for _ in range(steps):
        step = local.step
        if local.motion(step) < converged:
            break
        for part in (1.0, 0.5, 0.25):
            tried = retract(best, part * step[None])[0]
            if not feasible(tried):
                continue
            there = local_model_at(tried)
            if there.evidence > local.evidence:
                best, local = tried, there
                break
        else:
            break
    return best, local
