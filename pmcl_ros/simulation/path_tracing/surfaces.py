"""The surfaces of a scene as triangles: with smooth normals and texture coordinates."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles
from pmcl_ros.simulation.scenes.trace import AROUND

_SECTIONS = 256  # of a surface of revolution: at 5 cm from its axis it is 4 um from the true one
_CREASE = np.cos(np.deg2rad(35))  # a mesh that turns by more has an edge there
_UPRIGHT = 0.8  # part of the normal along z from which a texture lies flat


@dataclass(frozen=True)
class Surface:
    """One interface of two media.

    media: what the normals point to and what is behind, as numbers of a `Solid`.
    vertices: (n, 3) [m]. normals: (n, 3), length 1. faces: (m, 3). azimuths: (n,) about z [rad],
    continuous over each face.
    """

    media: tuple[int, int]
    vertices: NDArray[np.float64]
    normals: NDArray[np.float64]
    faces: NDArray[np.int64]
    azimuths: NDArray[np.float64]

    @property
    def places(self) -> NDArray[np.float64]:
        """(n, 2) on a texture [m], as the package's own renderer winds it about z."""
        wound = np.stack([self.azimuths * AROUND, -self.vertices[:, 2]], axis=1)
        return np.where(np.abs(self.normals[:, 2:]) > _UPRIGHT, self.vertices[:, :2], wound)

    def halves(self) -> tuple['Surface', 'Surface']:
        """The faces that look away from the z axis, and the others."""
        middles = self.vertices[self.faces].mean(axis=1)
        away = (self.normals[self.faces].mean(axis=1) * middles)[:, :2].sum(axis=1) > 0
        return replace(self, faces=self.faces[away]), replace(self, faces=self.faces[~away])


def surfaces(shape: Frusta | Triangles) -> Iterator[Surface]:
    """All interfaces of a solid, in its frame; one for each pair of media."""
    if isinstance(shape, Triangles):
        yield _of_triangles(shape)
        return
    for media in np.unique(shape.media, axis=0):
        yield _of_rings(shape.rings[(shape.media == media).all(axis=1)],
                        (int(media[0]), int(media[1])))


def _of_rings(rings: NDArray[np.float64], media: tuple[int, int]) -> Surface:
    turn = np.linspace(-np.pi, np.pi, _SECTIONS + 1)
    around = np.stack([np.cos(turn), np.sin(turn), np.ones_like(turn)], axis=1)  # (sections, 3)
    ends = rings[:, :4].reshape(-1, 2)[:, [0, 0, 1]]
    tilts = rings[:, 4:].reshape(-1, 2)[:, [0, 0, 1]]
    tilts = tilts / np.linalg.norm(tilts[:, 1:], axis=1, keepdims=True)
    vertices = (ends[:, None] * around).reshape(-1, 3)
    normals = (tilts[:, None] * around).reshape(-1, 3)
    low = (np.arange(len(rings))[:, None] * 2 * len(turn) + np.arange(_SECTIONS)).ravel()
    high = low + len(turn)
    # The normal of a ring is to the right of the way from its first end to its second.
    faces = np.concatenate([np.stack([low, low + 1, high + 1], axis=1),
                            np.stack([low, high + 1, high], axis=1)])
    solid = np.linalg.norm(np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]],
                                    vertices[faces[:, 2]] - vertices[faces[:, 0]]), axis=1) > 0
    return Surface(media, vertices, normals, faces[solid], np.tile(turn, 2 * len(rings)))


def _of_triangles(shape: Triangles) -> Surface:
    """Its normals are smooth but at creases; three vertices of its own for each face."""
    corners = shape.corners
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    corners, across = corners[area > 0], across[area > 0]
    flat = across / np.linalg.norm(across, axis=1, keepdims=True)
    points = corners.reshape(-1, 3)
    owner = np.repeat(np.arange(len(corners)), 3)
    _, same = np.unique(np.round(points / 1e-7).astype(np.int64), axis=0, return_inverse=True)
    normals = np.array(_smooth(flat, across, owner, same.ravel()))
    angle = np.arctan2(points[:, 1], points[:, 0]).reshape(-1, 3)
    angle[np.ptp(angle, axis=1) > np.pi] %= 2 * np.pi  # a face across the seam
    return Surface((shape.outside, shape.inside), points, normals,
                   np.arange(len(points)).reshape(-1, 3), angle.ravel())


def _smooth(flat: NDArray[np.float64], across: NDArray[np.float64], owner: NDArray[np.int64],
            same: NDArray[np.int64]) -> NDArray[np.float64]:
    """(3 faces, 3) normals at corners: the mean over faces at the point that turn by less than a
    crease from the corner's own.

    flat, across: (faces, 3) normals, of length 1 and of the area. owner, same: (3 faces,) the
    face of a corner, and the number of its point.
    """
    order = np.argsort(same, kind='stable')
    first = np.searchsorted(same[order], np.arange(same.max() + 2))
    counts = np.diff(first)
    total = np.zeros((len(owner), 3))
    for step in range(int(counts.max())):  # as many as the most faces that meet in a point
        other = order[first[same] + step % counts[same]]
        near = ((step < counts[same])
                & ((flat[owner] * flat[owner[other]]).sum(axis=1) > _CREASE))
        total += np.where(near[:, None], across[owner[other]], 0)
    return np.asarray(total / np.linalg.norm(total, axis=1, keepdims=True))
