"""Draws random edge volumes that show an object's contour, without any light field.

They are cheap: the coverage of credible regions needs hundreds of them. A scene has a contour with
gaps, displaced by `ModelError`, a wall behind it, clutter at all depths, and noise that is
correlated between pixels and labels, in units of the contrast around, as in an edge volume.
Strengths and widths are chosen so that energies across contours are distributed as in rendered
scenes (`simulation/scenes`; docs/concepts/evidence.md).
"""

from dataclasses import dataclass

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, distance_transform_edt, gaussian_filter
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.edges import NEIGHBOURHOOD, EdgeVolume
from pmcl_ros.evidence.model_error import FACING, ModelError
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window

_CAMERA = Pinhole(190, 180, 540, 540, 96.5, 88.0)
_ZOOM = 3  # samples of the contour per pixel
_LABELS = 12  # depths of the volume
_SIDE = 0.1  # m, of the region of interest
_WIDTH = 1.2  # px: standard deviation of an edge's energy across it
_INWARDS = 0.15  # px: offset of the energy's centre from the contour, as in rendered scenes
_GAPS = (10.0, 35.0)  # px: correlation lengths of the strength along a contour
_CONTOUR, _OF_SCENE, _OF_PLACE = 1.0, 0.6, 1.0  # its strength, and the scatter of its logarithm
_WALL, _INSIDE = 0.35, (2.5, 8.0)  # an inner wall: strength relative to that, how far inside [px]
_BACKGROUND, _GRAIN = 0.12, 1.3  # energy of noise, and its correlation length [px]
_TEXTURE, _PATCHES = 0.7, 20.0  # scatter of the noise's logarithm, over patches of so many px
_CLUTTER = 25  # other edges


@dataclass(frozen=True)
class EdgeScene:
    """A random edge volume and its truth.

    pose: (4, 4), object to camera [m]. roi_center, roi_size: the region of interest [m].
    """

    model: ObjectModel
    pose: NDArray[np.float64]
    edges: EdgeVolume
    roi_center: tuple[float, float, float]
    roi_size: tuple[float, float, float]


def random_edge_scene(rng: np.random.Generator, error: ModelError) -> EdgeScene:
    """Draw a vessel at any attitude, its contour displaced by a draw of `error`."""
    model = random_solid(rng)
    centre = np.append(rng.uniform(-0.02, 0.02, 2), rng.uniform(0.45, 0.6))
    turn = Rotation.random(None, rng)
    pose = pose_of(turn, centre + rng.uniform(-0.4, 0.4, 3) * _SIDE)
    depths = depth_labels(centre[2] - _SIDE / 2 - model.radius,
                          centre[2] + _SIDE / 2 + model.radius, _LABELS)
    camera = _CAMERA.resized(_ZOOM * _CAMERA.width, _ZOOM * _CAMERA.height)
    tensor = _noise(rng) + _clutter(rng)
    whole = Window(0, 0, (camera.width, camera.height))
    near, far = pose[2, 3] - 1.1 * model.radius, pose[2, 3] + 1.1 * model.radius
    depth = np.asarray(
        NumbaRenderer().depths(Scene(model, camera, whole, near, far), pose[None])[0], float)
    tensor += _contour(rng, depth, depths, 0.2 * model.radius, error)
    edges = EdgeVolume(Header(), _normalised(tensor), depths, _CAMERA)
    x, y, z = (float(each) for each in centre)
    return EdgeScene(model, pose, edges, (x, y, z), (_SIDE,) * 3)


def random_solid(rng: np.random.Generator) -> ObjectModel:
    """A closed vessel about z, its radius a smooth random function of height; 10 to 18 cm high."""
    height, base = rng.uniform(0.1, 0.18), rng.uniform(0.02, 0.035)
    count = int(rng.integers(4, 7))
    radii = base * np.exp(rng.normal(0, 0.3, count))
    z = np.linspace(0, height, 40)
    smooth = gaussian_filter(np.interp(z, np.linspace(0, height, count), radii), 2, mode='nearest')
    profile = [(0, 0), *zip(smooth, z, strict=True), (0, height)]
    mesh = trimesh.creation.revolve(profile, sections=40)
    mesh.apply_translation((0, 0, -height / 2))
    return ObjectModel('solid', np.asarray(mesh.vertices, float),
                       np.asarray(mesh.faces, np.int64), np.array([0, 0, 1.0]), True)


