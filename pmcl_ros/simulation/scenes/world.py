"""A scene as flat arrays, which compiled kernels read."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.simulation.scenes.environment import Environment
from pmcl_ros.simulation.scenes.materials import AIR, Clear, Medium
from pmcl_ros.simulation.scenes.scene import Decal, Scene, Sheet, Solid
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles
from pmcl_ros.simulation.scenes.textures import SIZE, Texture

F8 = NDArray[np.float64]
I8 = NDArray[np.int64]
# Shape and type of each part that solids are joined in, when there is no solid.
_EMPTY: dict[str, tuple[tuple[int, ...], type]] = {
    'rings': ((0, 8), np.float64), 'media': ((0, 2), np.int64), 'first': ((0,), np.int64),
    'lists': ((0,), np.int64), 'boxes': ((0, 6), np.float64), 'nodes': ((0, 2), np.int64),
    'corners': ((0, 3, 3), np.float64), 'sides': ((0, 2), np.int64)}


class World(NamedTuple):
    """A `Scene` in arrays. Rays are in the camera's frame.

    poses: (solids, 3, 4) camera to object. spheres: (solids, 4) around them, camera's frame.
    kinds: (solids,) 1 where a solid is a mesh. at: (solids, 2) slices of a solid of revolution,
        or root and first triangle of a mesh.
    bounds, rings, media, first, lists: of `Frusta.binned`, one after the other.
    boxes, nodes, corners, sides: of `Triangles.tree`, likewise; sides are the media of a corner.
    materials: (media, 8): 1 if clear, index or coat, absorption or 0, texture, 1 / side,
        roughness.
    sheets: (sheets, 19): middle, x, y, normal, half size, texture, 1 / side, opacity, coat,
        roughness.
    decals: (solids, 8) of `Decal`: heights, middle and half of the azimuths, texture, 1 / side,
        opacity, threshold. Opacity 0: none.
    textures: (textures, SIZE, SIZE, 3) float32.
    panorama, irradiance, turn: of the environment; turn: world from camera.
    lamps: (n, 10): cosine of the polar angle at one end and the other, azimuth at the start and
        its width [rad], what a white surface that faces it sends out (red, green, blue), direction
        of its middle (camera's frame).
    ambient: (9, 3) as irradiance, of the room without its lamps.
    """

    poses: F8
    spheres: F8
    kinds: I8
    at: I8
    bounds: F8
    rings: F8
    media: I8
    first: I8
    lists: I8
    boxes: F8
    nodes: I8
    corners: F8
    sides: I8
    materials: F8
    sheets: F8
    decals: F8
    textures: NDArray[np.float32]
    panorama: NDArray[np.float32]
    irradiance: F8
    turn: F8
    lamps: F8
    ambient: F8

    @classmethod
    def from_scene(cls, scene: Scene) -> 'World':
        """Lay out all solids, sheets, media and textures of a scene."""
        return _Layout(scene).world()


class _Layout:
    """Collects the textures, media, rings and triangles of all solids."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._textures: list[Texture] = []
        self._materials: list[list[float]] = [self._row(AIR)]
        self._parts: dict[str, list[NDArray[np.floating] | I8]] = {name: [] for name in _EMPTY}
        self._counts = dict.fromkeys(self._parts, 0)

    def world(self) -> World:
        scene = self._scene
        solids = [self._solid(each) for each in scene.solids]
        sheets = np.array([self._sheet(each) for each in scene.sheets]).reshape(-1, 19)
        decals = np.array([self._decal(each.decal) for each in scene.solids]).reshape(-1, 8)
        poses, spheres, kinds, at, bounds = zip(*solids, strict=True) if solids else ((),) * 5
        room, turn = scene.environment, scene.world_from_camera
        irradiance = room.irradiance(turn.T)
        parts = {name: np.concatenate([np.zeros(shape, kind), *self._parts[name]])
                 for name, (shape, kind) in _EMPTY.items()}
        textures = self._textures or [np.ones((SIZE, SIZE, 3), np.float32)]
        return World(
            poses=np.array(poses, float).reshape(-1, 3, 4),
            spheres=np.array(spheres, float).reshape(-1, 4), kinds=np.array(kinds, np.int64),
            at=np.array(at, np.int64).reshape(-1, 2),
            bounds=np.array(bounds, float).reshape(-1, 3),
            materials=np.array(self._materials, float), sheets=sheets, decals=decals,
            # Of plain colours np.stack keeps the strides: kernels would be compiled for these too.
            textures=np.ascontiguousarray(np.stack(textures)),
            panorama=room.panorama,
            irradiance=irradiance,
            turn=np.ascontiguousarray(turn, float), lamps=_lamps(room, turn),
            ambient=irradiance if room.unlit is None
            else Environment(room.unlit).irradiance(turn.T), **parts)

    def _solid(self, solid: Solid) -> tuple[F8, F8, int, tuple[int, int], F8]:
        media = np.array([0] + [self._medium(each) for each in solid.media])
        inverse = np.asarray(np.linalg.inv(solid.pose)[:3], np.float64)
        if isinstance(solid.surface, Triangles):
            at, reach = self._mesh(solid.surface, media)
            return inverse, self._sphere(solid, reach), 1, at, np.zeros(3)
        at, bounds = self._revolution(solid.surface, media)
        bottom, top, radius = bounds
        reach = np.array([[radius, radius, bottom], [radius, radius, top]]) / [2 ** .5, 2 ** .5, 1]
        return inverse, self._sphere(solid, reach), 0, at, bounds

    def _sphere(self, solid: Solid, points: F8) -> F8:
        middle = np.array([0, 0, points[:, 2].mean()])
        radius = np.linalg.norm(points - middle, axis=1).max() + 1e-6
        return np.append(solid.pose[:3, :3] @ middle + solid.pose[:3, 3], radius)

    def _revolution(self, surface: Frusta, media: I8) -> tuple[tuple[int, int], F8]:
        first, lists, bounds = surface.binned()
        at = self._counts['first'], self._counts['first'] + len(first) - 1
        self._add(first=first + self._counts['lists'], lists=lists + self._counts['rings'])
        self._add(rings=surface.rings, media=media[surface.media])
        return at, bounds

    def _mesh(self, surface: Triangles, media: I8) -> tuple[tuple[int, int], F8]:
        boxes, nodes, corners = surface.tree()
        at = self._counts['nodes'], self._counts['corners']
        sides = np.tile([[media[surface.outside], media[surface.inside]]], (len(corners), 1))
        self._add(boxes=boxes, nodes=nodes, corners=corners, sides=sides)
        return at, corners.reshape(-1, 3)

    def _add(self, **arrays: NDArray[np.floating] | I8) -> None:
        for name, array in arrays.items():
            self._parts[name].append(array)
            self._counts[name] += len(array)

    def _medium(self, medium: Medium) -> int:
        self._materials.append(self._row(medium))
        return len(self._materials) - 1

    def _row(self, medium: Medium) -> list[float]:
        if isinstance(medium, Clear):
            return [1, medium.index, *medium.absorption, 0, 0, medium.roughness]
        return [0, medium.coat, 0, 0, 0, self._texture(medium.texture), 1 / medium.side,
                medium.roughness]

    def _sheet(self, sheet: Sheet) -> F8:
        pose, half = sheet.pose, np.array(sheet.size) / 2
        return np.concatenate([pose[:3, 3], pose[:3, 0], pose[:3, 1], pose[:3, 2], half,
                               [self._texture(sheet.texture), 1 / sheet.side, sheet.opacity,
                                sheet.coat, sheet.roughness]])

    def _decal(self, decal: Decal | None) -> list[float]:
        if decal is None:
            return [0.0] * 8
        start, end = decal.azimuths
        return [*decal.heights, (start + end) / 2, (end - start) / 2,
                self._texture(decal.texture), 1 / decal.side, decal.opacity, decal.threshold]

    def _texture(self, texture: Texture) -> int:
        for number, known in enumerate(self._textures):
            if known is texture:
                return number
        self._textures.append(texture)
        return len(self._textures) - 1


def _lamps(environment: Environment, turn: F8) -> F8:
    """Of `World`."""
    low, high, start, width, *colours = environment.lamps.T
    solid_angle = (np.cos(low) - np.cos(high)) * width
    polar, azimuth = (low + high) / 2, start + width / 2
    middle = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth),
                       np.cos(polar)], axis=1)
    return np.column_stack([np.cos(low), np.cos(high), start, width,
                            *(each * solid_angle / np.pi for each in colours), middle @ turn])
