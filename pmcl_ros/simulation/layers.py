"""Draws textured layers into views: planes by homographies, meshes by z-buffers."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import ViewGrid
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window, sphere_bounds
from pmcl_ros.simulation.scenes.textures import SIZE, Texture

Picture = NDArray[np.float32]

_ZOOM = 2  # samples of a solid's outline per pixel
_TEXEL = 0.7  # px: size of a texel in the image; finer patterns would alias


@dataclass(frozen=True)
class Plane:
    """A textured rectangle, or an infinite plane.

    pose: (4, 4), plane to fixed frame [m]; x and y run along its sides from its centre.
    picture: (rows, columns, 4) float32, colour times opacity, then opacity; `texel` metres each.
    endless: whether the picture repeats without end.
    """

    pose: NDArray[np.float64]
    picture: Picture
    texel: float
    endless: bool

    @classmethod
    def from_texture(cls, pose: NDArray[np.float64], texture: Texture, side: float,
                     footprint: float, size: tuple[float, float] | None = None,
                     opacity: float = 1.0) -> 'Plane':
        """A plane of a periodic texture.

        side: of one period [m]. footprint: of a pixel on the plane [m]. size: [m]; None: endless.
        """
        count = int(np.clip(side / (_TEXEL * footprint), 16, SIZE))
        tile = cv2.resize(texture, (count, count), interpolation=cv2.INTER_AREA)
        texel = side / count
        if size is not None:
            across, down = (max(2, round(each / texel)) for each in size)
            tile = np.tile(tile, (-(-down // count), -(-across // count), 1))[:down, :across]
        picture = np.concatenate([opacity * tile, np.full((*tile.shape[:2], 1), opacity)], axis=2)
        return cls(pose, np.ascontiguousarray(picture, np.float32), texel, size is None)

    def drawn(self, camera: Pinhole, view_from_fixed: NDArray[np.float64]) -> Picture:
        """(height, width, 4) the plane in a view; view_from_fixed: (4, 4)."""
        rows, columns = self.picture.shape[:2]
        # From texels to metres on the plane, on to the view, on to pixels.
        metres = np.array([[self.texel, 0, -self.texel * (columns - 1) / 2],
                           [0, self.texel, -self.texel * (rows - 1) / 2], [0, 0, 1]])
        pose = view_from_fixed @ self.pose
        pixels = camera.matrix @ pose[:3, [0, 1, 3]] @ metres
        border = cv2.BORDER_WRAP if self.endless else cv2.BORDER_CONSTANT
        return np.asarray(cv2.warpPerspective(
            self.picture, np.linalg.inv(pixels), (camera.width, camera.height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=border), np.float32)


@dataclass(frozen=True)
class TexturedMesh:
    """An object whose mesh is about z, with a texture wound about it.

    texture: around the axis (columns) and along it (rows), `side` metres a period.
    opacity: far from the outline. rim: opacity at the outline, fading over `width` [m].
    light: (3,) direction towards the light, in the fixed frame.
    """

    model: ObjectModel
    texture: Texture
    side: float
    opacity: float
    rim: float
    width: float
    light: NDArray[np.float64]

    def drawn(self, grid: ViewGrid, pose: NDArray[np.float64], light: NDArray[np.float64]
              ) -> tuple[Picture, Window]:
        """(views, height, width, 4) the solid in all views, row by row, and its window in them.

        pose: (4, 4), object to camera. light: (3,) in the camera's frame.
        """
        poses = np.stack([_moved(pose, -shift) for shift in view_shifts(grid)])
        fine = grid.pinhole.resized(_ZOOM * grid.pinhole.width, _ZOOM * grid.pinhole.height)
        window = _window(grid.pinhole, poses, self.model.radius)
        zoomed = Window(_ZOOM * window.left, _ZOOM * window.top,
                        (_ZOOM * window.size[0], _ZOOM * window.size[1]))
        depth = pose[2, 3]
        near, far = (depth + sign * 1.1 * self.model.radius for sign in (-1, 1))
        depths = NumbaRenderer().depths(Scene(self.model, fine, zoomed, near, far), poses)
        camera = zoomed.pinhole(fine)
        drawn = [self._coloured(each, camera, place, light)
                 for each, place in zip(depths, poses, strict=True)]
        return np.stack([cv2.resize(each, window.size, interpolation=cv2.INTER_AREA)
                         for each in drawn]), window

    def _coloured(self, depth: NDArray[np.float32], camera: Pinhole,
                  pose: NDArray[np.float64], light: NDArray[np.float64]) -> Picture:
        """(height, width, 4) of one view's depths [m], 0 where the solid is not."""
        picture = np.zeros((*depth.shape, 4), np.float32)
        y, x = np.nonzero(depth)
        z = depth[y, x, None]
        place = (z * camera.rays(np.stack([x, y], axis=1))).astype(np.float32)
        to_object = np.linalg.inv(pose).astype(np.float32)
        own = place @ to_object[:3, :3].T + to_object[:3, 3]
        around = np.arctan2(own[:, 1], own[:, 0]) / np.float32(2 * np.pi) + np.float32(0.5)
        rows = own[:, 2] / self.side * SIZE
        colour = self.texture[rows.astype(np.int64) % SIZE,
                              (around * SIZE).astype(np.int64) % SIZE]
        outwards = own[:, :2] / np.maximum(np.hypot(own[:, 0], own[:, 1]), 1e-6)[:, None]
        facing = outwards @ (pose[:3, :3].T @ light)[:2].astype(np.float32)
        opacity = np.full(len(z), self.opacity, np.float32)
        if self.rim > self.opacity:
            inside = cv2.distanceTransform((depth > 0).astype(np.uint8), cv2.DIST_L2, 3)[y, x]
            inside *= np.float32(pose[2, 3] / camera.fx / self.width)
            opacity += (self.rim - self.opacity) * np.exp(-inside)
        shade = 0.65 + 0.35 * facing
        picture[y, x, :3] = colour * (shade * opacity)[:, None]
        picture[y, x, 3] = opacity
        return picture


def view_shifts(grid: ViewGrid) -> NDArray[np.float64]:
    """(views, 3) positions of the views' pinholes, row by row, in the camera's frame [m]."""
    places = grid.baseline * grid.positions.reshape(-1, 2)
    return np.concatenate([places, np.zeros((len(places), 1))], axis=1)


def composited(below: Picture, layer: Picture) -> Picture:
    """(..., 3) a layer (..., 4) composed over a picture (..., 3)."""
    return np.asarray(below * (1 - layer[..., 3:]) + layer[..., :3], np.float32)


def _moved(pose: NDArray[np.float64], shift: NDArray[np.float64]) -> NDArray[np.float64]:
    moved = pose.copy()
    moved[:3, 3] += shift
    return moved


def _window(pinhole: Pinhole, poses: NDArray[np.float64], radius: float) -> Window:
    """The part of the image that holds a solid at all poses; at least one pixel."""
    bounds = sphere_bounds(pinhole, poses[:, :3, 3], radius)
    left, top = np.clip(np.floor(bounds[:, :2].min(axis=0)), 0,
                        [pinhole.width - 1, pinhole.height - 1]).astype(int)
    right, bottom = np.clip(np.ceil(bounds[:, 2:].max(axis=0)) + 1, [left + 1, top + 1],
                            [pinhole.width, pinhole.height]).astype(int)
    return Window(int(left), int(top), (int(right - left), int(bottom - top)))
