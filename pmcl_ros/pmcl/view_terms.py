"""What one view adds to a local model: sums over its contour, and their values at each point."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.energies import energies_across, evidence_across, region_across
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.model_error import FACING, ModelError
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.creases import CreasePoints
from pmcl_ros.pmcl.render.gauss_newton import LEAST_CURVATURE, LEAST_SHOWN

_STEP = 1.0  # px: along the normals, for differences; about half the width of an edge's energy
_STRETCH = 3.0  # px: of a contour, one point in the covariances between points
# px: along a contour, beyond which contributions share no noise. Contrast is normalised by that of
# a neighbourhood of 12 px (Gaussian), and texture is coarse where it is out of focus.
REACH = 20.0


@dataclass(frozen=True)
class ViewContour:
    """The contour of a pose in one view, and the evidence there.

    creases: seen in this pose, if any count. camera: (4, 4) of the view, in the frame of the pose;
    None: that frame. curvature: of the evidence, in units of the least, where it is not that of
    `volume` but of a view that is expected.
    """

    points: ContourPoints
    volume: EvidenceVolume
    profile: ContourProfile
    creases: CreasePoints | None = None
    camera: NDArray[np.float64] | None = None
    curvature: float | None = None

    def evidence_across(self, shifts: NDArray[np.float64]
                        ) -> tuple[NDArray[np.float64], ContourPoints]:
        """(m, k) evidence [nat / px] of points moved along their normals, and these points.

        They are those of the contour, and of creases if any are seen. shifts: (k,) outwards [px].
        """
        points, creases = self.points, self.creases
        where = points.pixels, points.normals, points.depths
        table = evidence_across(self.volume, *where, self.profile, shifts)
        table += points.outer[:, None] * region_across(self.volume, *where, shifts)
        if creases is not None and creases.shown:
            table = np.concatenate([table, creases.evidence(self.volume, shifts)])
            points = points.joined(creases.points)
        return table, points


def displaced(points: ContourPoints, volume: EvidenceVolume, profile: ContourProfile, by: float
              ) -> ContourPoints:
    """Points of a contour that is found `by` [px] outside of where it is, and what is there."""
    moved = points.pixels + by * points.normals
    energies = energies_across(volume, moved, points.normals, points.depths, profile.offsets)
    region = region_across(volume, points.pixels, points.normals, points.depths,
                           np.sort([0.0, by]))
    gained = float(points.lengths @ (points.outer * region.sum(axis=1)))
    return replace(points, pixels=moved, energies=energies, evidence=profile.evidence(energies),
                   covered=points.covered + gained)


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
class Contributions:
    """What each of m points, or stretches, of the contour in one view adds to a local model.

    gradients: (m, d) to the gradient; curvatures: (m, d) to the information, before the motion.
    pixels: (m, 2). places: (m, 3) [m] and directions: (m, 3) of the normals, in the frame of the
    pose. scale: (m,) px / m there. sight: (3,) unit, from the camera to the object.
    """

    gradients: NDArray[np.float64]
    curvatures: NDArray[np.float64]
    pixels: NDArray[np.float64]
    places: NDArray[np.float64]
    directions: NDArray[np.float64]
    scale: NDArray[np.float64]
    sight: NDArray[np.float64]


@dataclass(frozen=True)
class ViewTerms:
    """What one view adds to a local model: sums over the points of its contour, and these.

    In d unknowns: those of the pose's tangent space, and one more where contours can be displaced.
    gradient: (d,). information: (d, d), moments: (d, d) as of `LocalModel`, not divided by length.
    """

    evidence: float
    length: float
    gradient: NDArray[np.float64]
    information: NDArray[np.float64]
    moments: NDArray[np.float64]
    points: ContourPoints
    contributions: Contributions

    @classmethod
    def from_view(cls, view: ViewContour, pose: NDArray[np.float64], basis: NDArray[np.float64],
                  displaced: bool = False) -> 'ViewTerms':
        """Of a view of `pose` (4, 4), whose tangent space has the basis (6, d).

        displaced: with a last dimension, by which all of the contour moves outwards [px].
        """
        volume = view.volume
        turn, place = np.eye(3), np.zeros(3)
        if view.camera is not None:
            turn, place = view.camera[:3, :3], view.camera[:3, 3]
            pose = np.linalg.inv(view.camera) @ pose
            basis = np.concatenate([turn.T @ basis[:3], turn.T @ basis[3:]])
        shifts = _STEP * np.array([-1, -0.5, 0, 0.5, 1])
        table, points = view.evidence_across(shifts)
        before, inside, here, outside, after = table.T
        length = float(points.lengths.sum())
        motion = normal_motion(points, volume.pinhole, pose[:3, 3]) @ basis
        if displaced:
            motion = np.column_stack([motion, np.ones(len(motion))])
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
        gradients, curvatures = weight * slope[:, None] * motion, weight * curvature * motion
        normals = np.concatenate([points.normals, np.zeros((len(weight), 1))], axis=1)
        focal = np.sqrt(volume.pinhole.fx * volume.pinhole.fy)
        return cls(float(points.lengths @ here) + points.covered, length, gradients.sum(axis=0),
                   motion.T @ curvatures, motion.T @ (weight * motion), points, Contributions(
                       gradients, curvatures, points.pixels,
                       _places(points, volume.pinhole) @ turn.T + place, normals @ turn.T,
                       focal / points.depths, turn @ (pose[:3, 3] / np.linalg.norm(pose[:3, 3]))))

    def transformed(self, by: NDArray[np.float64]) -> 'ViewTerms':
        """In k unknowns: gradient and curvature multiplied by a matrix (k, d).

        Of the information, (k, d) then, the first k columns remain.
        """
        each = self.contributions
        return replace(self, gradient=by @ self.gradient,
                       information=(by @ self.information)[:, :len(by)],
                       moments=by @ self.moments @ by.T, contributions=replace(
                           each, gradients=each.gradients @ by.T,
                           curvatures=each.curvatures @ by.T))

    def stretches(self) -> Contributions:
        """Those of stretches of about `_STRETCH` px."""
        each = self.contributions
        number = np.floor(self.points.along / _STRETCH)
        new = (np.diff(number) != 0) | (np.diff(self.points.piece) != 0)
        first = np.flatnonzero(np.concatenate([[True], new]))
        weight = self.points.lengths[:, None]
        total = np.add.reduceat(weight, first)
        gradients, curvatures = (np.add.reduceat(values, first)
                             for values in (each.gradients, each.curvatures))
        pixels, places, scale = (np.add.reduceat(weight * values, first) / total for values in (
            each.pixels, each.places, each.scale[:, None]))
        directions = np.add.reduceat(weight * each.directions, first)
        directions = directions / np.maximum(
            np.linalg.norm(directions, axis=1, keepdims=True), 1e-9)
        return Contributions(gradients, curvatures, pixels, places, directions, scale[:, 0],
                             each.sight)


def sums_over_pairs(views: Sequence[Contributions], error: ModelError
                    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(d, d) sums over all pairs of stretches in all views: of `gradients`, of `curvatures`.

    Those of `gradients` have the share of noise that is common to both, which falls to 0 at
    `REACH`; those of `curvatures` the covariance of their displacements by the model error.
    """
    together = displaced = np.zeros(())
    for k, one in enumerate(views):  # with those that follow: arrays of all pairs take 20 MB each
        rest = views[k:]
        distance, same_side, alike = (pairs_in_image(one) if len(views) == 1
                                      else pairs([one], rest, error))
        noise = np.where(same_side, np.clip(1 - distance / REACH, 0, None), 0)
        moved = error.covariance(distance, same_side)
        count, total = distance.shape
        alike = alike * np.repeat([0.5, 1], [count, total - count])  # its own pairs come twice
        gradients = np.concatenate([other.gradients for other in rest])
        curvatures = np.concatenate([other.curvatures for other in rest])
        together = together + one.gradients.T @ ((alike * noise) @ gradients)
        displaced = displaced + one.curvatures.T @ ((alike * moved) @ curvatures)
    return together + together.T, displaced + displaced.T