def _field(rng: np.random.Generator, length: float) -> NDArray[np.float64]:
    """A Gaussian random field of unit variance over the image, correlated over `length` [px]."""
    pad = int(3 * length)
    white = rng.normal(size=(_CAMERA.height + 2 * pad, _CAMERA.width + 2 * pad))
    smooth = gaussian_filter(white, length / 2 ** 0.5, mode='wrap')
    inside = smooth[pad:pad + _CAMERA.height, pad:pad + _CAMERA.width]
    return np.asarray(inside / smooth.std())


def _noise(rng: np.random.Generator) -> NDArray[np.float64]:
    """Tensors of random gradients, correlated over pixels and labels."""
    shape = (_CAMERA.height, _CAMERA.width, _LABELS, 2, 2)
    gradients = gaussian_filter(rng.normal(size=shape), (_GRAIN, _GRAIN, 2, 0, 0))
    gradients *= _BACKGROUND / 2 ** 0.5 / gradients.std()
    gradients *= np.exp(_TEXTURE * _field(rng, _PATCHES))[..., None, None, None]
    gx, gy = gradients[..., 0, :], gradients[..., 1, :]
    return np.stack([(gx * gx).sum(-1), (gy * gy).sum(-1), (gx * gy).sum(-1)], axis=-1)


def _clutter(rng: np.random.Generator) -> NDArray[np.float64]:
    """Straight and bent edges of all strengths at random labels."""
    tensor = np.zeros((_CAMERA.height, _CAMERA.width, _LABELS, 3))
    y, x = np.indices((_CAMERA.height, _CAMERA.width))
    for _ in range(_CLUTTER):
        cx, cy = rng.uniform(0, _CAMERA.width), rng.uniform(0, _CAMERA.height)
        angle, length = rng.uniform(0, 2 * np.pi), rng.uniform(8, 50)
        along = (x - cx) * np.cos(angle) + (y - cy) * np.sin(angle)
        bend = rng.normal(0, 0.004)
        across = (y - cy) * np.cos(angle) - (x - cx) * np.sin(angle) - bend * along ** 2
        energy = (rng.uniform(0.3, 1.6) * np.exp(-0.5 * (across / _WIDTH) ** 2)
                  / (1 + np.exp((np.abs(along) - length) / 2)))
        normal = np.arctan2(np.cos(angle), -np.sin(angle) - 2 * bend * along)
        tensor += _edges(energy, np.cos(normal), np.sin(normal), rng.uniform(0, _LABELS - 1), 3.0)
    return tensor


