"""Draws random objects with sharp edges: boxes, prisms, tapered boxes, steps."""

from collections.abc import Callable

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import HalfspaceIntersection
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.simulation.scenes.materials import random_glass
from pmcl_ros.simulation.scenes.objects import Finish, SceneObject, random_finish
from pmcl_ros.simulation.scenes.scene import Solid
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles

Block = tuple[trimesh.Trimesh, NDArray[np.float64]]  # mesh, rotations (k, 3, 3) it has
_HOLLOW = 0.6  # share of the convex glass blocks that are hollow


def random_block(rng: np.random.Generator, glass: bool, finish: Finish | None = None
                 ) -> SceneObject:
    """A block of glass, massive or hollow, or an opaque one.

    finish: draws what an opaque one is made of; default: `random_finish`.
    """
    name = list(BLOCKS)[int(rng.integers(len(BLOCKS)))]
    outer, turns = BLOCKS[name](rng)
    outer.apply_translation(-outer.bounds.mean(axis=0))
    corners, kind = outer.triangles, 'massive'
    medium = random_glass(rng) if glass else (finish or random_finish)(rng)
    wall = float(np.exp(rng.uniform(np.log(0.0015), np.log(0.005))))
    if glass and outer.is_convex and rng.random() < _HOLLOW:
        corners, kind = np.concatenate([corners, _inset(outer, wall).triangles[:, ::-1]]), 'hollow'
    solid = Solid(Triangles(np.asarray(corners, float), 0, 1), (medium,), np.eye(4))
    middle = np.asarray(outer.center_mass, float)
    return SceneObject(f'{kind if glass else "opaque"} {name}', (solid,),
                       np.asarray(outer.vertices, float), np.asarray(outer.faces, np.int64), None,
                       discrete=pose_of(turns, middle - turns @ middle))


def _box(rng: np.random.Generator) -> Block:
    return trimesh.creation.box(rng.uniform(0.03, 0.11, 3)), _dihedral(2)


def _prism(rng: np.random.Generator) -> Block:
    """Upright, of three, five or six sides."""
    sides, height = int(rng.choice([3, 5, 6])), rng.uniform(0.05, 0.15)
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = rng.uniform(0.025, 0.045) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return _hull(ring, ring, height), _dihedral(sides)


def _tapered(rng: np.random.Generator) -> Block:
    """A box with a smaller top, which is off its centre."""
    half = rng.uniform(0.02, 0.05, 2)
    ring = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    part = rng.uniform(0.35, 0.8)
    aside = (1 - part) * half * rng.uniform(-1, 1, 2)
    return _hull(ring, part * ring + aside, rng.uniform(0.04, 0.12)), np.eye(3)[None]


def _step(rng: np.random.Generator) -> Block:
    """A box with a notch along one edge: an L-shaped prism."""
    width, height, length = rng.uniform(0.04, 0.1, 3)
    x, z = width * rng.uniform(0.3, 0.7), height * rng.uniform(0.3, 0.7)
    # It begins at the inward corner, so that a fan of triangles fills the profile.
    ring = np.array([[x, z], [x, height], [0, height], [0, 0], [width, 0], [width, z]])
    count = len(ring)
    fan = np.array([[0, k, k + 1] for k in range(1, count - 1)])
    here, following = np.arange(count), np.roll(np.arange(count), -1)
    sides = np.concatenate([np.stack([here, here + count, following + count], axis=1),
                            np.stack([here, following + count, following], axis=1)])
    places = [np.insert(ring, 1, y, axis=1) for y in (0, length)]
    mesh = trimesh.Trimesh(np.concatenate(places),
                           np.concatenate([fan, fan[:, ::-1] + count, sides]), process=False)
    if mesh.volume < 0:
        mesh.invert()
    return mesh, np.eye(3)[None]


def _dihedral(fold: int) -> NDArray[np.float64]:
    """(2 fold, 3, 3) rotations of the dihedral group: about z, and those after a flip about x."""
    about = Rotation.from_rotvec(2 * np.pi / fold * np.outer(np.arange(fold), [0, 0, 1]))
    return np.concatenate([about.as_matrix(),
                           (about * Rotation.from_euler('x', np.pi)).as_matrix()])


def _hull(foot: NDArray[np.float64], top: NDArray[np.float64], height: float) -> trimesh.Trimesh:
    """The convex hull of two rings (n, 2) [m], the top `height` [m] above the foot."""
    return trimesh.convex.convex_hull(np.concatenate([
        np.column_stack([foot, np.zeros(len(foot))]),
        np.column_stack([top, np.full(len(top), height)])]))


def _inset(mesh: trimesh.Trimesh, wall: float) -> trimesh.Trimesh:
    """The convex mesh whose faces lie `wall` [m] inside those of a mesh about the origin."""
    normals = mesh.face_normals
    away = np.einsum('ni,ni->n', normals, mesh.triangles[:, 0])
    planes = np.unique(np.column_stack([normals, wall - away]).round(9), axis=0)
    return trimesh.convex.convex_hull(
        HalfspaceIntersection(planes, np.zeros(3)).intersections)


BLOCKS: dict[str, Callable[[np.random.Generator], Block]] = {
    'box': _box, 'prism': _prism, 'tapered box': _tapered, 'step': _step}
