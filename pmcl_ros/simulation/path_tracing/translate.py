"""A scene as Mitsuba takes it: shapes, materials, the light of the room."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.runtime.errors import SimulationError
from pmcl_ros.simulation.path_tracing.integrator import BEFORE, BEHIND, BOUNCES
from pmcl_ros.simulation.path_tracing.surfaces import Surface, surfaces
from pmcl_ros.simulation.path_tracing.variant import mitsuba
from pmcl_ros.simulation.scenes.environment import Environment
from pmcl_ros.simulation.scenes.materials import AIR, Clear, Medium, Opaque
from pmcl_ros.simulation.scenes.scene import Decal, Scene, Sheet, Solid
from pmcl_ros.simulation.scenes.textures import SIZE, Texture

_ALL_DIFFERENT = 1e-6  # of two refractive indices
_DECAL = 512, 1024  # rows and columns of a decal about a solid


def to_mitsuba(scene: Scene) -> Any:
    """A scene that `mitsuba.render` takes, in the frame of the scene's camera, without a sensor.

    Glass refracts and reflects by Fresnel's equations, and absorbs; matt surfaces under a coat are
    of the `plastic` model; sheets are matt on both sides. The environment is its panorama: lamps
    are a part of it. Raises SimulationError for what is not translated: sheets that scatter what
    comes through them.
    """
    parts: dict[str, Any] = {'type': 'scene', 'room': _room(scene)}
    for number, solid in enumerate(scene.solids):
        for of, surface in enumerate(surfaces(solid.surface)):
            for side, shape in enumerate(_interface(surface, solid)):
                parts[f'solid_{number}_{of}_{side}'] = shape
    for number, sheet in enumerate(scene.sheets):
        parts[f'sheet_{number}'] = _sheet(sheet, scene.name)
    parts['integrator'] = {'type': 'volpath', 'max_depth': BOUNCES}
    return mitsuba().load_dict(parts)


def _interface(surface: Surface, solid: Solid) -> Iterator[Any]:
    """Its meshes: none where both media are the same; its outside has one of its own for a decal.
    """
    front, back = ((AIR, *solid.media)[each] for each in surface.media)
    material = _between(front, back)
    if material is None or not len(surface.faces):
        return
    turn = solid.pose[:3, :3]

    def mesh(of: Surface, made_of: dict[str, Any], places: NDArray[np.float64]) -> Any:
        return _mesh(of.vertices @ turn.T + solid.pose[:3, 3], of.normals @ turn.T, of.faces,
                     places, made_of, front, back)

    if solid.decal is None or surface.media[0] != 0 or not isinstance(back, Clear):
        yield mesh(surface, material, surface.places)
        return
    outer, inner = surface.halves()
    if len(inner.faces):
        yield mesh(inner, material, inner.places)
    if not len(outer.faces):
        return
    low, high = np.ptp(outer.vertices[:, 2]) * np.array([-0.01, 1.01]) + outer.vertices[:, 2].min()
    places = np.stack([outer.azimuths / (2 * np.pi), (outer.vertices[:, 2] - low) / (high - low)],
                      axis=1)
    yield mesh(outer, _under(material, solid.decal, outer, (low, high)), places)


def _under(material: dict[str, Any], decal: Decal, surface: Surface, heights: tuple[float, float]
           ) -> dict[str, Any]:
    """A material with a decal on it, over azimuth (0 to 1) and height (0 to 1, of `heights`)."""
    mi = mitsuba()
    azimuth = 2 * np.pi * (np.arange(_DECAL[1]) + 0.5) / _DECAL[1]
    z = heights[0] + (heights[1] - heights[0]) * (np.arange(_DECAL[0]) + 0.5) / _DECAL[0]
    order = np.argsort(surface.vertices[:, 2])
    radii = np.interp(z, surface.vertices[order, 2],
                      np.hypot(*surface.vertices[order, :2].T))
    signed = (azimuth + np.pi) % (2 * np.pi) - np.pi
    size = len(decal.texture)
    rows = np.floor(-z / decal.side % 1 * size).astype(int) % size
    columns = np.floor(signed * radii[:, None] / decal.side % 1 * size).astype(int) % size
    seen = decal.texture[rows[:, None], columns]
    start, end = decal.azimuths
    aside = np.abs((signed - (start + end) / 2 + np.pi) % (2 * np.pi) - np.pi)
    there = (aside <= (end - start) / 2) & ((z >= decal.heights[0]) & (z <= decal.heights[1])
                                            )[:, None]
    share = np.where(there, decal.opacity, 0.0)
    if decal.threshold > 0:
        share *= np.clip(4 * (seen.mean(axis=2) - decal.threshold) / decal.threshold, 0, 1)

    def bitmap(values: NDArray[np.floating]) -> dict[str, Any]:
        flipped = np.ascontiguousarray(values[::-1], np.float32)
        data = mi.TensorXf(flipped)
        _taken_over()
        return {'type': 'bitmap', 'raw': True, 'wrap_mode': 'repeat', 'data': data}

    return {'type': 'blendbsdf', 'weight': bitmap(share[..., None]), 'first': material,
            'second': {'type': 'twosided', 'inner': {
                'type': 'diffuse', 'reflectance': bitmap(seen)}}}


def _between(front: Medium, back: Medium) -> dict[str, Any] | None:
    """The material of the interface that looks to `front`."""
    if isinstance(back, Opaque):
        return _matt(back.texture, back.side, back.coat, back.roughness, _index(front))
    if isinstance(front, Opaque):
        return {'type': 'twosided', 'inner': _matt(front.texture, front.side, front.coat,
                                                   front.roughness, _index(back))}
    if abs(front.index - back.index) < _ALL_DIFFERENT:
        return None if front.absorption == back.absorption else {'type': 'null'}
    rough = max(front.roughness, back.roughness)
    return {'type': 'dielectric', 'int_ior': back.index, 'ext_ior': front.index} | _rough(rough)


def _rough(roughness: float) -> dict[str, Any]:
    """What makes a smooth material rough.

    A Beckmann distribution of width alpha has slopes of standard deviation alpha / sqrt(2) along
    each axis (Walter et al., Microfacet models for refraction, 2007).
    """
    if roughness <= 0:
        return {}
    return {'type': 'roughdielectric', 'distribution': 'beckmann',
            'alpha': float(np.sqrt(2) * roughness)}


def _index(medium: Medium) -> float:
    return medium.index if isinstance(medium, Clear) else 1.0


def _matt(texture: Texture, side: float, coat: float, roughness: float, outside: float = 1.0
          ) -> dict[str, Any]:
    """A texture under a coat. outside: refractive index of what is before it."""
    seen = _bitmap(texture, side)
    if coat <= 1 or abs(coat - outside) < _ALL_DIFFERENT:
        return {'type': 'diffuse', 'reflectance': seen}
    coated: dict[str, Any] = {'type': 'plastic', 'int_ior': coat, 'ext_ior': outside,
                              'diffuse_reflectance': seen}
    if roughness > 0:
        coated |= {'type': 'roughplastic', 'distribution': 'beckmann',
                   'alpha': float(np.sqrt(2) * roughness)}
    return coated


def _bitmap(texture: Texture, side: float) -> dict[str, Any]:
    """The texture with places in metres; its first row is at v = 0, texel 0 about (0, 0)."""
    mi = mitsuba()
    if np.ptp(texture.reshape(-1, 3), axis=0).max() == 0:
        return {'type': 'rgb', 'value': texture[0, 0].tolist()}
    half = 0.5 / SIZE
    flipped = np.ascontiguousarray(texture[::-1], np.float32)
    data = mi.TensorXf(flipped)
    _taken_over()
    # Of a transform in two dimensions Mitsuba 3.7 loses the shift.
    onto = mi.ScalarTransform4f().translate([half, -half, 0]).scale([1 / side, -1 / side, 1])
    return {'type': 'bitmap', 'data': data, 'raw': True, 'wrap_mode': 'repeat',
            'filter_type': 'bilinear', 'to_uv': onto}


def _absorption(medium: Medium) -> tuple[float, float, float]:
    return medium.absorption if isinstance(medium, Clear) else (0.0, 0.0, 0.0)


def _absorbing(medium: Medium) -> dict[str, Any]:
    """A medium of Mitsuba's own integrators."""
    absorption = _absorption(medium)
    strongest = max(absorption)
    return {'type': 'homogeneous', 'albedo': 0.0, 'scale': strongest, 'sigma_t': {
        'type': 'rgb', 'value': [each / strongest for each in absorption]}}


