"""Meshes, and volumes in which one of them is seen, without any light field."""

import numpy as np
import trimesh
from scipy.ndimage import distance_transform_edt
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.gl_renderer import GlRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window

# Not square, no multiple of 4, its pixels not square either.
CAMERA = Pinhole(237, 213, 720, 690, 120.5, 103.0)
# The same with larger pixels, which are soon searched.
COARSE = CAMERA.resized(159, 143)


def cup():
    """A vessel about the z axis, wider at its top, 0.1 m high."""
    profile = [(0, -0.05), (0.022, -0.05), (0.024, -0.01), (0.032, 0.05), (0, 0.05)]
    return trimesh.creation.revolve(profile, sections=24)


def bracket(arms=(0.08, 0.05, 0.035), width=0.022):
    """Three arms along x, y and z from a corner, each of another length: no symmetry at all."""
    boxes = []
    for axis, arm in enumerate(arms):
        size, middle = np.full(3, width), np.zeros(3)
        size[axis], middle[axis] = arm, (arm - width) / 2
        boxes.append(trimesh.creation.box(size).apply_translation(middle))
    mesh = trimesh.util.concatenate(boxes)
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    return mesh


def model_of(mesh, axis=None, name='thing'):
    """What ObjectModel.load would make of the mesh's file."""
    return ObjectModel(name, np.array(mesh.vertices), np.array(mesh.faces, np.int64),
                       None if axis is None else np.array(axis, float), bool(mesh.is_volume))


def pose_of(rotation, position):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.as_matrix(), position
    return pose


def random_poses(count, seed, depth=(0.35, 0.55), aside=0.03):
    rng = np.random.default_rng(seed)
    position = np.stack([rng.uniform(-aside, aside, count), rng.uniform(-aside, aside, count),
                         rng.uniform(*depth, count)], axis=-1)
    turns = Rotation.random(count, rng)
    return np.stack([pose_of(turn, place) for turn, place in zip(turns, position, strict=True)])


def depth_of(context, model, pose, pinhole, zoom=1):
    """(zoom * height, zoom * width) depth of the model's surface [m]; 0 where it is not seen."""
    shift = (zoom - 1) / 2
    camera = Pinhole(pinhole.width * zoom, pinhole.height * zoom, pinhole.fx * zoom,
                     pinhole.fy * zoom, pinhole.cx * zoom + shift, pinhole.cy * zoom + shift)
    near, far = pose[2, 3] - 1.1 * model.radius, pose[2, 3] + 1.1 * model.radius
    scene = Scene(model, camera, Window(0, 0, (camera.width, camera.height)), near, far)
    return GlRenderer(context).depths(scene, pose[None])[0]


def edges_seen(depth, pinhole, depths, jump, zoom=4, strength=1.6):
    """An edge volume with edges on the occluding contours of a depth map, each at its depth.

    depth: (zoom * height, zoom * width) [m], 0 where nothing is. jump: difference in depth across
    an occlusion [m].
    """
    around, kept = near_pixels(depth > 0, zoom)
    tensor = np.zeros((*(each // zoom for each in depth.shape), len(depths), 3), np.float32)
    tensor[kept] = _edges(depth[around], depths, jump, zoom, strength)
    return EdgeVolume(Header(stamp_ns=7), tensor, depths, pinhole)


def near_pixels(mask, zoom):
    """The rows and columns of a mask (zoom * height, zoom * width) up to 8 pixels from it.

    -> those of the mask, those of the pixels (height, width). Farther off an edge that is a pixel
    wide is too faint for float32.
    """
    parts = []
    for size, axis in zip(mask.shape, (1, 0), strict=True):
        filled = np.flatnonzero(mask.any(axis=axis)) // zoom
        first, last = (filled[0], filled[-1]) if len(filled) else (0, -1)
        parts.append(slice(max(first - 8, 0), min(last + 9, size // zoom)))
    return tuple(slice(zoom * each.start, zoom * each.stop) for each in parts), tuple(parts)


def _edges(depth, depths, jump, zoom, strength):
    """The tensor (height, width, labels, 3) of `edges_seen`."""
    close = np.divide(1, depth, out=np.zeros_like(depth), where=depth > 0)
    least = jump / np.median(depth[depth > 0]) ** 2
    nearer = np.zeros(depth.shape)
    for axis in (0, 1):
        for way in (-1, 1):
            other = np.roll(close, way, axis)
            nearer = np.where(close - other > least, close, nearer)
    away, (row, column) = distance_transform_edt(nearer == 0, return_indices=True)
    y, x = np.indices(depth.shape)
    offset = np.stack([x - column, y - row], axis=-1) / zoom
    middle = slice(zoom // 2, None, zoom)
    away, offset = away[middle, middle] / zoom, offset[middle, middle]
    label = np.interp(nearer[row, column][middle, middle], 1 / depths, np.arange(len(depths)))
    # On the contour itself the direction is that of the neighbourhood.
    energy = strength * np.exp(-0.5 * away ** 2)
    n = offset / np.maximum(np.linalg.norm(offset, axis=-1, keepdims=True), 1e-9)
    at_label = np.exp(-0.5 * (np.arange(len(depths)) - label[..., None]) ** 2)
    both = (energy ** 2)[..., None] * at_label
    return np.stack([both * n[..., :1] ** 2, both * n[..., 1:] ** 2,
                     both * n[..., :1] * n[..., 1:]], axis=-1)


def surface_seen(depth, pinhole, depths, width=1.0):
    """A volume whose likelihood is 1 at a depth map's surface, falling over `width` labels."""
    label = np.interp(1 / np.where(depth > 0, depth, np.inf), 1 / depths, np.arange(len(depths)))
    away = np.arange(len(depths)) - label[..., None]
    likelihood = np.exp(-0.5 * (away / width) ** 2) * (depth > 0)[..., None]
    return DepthLikelihoodVolume(Header(stamp_ns=9), likelihood.astype(np.float32), depths,
                                 pinhole)
