"""The profile of most evidence about a given axis, by dynamic programming."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.energies import evidence_across
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.geometry.se3 import inverse
from pmcl_ros.profiles.outline import Cylinder
from pmcl_ros.profiles.revolution import NEAREST, Revolution

_RADII = 64  # of the grid
_ROWS = 64  # of it over the height of the cylinder with its margin
_MOST_ROWS = 112  # of it where a bowl reaches beyond the cylinder: time and memory grow with them
_MARGIN = 1.2  # the grid's sides, in those of the cylinder
_STEEP = 9  # radii that a profile may change by in a step
_BEND = 1.6  # nat / px in each view: of how much more the radius changes than a step before
_UNSEEN = 0.6  # nat / px: what a wall costs that no line of sight touches
_LEAST = -0.3  # nat / px: glass hides parts of its contour
_BESIDE, _OUTSIDE = 4.0, 2.0  # px beside a box, and what contours cost beyond [nat / px]
_FOOT = 0.25  # of the largest radius: what stands has a wider foot
_ASIDE = 0.85  # cosine: contours nearer to the middle are hardly ever part of the outline
_CHANGE = 1.3  # nat / px in each view: of a change of the radius, so that there are few waists
_ARC = 24  # points of half a circle
_DRAWN = 0.01  # of the larger side of a box that is drawn: standard deviation of its sides
_PER_NAT = 2.3  # evidence is a sum over pixels that are not independent; a nat is so much of it
_MOST_OFF = 50.0  # nat: a box that is drawn too large does not decide
_ALONG = 0.8  # cosine: a box has an end where the axis leads to one of its sides


@dataclass(frozen=True)
class PosedMap:
    """The evidence of one view, and its camera's pose (4, 4) in the reference frame.

    box: that holds the object: left, top, right, bottom [px]. drawn: whether somebody has drawn
    it, so that the object ends where it does.
    """

    evidence: EvidenceVolume
    camera: NDArray[np.float64]
    box: tuple[float, float, float, float]
    drawn: bool

    def blurred(self, sigma: float) -> 'PosedMap':
        """For contours whose place is uncertain by `sigma` [px]."""
        return replace(self, evidence=self.evidence.blurred(sigma))

    def scale_at(self, place: NDArray[np.float64]) -> float:
        """Pixels a metre at a place (3,) in the reference frame."""
        depth = float(inverse(self.camera)[2] @ [*place, 1])
        return self.evidence.pinhole.fx / max(depth, NEAREST)

    def seen(self, frame: NDArray[np.float64], places: NDArray[np.float64]
             ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(..., 2) pixels and (...) depths [m] of places (..., 3) in a frame (4, 4) [m].

        Nothing is nearer than `NEAREST`.
        """
        into = np.linalg.inv(self.camera) @ frame
        places = places @ into[:3, :3].T + into[:3, 3]
        places[..., 2] = np.maximum(places[..., 2], NEAREST)
        return self.evidence.pinhole.project(places), places[..., 2]

    def density(self, frame: NDArray[np.float64], radii: NDArray[np.float64],
                heights: NDArray[np.float64], cosine: NDArray[np.float64],
                sign: float, lean: NDArray[np.float64]
                ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Evidence [nat / px] of points of a surface about the axis of `frame`, and px / m there.

        All (...): radii, heights [m]; cosine of the angle about the axis from the camera, on the
        side `sign`; lean: nz / nr of the normal.
        """
        into = np.linalg.inv(self.camera) @ frame
        eye = np.linalg.inv(into)[:3, 3]
        azimuth = np.arctan2(eye[1], eye[0])
        turn = azimuth + sign * np.arccos(np.clip(cosine, -1, 1))
        around = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        places = np.concatenate([radii[..., None] * around, heights[..., None]], axis=-1)
        normals = np.concatenate([around, lean[..., None]], axis=-1)
        pixels, depths = self.seen(frame, places)
        normals = normals @ into[:3, :3].T
        pinhole = self.evidence.pinhole
        across = normals[..., :2] / [pinhole.fx, pinhole.fy]
        across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-12)
        found = evidence_across(self.evidence, pixels.reshape(-1, 2), across.reshape(-1, 2),
                                depths.ravel(), self.evidence.profile, np.zeros(1))
        density = np.maximum(found[:, 0].reshape(depths.shape), _LEAST)
        out = np.maximum(self.box[:2] - pixels, pixels - self.box[2:]).max(axis=-1)
        return np.where(out > _BESIDE, -_OUTSIDE, density), pinhole.fx / depths


def searched(maps: Sequence[PosedMap], about: Cylinder, spacing: float) -> Revolution:
    """The surface about the cylinder's axis whose outline has most evidence.

    spacing: of its knots [m]. Each step of the wall, bottom and top counts where its normals are
    at a right angle to the lines of sight; what the surface itself hides counts too.
    """
    z = _heights(maps, about)
    r = np.linspace(0, _MARGIN * about.radius, _RADII + 1)[1:]
    slopes = np.arange(-_STEEP, _STEEP + 1)
    wall = np.sum([_wall(each, about.frame, z, r, slopes) for each in maps], axis=0)
    bottom, top = (np.sum(each, axis=0) for each in zip(
        *(_edges(each, about.frame, z, r) for each in maps), strict=True))
    pixels = (r[1] - r[0]) * sum(each.scale_at(about.frame[:3, 3]) for each in maps)
    wall = wall - _CHANGE * pixels * abs(slopes)
    bottom = np.where(r < _FOOT * about.radius, -np.inf, bottom)
    rows, columns = np.array(_best_path(wall, bottom, top, _BEND * pixels)).T
    return Revolution.from_curve(about.frame, z[rows], r[columns], spacing)


def _heights(maps: Sequence[PosedMap], about: Cylinder) -> NDArray[np.float64]:
    """(rows,) heights of the grid, about the cylinder's middle [m].

    What is narrower at an end than the cylinder reaches farther there in the same box, as it shows
    less of the circle: by the radius times the tangent of the rise, at most.
    """
    rises = []
    for each in maps:
        x, y, up, _ = np.linalg.inv(about.frame) @ each.camera[:, 3]
        rises.append(abs(up) / max(np.hypot(x, y), 1e-9))
    plain = _MARGIN * about.height
    tallest = max(plain, about.height + 2 * about.radius * min(max(rises), 1.0))
    return np.linspace(-0.5, 0.5, min(round(_ROWS * tallest / plain), _MOST_ROWS)) * tallest


def _wall(view: PosedMap, frame: NDArray[np.float64], z: NDArray[np.float64],
          r: NDArray[np.float64], slopes: NDArray[np.int64]) -> NDArray[np.float64]:
    """(heights - 1, radii, slopes) evidence of a step of the wall from a height and radius."""
    eye = np.linalg.inv(frame) @ view.camera[:, 3]
    aside = max(float(np.hypot(*eye[:2])), 1e-9)
    dr, dz = r[1] - r[0], z[1] - z[0]
    heights, radii, step = np.broadcast_arrays(
        (z[:-1] + dz / 2)[:, None, None], r[None, :, None], slopes[None, None])
    radii = np.maximum(radii + step * dr / 2, dr / 2)
    lean = -step * dr / dz
    cosine = (radii + lean * (heights - eye[2])) / aside
    total = np.zeros(radii.shape)
    for sign in (-1.0, 1.0):
        density, scale = view.density(frame, radii, heights, cosine, sign, lean)
        length = scale * np.hypot(step * dr, dz)
        density = np.where(abs(cosine) < _ASIDE, density, np.minimum(density, 0))
        total += length * np.where(abs(cosine) < 1, density, -_UNSEEN)
    return total


def _edges(view: PosedMap, frame: NDArray[np.float64], z: NDArray[np.float64],
           r: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(heights, radii) evidence of the edge of a bottom there, and of a top [nat]."""
    eye = np.linalg.inv(frame) @ view.camera[:, 3]
    aside = float(np.hypot(*eye[:2]))
    turn = (np.arange(_ARC) + 0.5) * np.pi / _ARC
    heights, radii, cosine = np.broadcast_arrays(
        z[:, None, None], r[None, :, None], np.cos(turn)[None, None])
    off = heights - eye[2]
    lean = (aside * cosine - radii) / np.where(abs(off) > 1e-9, off, 1e-9)
    (one, scale), (other, _) = (view.density(frame, radii, heights, cosine, sign, lean)
                                for sign in (1.0, -1.0))
    # The length of an ellipse's piece in the image, seen from `tilt` above.
    tilt = abs(off) / np.hypot(aside, off)
    length = scale * radii * np.pi / _ARC * np.hypot(cosine, tilt * np.sqrt(1 - cosine ** 2))
    evidence = (one + other) * length
    bottom, top = _ends(view, frame, z, r)
    return (np.where(lean < 0, evidence, 0).sum(axis=-1) + bottom,
            np.where(lean > 0, evidence, 0).sum(axis=-1) + top)


def _ends(view: PosedMap, frame: NDArray[np.float64], z: NDArray[np.float64],
          r: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(heights, radii) evidence of the box that a bottom is there, and of a top [nat].

    A box that is drawn ends where the object does.
    """
    nothing = np.zeros((len(z), len(r)))
    if not view.drawn:
        return nothing, nothing
    turn = (np.arange(2 * _ARC) + 0.5) * np.pi / _ARC
    heights, radii, angles = np.broadcast_arrays(z[:, None, None], r[None, :, None], turn)
    circles = np.stack([radii * np.cos(angles), radii * np.sin(angles), heights], axis=-1)
    (low, high), _ = view.seen(frame, np.array([[0, 0, z[0]], [0, 0, z[-1]]]))
    up = (high - low) / max(float(np.linalg.norm(high - low)), 1e-9)
    side = int(abs(up).argmax())
    if abs(up[side]) < _ALONG:
        return nothing, nothing
    pixels = view.seen(frame, circles)[0][..., side]
    first, last = pixels.min(axis=-1) - view.box[side], pixels.max(axis=-1) - view.box[side + 2]
    sigma = _DRAWN * max(view.box[2] - view.box[0], view.box[3] - view.box[1])
    bottom, top = (-_PER_NAT * np.minimum((off / sigma) ** 2 / 2, _MOST_OFF)
                   for off in ((first, last) if up[side] > 0 else (last, first)))
    return bottom, top


def _best_path(wall: NDArray[np.float64], bottom: NDArray[np.float64], top: NDArray[np.float64],
               cost: float) -> list[tuple[int, int]]:
    """(row, column) of the nodes of the path of most evidence, from the bottom up.

    cost: of a change of slope by one column a row [nat].
    """
    steps, columns, count = wall.shape
    slopes = np.arange(count) - count // 2
    bend = cost * abs(slopes[:, None] - slopes)  # of the next slope, after one
    arrived = np.full((columns, count), -np.inf)  # at a column, by a slope
    value = np.empty(wall.shape)
    came = np.empty(wall.shape, np.int64)  # slope before, -1: begun here
    ends = np.add.outer(np.arange(columns), slopes)
    outside = (ends < 0) | (ends >= columns)
    best, last = -np.inf, (0, 0, 0)
    for row in range(steps):
        continued = arrived[:, None, :] - bend[None]
        before = continued.argmax(axis=2)
        gained = np.take_along_axis(continued, before[..., None], 2)[..., 0]
        fresh = bottom[row][:, None] > gained
        came[row] = np.where(fresh, -1, before)
        value[row] = wall[row] + np.where(fresh, bottom[row][:, None], gained)
        value[row][outside] = -np.inf
        arrived = np.full((columns, count), -np.inf)
        from_, by = np.nonzero(~outside)
        arrived[ends[from_, by], by] = value[row][from_, by]
        final = np.where(outside, -np.inf,
                         value[row] + top[row + 1][ends.clip(0, columns - 1)])
        if final.max() > best:
            best = float(final.max())
            i, j = np.unravel_index(int(final.argmax()), final.shape)
            last = (row, int(i), int(j))
    row, column, slope = last
    path = [(row + 1, column + int(slopes[slope])), (row, column)]
    while came[row, column, slope] >= 0:
        slope = int(came[row, column, slope])
        row, column = row - 1, column - int(slopes[slope])
        path.append((row, column))
    return path[::-1]