def _mesh(vertices: NDArray[np.float64], normals: NDArray[np.float64], faces: NDArray[np.int64],
          places: NDArray[np.float64], material: dict[str, Any], front: Medium = AIR,
          back: Medium = AIR) -> Any:
    """A mesh between two media."""
    mi = mitsuba()
    properties = mi.Properties()
    properties['material'] = mi.load_dict(material)
    for name, medium in (('exterior', front), ('interior', back)):
        if max(_absorption(medium)) > 0:
            properties[name] = mi.load_dict(_absorbing(medium))
    mesh = mi.Mesh('mesh', len(vertices), len(faces), has_vertex_normals=True,
                   has_vertex_texcoords=True, props=properties)
    arrays = {'vertex_positions': vertices, 'vertex_normals': normals, 'vertex_texcoords': places,
              'faces': faces}
    given = {name: each.astype(np.uint32 if name == 'faces' else np.float32).ravel()
             for name, each in arrays.items()}
    values = mi.traverse(mesh)
    for name, array in given.items():
        values[name] = array
    values.update()
    absorptions = {name: np.tile(np.array(_absorption(medium), np.float32), len(vertices))
                   for name, medium in ((BEFORE, front), (BEHIND, back))}
    for name, array in absorptions.items():
        mesh.add_attribute(name, 3, array)
    _taken_over()
    return mesh


