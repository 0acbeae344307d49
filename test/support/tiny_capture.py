"""A capture small enough to be localised in quickly: a cup before a patterned wall."""

import json

import numpy as np
from pmcl_scenes import cup, model_of
from scipy.spatial.transform import Rotation

from pmcl_ros.drawing.pictures import silhouette
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.lightfield.readers.npz import write_npz

PINHOLE = Pinhole(112, 104, 300, 300, 55.0, 52.5)
QUICK = 'proposals=6,particles=16,moves=1'
_WALL = 0.7  # m
_BASELINE = 0.002  # m
_SIDE = 3
_FINE = 4  # samples of a pixel's side


def pose(seed):
    """Upright as seen from obliquely above, a little tilted."""
    rng = np.random.default_rng(seed)
    result = np.eye(4)
    turn = Rotation.from_euler('x', 115, degrees=True) * Rotation.from_rotvec(
        0.1 * rng.standard_normal(3))
    result[:3, :3] = turn.as_matrix()
    result[:3, 3] = [*rng.uniform(-0.01, 0.01, 2), 0.4]
    return result


def light_field(truth, mesh, empty=False):
    """Views of a mesh at a pose."""
    grid = ViewGrid(PINHOLE, _BASELINE, nominal_positions(_SIDE, _SIDE),
                    np.ones((_SIDE, _SIDE), np.float32))
    views = np.empty((_SIDE, _SIDE, PINHOLE.height, PINHOLE.width, 3), np.float32)
    v, u = np.mgrid[:PINHOLE.height, :PINHOLE.width]
    for row, column in np.ndindex(_SIDE, _SIDE):
        x, y = _BASELINE * grid.positions[row, column]
        a, b = (u - PINHOLE.cx) / PINHOLE.fx + x / _WALL, (v - PINHOLE.cy) / PINHOLE.fy + y / _WALL
        wall = 0.35 + 0.1 * np.sin(60 * a + 25 * b) * np.cos(70 * b - 20 * a)
        moved = truth.copy()
        moved[:2, 3] -= x, y
        cover = silhouette(PINHOLE, model_of(mesh), moved, _FINE) & (not empty)
        part = cover.reshape(PINHOLE.height, _FINE, PINHOLE.width, _FINE).mean(axis=(1, 3))
        views[row, column] = (wall + part * (0.9 - wall))[..., None]
    return LightField(Header(), views, grid)


def write_capture(folder, seed=0, mesh=None, film=False, empty=False):
    """A folder as `pmcl evaluate` takes, with a light field as its picture."""
    mesh = cup() if mesh is None else mesh
    folder.mkdir(parents=True)
    truth = pose(seed)
    write_npz(folder / 'views.npz', light_field(truth, mesh, empty))
    mesh.export(folder / 'model.obj')
    (folder / 'truth.json').write_text(json.dumps({
        'object_to_camera': truth.tolist(), 'film': film, 'empty': empty,
        'roi': {'center': [0.005, -0.005, 0.4], 'size': [0.05, 0.05, 0.06]}}))
    return folder
