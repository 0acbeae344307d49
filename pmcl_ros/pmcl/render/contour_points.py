"""The contour of one pose, point by point in the order in which a finger would follow it."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.render.contour import (
    KernelVolume,
    find,
    is_silhouette,
    normal,
    place,
    region_sum,
    sample,
)
from pmcl_ros.pmcl.render.raster import MARGIN
from pmcl_ros.runtime.kernels import compiled


@dataclass(frozen=True)
class ContourPoints:
    """Points of an occluding contour; pieces that hang together follow each other.

    pixels: (m, 2) x, y in the image. normals: (m, 2) unit, out of the object. depths: (m,) of the
        nearer surface [m]. lengths: (m,) of the contour that the point stands for [image px].
    energies: (m, j) edge energy across the contour at the profile's offsets.
    evidence: (m,) [nat / px]; lengths @ evidence + covered is the pose's
        score.
    piece: (m,) which connected piece a point is of. along: (m,) how far along it [image px].
    outer: (m,) 1 where nothing of the object is beyond the contour, else 0.
    covered: evidence of the pixels that the object covers, beside that of the contour [nat].
    """

    pixels: NDArray[np.float64]
    normals: NDArray[np.float64]
    depths: NDArray[np.float64]
    lengths: NDArray[np.float64]
    energies: NDArray[np.float64]
    evidence: NDArray[np.float64]
    piece: NDArray[np.int64]
    along: NDArray[np.float64]
    outer: NDArray[np.float64]
    covered: float = 0.0

    @classmethod
    def from_zbuffer(cls, box: tuple[int, int, int, int], z: NDArray[np.float32],
                     volume: KernelVolume, profile: ContourProfile) -> 'ContourPoints':
        """Of the contour in a z-buffer (`raster`)."""
        found = np.zeros(2 * len(z), np.int32)
        found = found[:find(box, volume.keep, volume.merged, z, found)]
        order, piece = _followed(found, box[2] - box[0] + 2 * MARGIN)
        values = _values(found[order], box, z, volume)
        known = values[:, 5] > 0
        values, piece = values[known].astype(np.float64), piece[known]
        lengths, energies = values[:, 5], values[:, 7:]
        ends = np.cumsum(lengths)
        middles = ends - lengths / 2
        first = np.searchsorted(piece, piece)  # pieces ascend
        along = middles - (ends - lengths)[first]
        return cls(values[:, :2], values[:, 2:4], 1 / values[:, 4], lengths, energies,
                   profile.evidence(energies), piece, along, values[:, 6],
                   float(_covered(box, z, volume)))

    def seen_through(self, planes: NDArray[np.floating], image: Pinhole, margin: float
                     ) -> 'ContourPoints':
        """Those that are seen where a liquid with flat faces lets them be drawn.

        The others are nearer than a margin [m] to a face, or in the air with the liquid before
        them: a camera below the surface sees through a tank's front, and against the surface from
        below, what is not drawn there.
        planes: (k, 4) of the faces, unit normals into the air, and heights of the camera above
        them [m]. image: whose pixels these are.
        """
        rays = np.column_stack([(self.pixels - [image.cx, image.cy]) / [image.fx, image.fy],
                                np.ones(len(self.pixels))])
        slopes, heights = rays @ planes[:, :3].T, planes[:, 3]
        above = self.depths[:, None] * slopes + heights  # of the points
        # Depths at which the straight lines to the points enter the liquid, and leave it.
        with np.errstate(divide='ignore', invalid='ignore'):
            meets = -heights / slopes
        enters = np.where(slopes < 0, meets, np.where((slopes == 0) & (heights > 0), np.inf, 0))
        leaves = np.where(slopes > 0, meets, np.inf)
        behind = (above > 0).any(axis=1) & (np.maximum(enters.max(axis=1), 0)
                                            < np.minimum(leaves.min(axis=1), self.depths))
        kept = (np.abs(above) > margin).all(axis=1) & ~behind
        return replace(self, **{each.name: getattr(self, each.name)[kept]
                                for each in fields(self) if each.name != 'covered'})

    def joined(self, other: 'ContourPoints') -> 'ContourPoints':
        """These points, then those of another set, read at as many offsets."""
        both = {each.name: np.concatenate([getattr(self, each.name), getattr(other, each.name)])
                for each in fields(self) if each.name != 'covered'}
        both['piece'][len(self.piece):] += self.piece.max(initial=-1) + 1
        return ContourPoints(**both, covered=self.covered)


@compiled()
def _values(found, box, z, volume):  # type: ignore[no-untyped-def]
    """(m, 7 + j) x, y, normal, 1/z, length (0 where there is no normal), outer, readings."""
    stride = box[2] - box[0] + 2 * MARGIN
    values = np.zeros((len(found), 7 + len(volume.offsets)), np.float32)
    for k in range(len(found)):
        near, x, y, closeness = place(found[k], box, (volume.left, volume.top, volume.scale), z)
        nx, ny = normal(near, stride, volume.keep, z)
        label = np.float32((closeness - volume.farthest) * volume.per_closeness)
        values[k, 6] = is_silhouette(found[k], box, z)
        values[k, 0], values[k, 1], values[k, 4] = x, y, closeness
        values[k, 2], values[k, 3] = nx, ny
        if nx != 0 or ny != 0:
            values[k, 5] = volume.scale / (abs(nx) + abs(ny))
        for j in range(len(volume.offsets)):
            off = volume.offsets[j]
            values[k, 7 + j] = sample(volume.tensor, x + off * nx, y + off * ny, label, nx, ny)
    return values


@compiled()
def _covered(box, z, volume):  # type: ignore[no-untyped-def]
    return region_sum(box, z, volume)


@compiled()
def _followed(found, stride):  # type: ignore[no-untyped-def]
    """The order in which pairs follow each other, and the number of the piece that each is of.

    Between a pair's pixels runs a side of both; a side leads from one corner of the pixels to the
    next, the nearer surface on its right. Pieces with two ends come first, from their beginnings;
    then those that close.
    """
    count = len(found)
    starts, ends = np.zeros(count, np.int64), np.zeros(count, np.int64)
    most = 0
    for k in range(count):
        first = found[k] >> 2
        one = first + (stride if found[k] & 2 else 1)  # upper left corner of the second pixel
        other = one + (1 if found[k] & 2 else stride)
        # Downwards the left pixel is on the right hand, rightwards the lower one.
        if bool(found[k] & 1) == bool(found[k] & 2):
            starts[k], ends[k] = one, other
        else:
            starts[k], ends[k] = other, one
        most = max(most, one, other)
    # Up to two sides begin at a corner, where two pixels touch by their corners alone.
    begins = np.full((most + 1, 2), -1, np.int64)
    arrivals = np.zeros(most + 1, np.int64)
    for k in range(count):
        begins[starts[k], 1 if begins[starts[k], 0] >= 0 else 0] = k
        arrivals[ends[k]] += 1
    order, piece = np.zeros(count, np.int64), np.zeros(count, np.int64)
    seen = np.zeros(count, np.bool_)
    done, pieces = 0, 0
    for closing in range(2):
        for k in range(count):
            if seen[k] or (closing == 0 and arrivals[starts[k]] > 0):
                continue
            here = k
            while here >= 0:
                seen[here] = True
                order[done], piece[done] = here, pieces
                done += 1
                following = -1
                for branch in range(2):
                    candidate = begins[ends[here], branch]
                    if candidate >= 0 and not seen[candidate]:
                        following = candidate
                        break
                here = following
            pieces += 1
    return order, piece