def _taken_over() -> None:
    """Wait until Dr.Jit has copied the arrays that it was given: it does so in other threads, and
    does not keep them alive.
    """
    import drjit
    drjit.sync_thread()


def _sheet(sheet: Sheet, name: str) -> Any:
    if sheet.opacity < 1 and sheet.roughness > 0:
        raise SimulationError(f'{name}: a film that scatters what comes through it is not among '
                              'what physically based pictures show; say roughness: 0')
    half = np.array(sheet.size) / 2
    places = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    vertices = places @ sheet.pose[:3, :2].T + sheet.pose[:3, 3]
    material: dict[str, Any] = {'type': 'twosided', 'inner': _matt(
        sheet.texture, sheet.side, sheet.coat, sheet.roughness)}
    if sheet.opacity < 1:
        material = {'type': 'mask', 'opacity': sheet.opacity, 'inner': material}
    return _mesh(vertices, np.tile(sheet.pose[:3, 2], (4, 1)),
                 np.array([[0, 1, 2], [0, 2, 3]]), places, material)


def _room(scene: Scene) -> dict[str, Any]:
    """The panorama as an environment map; its columns turn the other way there."""
    mi = mitsuba()
    turn = pose_of(scene.world_from_camera.T @ _WORLD_FROM_MAP, [0, 0, 0])
    return {'type': 'envmap', 'bitmap': mi.Bitmap(_resampled(scene.environment)),
            'to_world': mi.ScalarTransform4f(turn)}


# Directions of Mitsuba's map (y up) in the panorama's frame (z up).
_WORLD_FROM_MAP = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])


def _resampled(room: Environment) -> NDArray[np.float32]:
    """The panorama with its first and last row at the poles instead of half a row from them."""
    rows = len(room.panorama)
    at = np.clip(np.arange(rows) / (rows - 1) * rows - 0.5, 0, rows - 1)
    low = np.minimum(at.astype(int), rows - 2)
    part = (at - low)[:, None, None].astype(np.float32)
    return np.ascontiguousarray(
        (room.panorama[low] * (1 - part) + room.panorama[low + 1] * part)[:, ::-1])