def pairs_in_image(view: Contributions
                   ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """As `pairs`, within one view; distances are those in its image."""
    normals = view.directions
    return cdist(view.pixels, view.pixels), normals @ normals.T > FACING, np.ones(())


def pairs(views: Sequence[Contributions], others: Sequence[Contributions], error: ModelError
          ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """Of pairs of stretches: distance [px], whether on one side, alikeness of their views.

    (n, m) each, of those of views with those of others. Distances are those of the places, in
    pixels there.
    """
    (owner, sights, places, normals, scale), other = _joined(views), _joined(others)
    distance = cdist(places, other.places) * np.sqrt(np.multiply.outer(scale, other.scale))
    angle = np.arccos(np.clip(sights @ other.sights.T, -1, 1))
    return (distance, normals @ other.directions.T > FACING,
            error.between_views(angle)[owner][:, other.owner])


class _Joined(NamedTuple):
    """Stretches of several views (n,): number of the view, and as of `Contributions`.

    sights: (v, 3).
    """

    owner: NDArray[np.int64]
    sights: NDArray[np.float64]
    places: NDArray[np.float64]
    directions: NDArray[np.float64]
    scale: NDArray[np.float64]


def _joined(views: Sequence[Contributions]) -> _Joined:
    owner = np.repeat(np.arange(len(views)), [len(each.scale) for each in views])
    return _Joined(owner, np.array([each.sight for each in views]), *(
        np.concatenate([getattr(each, name) for each in views])
        for name in ('places', 'directions', 'scale')))


def _places(points: ContourPoints, pinhole: Pinhole) -> NDArray[np.float64]:
    """(n, 3) a contour's points in the camera's frame [m]."""
    return pinhole.rays(points.pixels) * points.depths[:, None]