def _contour(rng: np.random.Generator, depth: NDArray[np.float64], depths: NDArray[np.float64],
             jump: float, error: ModelError) -> NDArray[np.float64]:
    """The occluding contour of a depth map [m], and a fainter wall behind some of it."""
    close = np.divide(1, depth, out=np.zeros_like(depth), where=depth > 0)
    least = jump / np.median(depth[depth > 0]) ** 2
    nearer = np.zeros(depth.shape)
    for axis in (0, 1):
        for way in (-1, 1):
            other = np.roll(close, way, axis)
            nearer = np.where(close - other > least, close, nearer)
    _, (row, column) = distance_transform_edt(nearer == 0, return_indices=True)
    middle = slice(_ZOOM // 2, None, _ZOOM)
    row, column = row[middle, middle], column[middle, middle]
    y, x = np.indices(depth.shape)[:, middle, middle]
    dx, dy = (x - column) / _ZOOM, (y - row) / _ZOOM
    inside = (close > 0)[middle, middle]
    label = np.interp(nearer[row, column], 1 / depths, np.arange(len(depths)))
    away = np.hypot(dx, dy)
    # The nearest pixels of the contour belong to the object: its border is half a sample outside.
    outwards = np.where(inside, -away, away) - 0.5 / _ZOOM
    at = row // _ZOOM, column // _ZOOM
    displaced = _displacements(rng, inside, error)[at]
    strength = _strength(rng)[at]
    silhouette = gaussian_filter(inside.astype(float), 1.5)
    ny, nx = np.gradient(silhouette)
    flat = np.hypot(nx, ny) < 1e-4
    nx, ny = np.where(flat, dx, nx), np.where(flat, dy, ny)
    size = np.maximum(np.hypot(nx, ny), 1e-9)
    nx, ny = nx / size, ny / size
    energy = strength * np.exp(-0.5 * ((outwards + _INWARDS - displaced) / _WIDTH) ** 2)
    tensor = _edges(energy, nx, ny, label, 3.0)
    # The inner wall follows the contour at a varying distance, and is weaker.
    depth_of_wall = np.exp(rng.uniform(*np.log(_INSIDE)) + 0.3 * _field(rng, _GAPS[1])[at])
    part = _WALL * np.exp(0.6 * _field(rng, _GAPS[0])[at])
    energy = part * strength * np.exp(-0.5 * ((outwards + depth_of_wall) / _WIDTH) ** 2)
    return tensor + _edges(energy, nx, ny, label, 3.0)


def _strength(rng: np.random.Generator) -> NDArray[np.float64]:
    """(height, width) strength of a contour: it varies along it and from scene to scene."""
    short, long = (_field(rng, length) for length in _GAPS)
    scatter = _OF_PLACE * (short + long) / 2 ** 0.5
    return np.asarray(_CONTOUR * np.exp(_OF_SCENE * rng.normal() + scatter))


def _normalised(tensor: NDArray[np.float64]) -> NDArray[np.float32]:
    """The tensor over its mean in a neighbourhood plus its median, as in `evidence.edges`."""
    energy = tensor[..., 0] + tensor[..., 1]
    around = cv2.GaussianBlur(energy, (0, 0), NEIGHBOURHOOD) + np.median(energy)
    return (tensor / around[..., None]).astype(np.float32)


def _displacements(rng: np.random.Generator, inside: NDArray[np.bool_], error: ModelError
                   ) -> NDArray[np.float64]:
    """(height, width) a draw of `error` along a silhouette's border; elsewhere the nearest one's.
    """
    smooth = gaussian_filter(inside.astype(float), 2.0)
    gradient = np.stack(np.gradient(smooth), axis=-1)
    y, x = np.nonzero(inside != binary_erosion(inside))
    y, x = y[::2], x[::2]
    normals = gradient[y, x] / np.maximum(np.linalg.norm(gradient[y, x], axis=1), 1e-9)[:, None]
    places = np.stack([y, x], axis=-1).astype(float)
    spread = error.covariance(cdist(places, places), normals @ normals.T > FACING)
    drawn = np.zeros(inside.shape)
    # A covariance cut by sides may be indefinite: negative eigenvalues are left out.
    values, vectors = np.linalg.eigh(spread)
    drawn[y, x] = vectors @ (np.sqrt(np.maximum(values, 0)) * rng.normal(size=len(values)))
    known = np.zeros(inside.shape, bool)
    known[y, x] = True
    _, (row, column) = distance_transform_edt(~known, return_indices=True)
    return drawn[row, column]


def _edges(energy: NDArray[np.float64], nx: NDArray[np.float64], ny: NDArray[np.float64],
           label: NDArray[np.float64] | float, spread: float) -> NDArray[np.float64]:
    """(height, width, labels, 3) of edges with a normal each, over `spread` labels."""
    labels = np.arange(_LABELS) - np.asarray(label)[..., None]
    at_label = np.exp(-0.5 * (labels / spread) ** 2)
    square = (energy ** 2)[..., None] * np.broadcast_to(at_label, (*energy.shape, _LABELS))
    return np.stack([square * (each if np.ndim(each) == 0 else each[..., None])
                     for each in (nx * nx, ny * ny, nx * ny)], axis=-1)
