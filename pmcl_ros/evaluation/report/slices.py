"""Slices of a surface, a light field and its volume under one row or column of pixels."""

from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.drawing.pictures import silhouette
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid
from pmcl_ros.pmcl.object_model import ObjectModel

Along = Literal['x', 'y']  # a row of pixels, or a column
_ZOOM = 4  # of the mask: outlines to a quarter of a pixel
_EMPTY = np.zeros((0, 2, 2))


def outlines(pinhole: Pinhole, model: ObjectModel, pose: NDArray[np.floating]
             ) -> list[NDArray[np.float64]]:
    """Closed polylines (n, 2) [px] about the pixels that a model covers at a pose (4, 4)."""
    mask = silhouette(pinhole, model, pose, _ZOOM).astype(np.uint8)
    found, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_TC89_L1)
    return [(each[:, 0] + 0.5) / _ZOOM - 0.5 for each in found]


def middle(model: ObjectModel, pose: NDArray[np.floating]) -> NDArray[np.float64]:
    """(3,) the middle of the mesh's bounding box in the camera's frame [m].

    An object's origin may lie anywhere, on its foot for example.
    """
    centre = (model.vertices.min(axis=0) + model.vertices.max(axis=0)) / 2
    return np.asarray(pose[:3, :3] @ centre + pose[:3, 3])


def cut(pinhole: Pinhole, model: ObjectModel, pose: NDArray[np.floating], along: Along,
        pixel: float) -> NDArray[np.float64]:
    """(k, 2, 2) pieces of the surface under one row or column of pixels.

    Each has two ends: the place along the row or column [px], and the depth [m].
    """
    across = 1 if along == 'x' else 0
    focal, centre = (pinhole.fx, pinhole.cx) if across == 0 else (pinhole.fy, pinhole.cy)
    normal = np.zeros(3)
    normal[across], normal[2] = 1, -(pixel - centre) / focal
    vertices = model.vertices @ pose[:3, :3].T + pose[:3, 3]
    mesh = trimesh.Trimesh(vertices, model.faces, process=False)
    intersections: Any = trimesh.intersections
    pieces = np.asarray(intersections.mesh_plane(mesh, normal, np.zeros(3)))
    if not len(pieces):
        return _EMPTY
    ahead = pieces[(pieces[..., 2] > 0).all(axis=1)]
    return np.stack([pinhole.project(ahead)[..., 1 - across], ahead[..., 2]], axis=-1)


def depths_at(pieces: NDArray[np.float64], pixel: float) -> NDArray[np.float64]:
    """(n,) depths [m], ascending, at which the ray of a pixel meets pieces (k, 2, 2) of `cut`."""
    first, last = pieces[:, 0], pieces[:, 1]
    met = (first[:, 0] <= pixel) != (last[:, 0] <= pixel)
    first, last = first[met], last[met]
    part = (pixel - first[:, 0]) / (last[:, 0] - first[:, 0])
    # Along a straight piece 1/z is linear in the image.
    return np.sort(1 / ((1 - part) / first[:, 1] + part / last[:, 1]))


def label_at(depths: NDArray[np.float64], metres: ArrayLike) -> NDArray[np.float64]:
    """The labels, with fractions, of depths [m] in a volume of labels `depths` (labels,) [m].

    Counted from 0; labels beyond the volume continue its scale.
    """
    inverse = 1 / np.asarray(depths, float)
    step = (inverse[-1] - inverse[0]) / (len(inverse) - 1)
    return np.asarray((1 / np.asarray(metres, float) - inverse[0]) / step)


def volume_slice(volume: DepthLikelihoodVolume, along: Along, pixel: int) -> NDArray[np.float32]:
    """The likelihood along a row or column of pixels, over depth.

    'x': (labels, width), from above, far above near. 'y': (height, labels), from the side, near
    left of far.
    """
    if along == 'x':
        return volume.likelihood[pixel].T
    return volume.likelihood[:, pixel, ::-1]


class EpipolarSlice(NamedTuple):
    """pixels: (views, length, 3) uint8, as shown. positions: (views,) of these [view steps]."""

    pixels: NDArray[np.uint8]
    positions: NDArray[np.float64]


def epipolar_slice(light_field: LightField, along: Along, pixel: int) -> EpipolarSlice:
    """The row of pixels `pixel` in the centre's row of views; for 'y' columns of both.

    Views without light are left out.
    """
    row, column = light_field.grid.centre
    if along == 'x':
        views, positions, weights = (light_field.views[row, :, pixel],
                                     light_field.grid.positions[row, :, 0],
                                     light_field.grid.weights[row])
    else:
        views, positions, weights = (light_field.views[:, column, :, pixel],
                                     light_field.grid.positions[:, column, 1],
                                     light_field.grid.weights[:, column])
    lit = weights > 0
    shown = light_field.colour.displayed(views[lit], light_field.gamma)
    return EpipolarSlice(shown, positions[lit])


def track(grid: ViewGrid, along: Along, pixel: float, depth: float,
          positions: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n,) where views at `positions` (n,) see the point that the centre view has at `pixel` [px].

    depth: of the point [m]. A view step moves it by focal length x baseline / depth (`ViewGrid`).
    """
    focal = grid.pinhole.fx if along == 'x' else grid.pinhole.fy
    return pixel - focal * grid.baseline / depth * np.asarray(positions, float)
