"""Flat faces between air and a liquid, and where things in the liquid appear to be."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import inverse

_STEPS = 60  # of bisection
EDGE = 1e-6  # m: by which a ray may pass a face beside its edge

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Interface:
    """Planes; what is beyond all of them is a medium of another refractive index.

    One plane: standing water, without end. Two, the surface and a tank's front: water that ends
    there. points: (k, 3), one on each plane [m]. normals: (k, 3) unit vectors into the air. index:
    of the medium over that of the air.
    """

    points: Array
    normals: Array
    index: float

    def seen_from(self, camera: Array) -> 'Interface':
        """In the frame of a camera, whose pose (4, 4) is in this one's frame."""
        into = inverse(camera)
        turn, shift = into[:3, :3], into[:3, 3]
        return Interface(self.points @ turn.T + shift, self.normals @ turn.T, self.index)

    @property
    def heights(self) -> Array:
        """(k,) of the frame's origin above each plane [m]; none positive: it is in the medium."""
        return -np.einsum('ki,ki->k', self.normals, self.points)

    def apparent(self, points: Array) -> Array:
        """(n, 3) where points (n, 3) [m] appear to be from the origin of the frame.

        A ray from the origin is bent by Snell's law where it meets a plane. A point in the medium
        appears straight above itself, seen from that plane, on the line of the ray before it is
        bent. Of several planes that one counts which the straight line to the point meets most
        squarely, of those where the bent ray enters the medium; of all where none does. Points in
        the air stay, and all do where the origin is in the medium.
        """
        heights, result = self.heights, points.copy()
        inside = (points @ self.normals.T < -heights).all(axis=1)
        wet = points[inside]
        faces = np.flatnonzero(heights > 0)
        if not (len(faces) and len(wet)):
            return result
        seen, keys = [], []
        for face in faces:
            there, meets = _through(wet, self.normals[face], heights[face], self.index)
            others = np.delete(np.arange(len(heights)), face)
            enters = (meets @ self.normals[others].T <= EDGE - heights[others]).all(axis=1)
            seen.append(there)
            squarely = -wet @ self.normals[face] / np.linalg.norm(wet, axis=1)
            keys.append(squarely + enters)
        result[inside] = np.array(seen)[np.argmax(keys, axis=0), np.arange(len(wet))]
        return result


def _through(points: Array, normal: Array, height: float, index: float) -> tuple[Array, Array]:
    """Where points (n, 3) beyond one plane appear, and where the rays to them meet the plane."""
    along = points @ normal
    s, foot = -height - along, points - along[:, None] * normal
    across = np.linalg.norm(foot, axis=1)
    low, high = np.zeros_like(across), across.copy()
    for _ in range(_STEPS):  # for where the ray meets the plane: more to go below, less above
        meets = (low + high) / 2
        rest = across - meets
        short = (meets / np.hypot(meets, height)
                 < index * rest / np.maximum(np.hypot(rest, s), 1e-300))
        low, high = np.where(short, meets, low), np.where(short, high, meets)
    meets = (low + high) / 2
    seen = np.where(across > 1e-9, height * (across - meets) / np.maximum(meets, 1e-300),
                    s / index)
    way = foot * (meets / np.maximum(across, 1e-300))[:, None]
    return points + (s - seen)[:, None] * normal, way - height * normal
