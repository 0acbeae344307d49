"""Templates: outlines of an object seen from all sides."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import least_turn
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.back_end import Renderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.runtime.errors import ObjectModelError

POINTS = 64  # of an outline, a multiple of 4
DIRECTIONS = 32  # of its normals
_SIDE = 256  # px, of the z-buffers that outlines are taken from
_TILTS = 25  # of a symmetry axis against the line of sight: 7.5 degrees apart
_SIDES = 400  # from which an object without symmetry is seen: about 10 degrees apart
_BORDER = 0.09  # half of that [rad]
_AT_ONCE = 40  # sides rendered


@dataclass(frozen=True)
class Templates:
    """Outlines of the object, its origin straight ahead at `depth` [m].

    rotations: (n, 3, 3), object to a camera that looks straight at it.
    offsets: (n, points, 2) of the outline from the projected origin, in units of tan(angle).
    normals: (n, points) angle of the outward normal [rad].
    lengths: (n,) of the outline, same units as the offsets.
    """

    depth: float
    rotations: NDArray[np.float64]
    offsets: NDArray[np.float64]
    normals: NDArray[np.float64]
    lengths: NDArray[np.float64]

    @classmethod
    def from_views(cls, renderer: Renderer, model: ObjectModel, depth: float) -> 'Templates':
        """Render a model from all sides, at `depth` [m] or farther, so that all of it is in view.

        Raises ObjectModelError where it cannot be seen from any.
        """
        rotations = _viewing_rotations(model)
        depth = max(depth, 1.5 * model.radius)
        half = _SIDE / 2
        focal = 0.95 * half * (depth ** 2 - model.radius ** 2) ** 0.5 / model.radius
        camera = Pinhole(_SIDE, _SIDE, focal, focal, half - 0.5, half - 0.5)
        poses = np.tile(np.eye(4), (len(rotations), 1, 1))
        poses[:, :3, :3], poses[:, 2, 3] = rotations, depth
        scene = Scene(model, camera, Window(0, 0, (_SIDE, _SIDE)),
                      depth - 1.01 * model.radius, depth + 1.01 * model.radius)
        # A batch at a time: z-buffers of all sides at once would take 200 MB.
        masks = [mask for first in range(0, len(poses), _AT_ONCE)
                 for mask in renderer.depths(scene, poses[first:first + _AT_ONCE]) > 0]
        # A sheet without thickness has no outline seen edge-on.
        seen = [k for k, mask in enumerate(masks) if mask.any()]
        if not seen:
            raise ObjectModelError(f'mesh {model.name!r} cannot be seen: its surface is thinner '
                                   f'than {2 * model.radius / _SIDE:.2g} m from every side')
        points, normals, lengths = (np.stack(part) for part in
                                    zip(*(_outline(masks[k]) for k in seen), strict=True))
        return cls(depth, rotations[seen], (points - camera.cx) / focal, normals,
                   lengths / focal)

    def turned(self, turns: NDArray[np.float64], pinhole: Pinhole
               ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Offsets (n * turns, points, 2) [px] and directions (n * turns, points) at every turn.

        turns: (turns,) in the image [rad]. directions: whole numbers below `DIRECTIONS`.
        """
        cos, sin = np.cos(turns)[:, None], np.sin(turns)[:, None]
        x, y = self.offsets[:, None, :, 0], self.offsets[:, None, :, 1]
        offsets = np.stack([(cos * x - sin * y) * pinhole.fx, (sin * x + cos * y) * pinhole.fy],
                           axis=-1).astype(np.float32)
        # Pixels that are not square turn the normals too.
        angle = self.normals[:, None, :] + turns[:, None]
        angle = np.arctan2(np.sin(angle) * pinhole.fx, np.cos(angle) * pinhole.fy)
        directions = np.rint(angle / (2 * np.pi) * DIRECTIONS).astype(int) % DIRECTIONS
        return offsets.reshape(-1, POINTS, 2), directions.reshape(-1, POINTS).astype(np.uint8)


def _viewing_rotations(model: ObjectModel) -> NDArray[np.float64]:
    """(n, 3, 3) rotations that show the object from every side, up to a turn in the image.

    One of the sides that are equivalent by a symmetry that keeps the origin in place, as the
    region holds the origin.
    """
    turns = model.symmetry.rotations_in_place
    if model.axis is not None:
        upright = least_turn(model.axis, np.array([0, 0, 1.0]))
        tilts = np.linspace(0, np.pi, _TILTS)
        if len(turns) > 1:  # it can only turn the axis round
            tilts = tilts[:_TILTS // 2 + 1]
        return (Rotation.from_rotvec(tilts[:, None] * [0, 1.0, 0]) * upright).as_matrix()
    # A Fibonacci lattice on the sphere of lines of sight.
    k = np.arange(_SIDES) + 0.5
    polar, azimuth = np.arccos(1 - 2 * k / _SIDES), np.pi * (1 + 5 ** 0.5) * k
    sides = np.stack([-np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth),
                      np.cos(polar)], axis=-1)
    first = _first_sides(sides, turns)
    polar, azimuth = polar[first], azimuth[first]
    return (Rotation.from_rotvec(polar[:, None] * [0, 1.0, 0])
            * Rotation.from_rotvec(azimuth[:, None] * [0, 0, 1.0])).as_matrix()


def _first_sides(sides: NDArray[np.float64], turns: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) which of unit vectors (n, 3) are needed, up to the rotations (m, 3, 3).

    Those nearer to some direction than to what the rotations make of it (a Dirichlet domain), and
    as far beyond as the lattice is coarse.
    """
    middle = np.array([0.36, 0.48, 0.8])  # on no axis that meshes are likely to have
    off = turns[1:] @ middle - middle
    border = off / np.maximum(np.linalg.norm(off, axis=1, keepdims=True), 1e-9)
    return np.asarray((sides @ border.T <= _BORDER).all(axis=1))


def _outline(mask: NDArray[np.bool_]
             ) -> tuple[NDArray[np.float64], NDArray[np.float64], np.float64]:
    """Points (n, 2) at equal steps along a mask's border, their normals' angles, its length [px].

    Normals point outwards.
    """
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    # Edge pixels of the mask lie half a pixel inside its border; smoothing gives the staircase a
    # direction.
    smooth = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 2.0)
    gx, gy = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    pixels = np.concatenate([each[:, 0] for each in contours])
    length = np.float64(sum(cv2.arcLength(each, True) for each in contours))
    pixels = pixels[np.linspace(0, len(pixels), POINTS, endpoint=False).astype(int)]
    x, y = pixels.T
    angles = np.arctan2(-gy[y, x], -gx[y, x]).astype(np.float64)
    return pixels + 0.5 * np.stack([np.cos(angles), np.sin(angles)], axis=-1), angles, length
