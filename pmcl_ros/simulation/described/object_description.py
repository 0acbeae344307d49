"""From an object's YAML file to the object of scenes: its walls, its content, its material."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from pmcl_ros.geometry.moved_surface import Surface
from pmcl_ros.geometry.revolution_axis import ANGLES
from pmcl_ros.geometry.se3 import least_turn, pose_of, rotations_about
from pmcl_ros.pmcl.appearance import Appearance
from pmcl_ros.pmcl.object_model import ObjectModel, ObjectSettings, mesh_file
from pmcl_ros.runtime.errors import ObjectModelError, told_as
from pmcl_ros.runtime.mesh_file import read_mesh
from pmcl_ros.runtime.mesh_repair import is_apart
from pmcl_ros.runtime.settings import read_yaml
from pmcl_ros.simulation.described import offsets, profiles
from pmcl_ros.simulation.described.substances import liquid_of, medium_of
from pmcl_ros.simulation.scenes.materials import AIR, Medium
from pmcl_ros.simulation.scenes.objects import SceneObject
from pmcl_ros.simulation.scenes.scene import Solid
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles

_BODY, _LIQUID, _GAS = 1, 2, 3  # media of a described object; 0 is what is around it
_RIM = 0.001  # m: by which the mouth may miss the top of a surface of revolution
_FILLED = 0.05  # share of the outline's volume that a massive mesh may lack
_PLANE = 1e-6  # m
_BALL = 2  # Euler's number of a closed surface without a hole
_TURNS = rotations_about(np.array([0, 0, 1.0]), np.array(ANGLES))
_ROUND = 0.1  # share of its largest radius by which these may move a surface of revolution


def load_object(path: Path | str) -> SceneObject:
    """The object that a YAML file describes (`ObjectSettings` with `appearance`).

    Media: 1 its material, 2 the liquid in it, 3 the gas in a closed hollow. A surface of
    revolution that stands on its axis becomes `Frusta`, anything else `Triangles`. Raises
    ObjectModelError where the description does not say enough or something impossible, in one line
    with what to write; SettingsError as `ObjectModel.load`; SimulationError where a library is
    missing.
    """
    path = Path(path)
    described = _Description.load(path)
    with told_as(ObjectModelError, name=path):
        return described.made()


@dataclass(frozen=True)
class _Description:
    """model: in the mesh's frame. turn: (3, 3), mesh to a frame whose z is up."""

    path: Path
    appearance: Appearance
    model: ObjectModel
    turn: NDArray[np.float64]

    @classmethod
    def load(cls, path: Path) -> '_Description':
        model = ObjectModel.load(path)
        described = path.suffix.lower() in ('.yaml', '.yml')
        settings = ObjectSettings.make(read_yaml(path), str(path)) if described else None
        appearance = settings.appearance if settings else None
        if appearance is None:
            where = 'in it' if described else f'a YAML file with mesh: {path.name} and'
            raise ObjectModelError(
                f'{path} does not say what the object is made of: write {where} '
                f'appearance: {{material: glass, wall: 0.0025, '
                f'{_mouth(model.vertices[:, 2].max())}}}')
        return cls(path, appearance, model, _upright(model.up))

    def made(self) -> SceneObject:
        look, model = self.appearance, self.model
        is_hollow = look.wall is not None or look.inner is not None
        if look.material != 'opaque' and not is_hollow and not look.solid:
            raise ObjectModelError("how thick it is, is not given: write in appearance 'wall: "
                                   "0.0025' [m], 'inner: inner.stl' (mesh of the inner surface) "
                                   "or 'solid: true'")
        vertices = model.vertices @ self.turn.T
        top = float(vertices[:, 2].max())
        if is_hollow and look.mouth is None:
            raise ObjectModelError(f"where its mouth is, is not given: write in appearance "
                                   f"'{_mouth(top)}', or 'mouth: {{open: false}}' where it is "
                                   'closed')
        if is_hollow and look.floor is not None and not look.floor < top:
            raise ObjectModelError(f'its floor is {look.floor:g} m high, the object ends at '
                                   f'{top:.4g} m: give it in metres, below the mouth')
        axis = model.axis
        if axis is not None and abs(self.turn[2] @ axis) > 1 - 1e-9:
            surfaces = self._revolved(vertices, top, is_hollow)
        else:
            surfaces = self._meshed(vertices, is_hollow)
        pose = pose_of(self.turn.T, [0, 0, 0])
        media = self._media()
        solids = tuple(Solid(each, media, pose) for each in surfaces)
        return SceneObject(f'{look.material} {model.name}', solids, model.vertices, model.faces,
                           axis, 'upright' if look.liquid else '', self.turn[2], model.discrete,
                           look)

    def _media(self) -> tuple[Medium, ...]:
        look = self.appearance
        liquid = liquid_of(look.liquid) if look.liquid else AIR
        return medium_of(look, self.path.parent), liquid, AIR

    def _revolved(self, vertices: NDArray[np.float64], top: float, is_hollow: bool
                  ) -> list[Frusta | Triangles]:
        look, mouth = self.appearance, self.appearance.mouth
        outer = profiles.outline(vertices, self.model.faces)
        mesh = trimesh.Trimesh(vertices, self.model.faces, process=False)
        if self.model.closed and mesh.euler_number < _BALL:
            return self._meshed(vertices, is_hollow)  # a ring, which its outline would fill
        off = Surface.from_mesh(mesh).moved_by(_TURNS)
        if self.model.closed and off > _ROUND * outer[:, 0].max():
            try:
                return self._meshed(vertices, is_hollow)  # it has a handle, say
            except ObjectModelError as error:
                raise ObjectModelError(f'turned about its axis it is {1e3 * off:.1f} mm off '
                                       f'itself, so its mesh is taken as it is: {error}') from None
        if not is_hollow:
            self._check_closed()
            if mesh.volume < (1 - _FILLED) * profiles.volume(outer):
                return self._meshed(vertices, is_hollow)  # its mesh has a cavity of its own
            return [Frusta.from_profile(profiles.eased(outer), 0, _BODY)]
        is_open = mouth is not None and mouth.open
        if is_open and mouth is not None and mouth.z is not None and abs(mouth.z - top) > _RIM:
            raise ObjectModelError(f'its mouth at {mouth.z:g} m is not at the top of the mesh: '
                                   f"write '{_mouth(top)}'")
        if look.inner is None:
            vessel = profiles.hollowed(outer, look.wall or 0, is_open, look.floor)
        else:
            inner = self._inner()
            vessel = profiles.fitted(outer, profiles.outline(
                np.asarray(inner.vertices), np.asarray(inner.faces)), is_open, look.floor)
        level = look.liquid.level if look.liquid else None
        # A liquid that leaves a punt dry in the middle would need a surface like a ring.
        r, z = vessel.inner.T
        self._check_level(level, float(z[r <= r.min()].min()), float(z.max()))
        return [vessel.surface(level, _GAS)]

    def _meshed(self, vertices: NDArray[np.float64], is_hollow: bool
                ) -> list[Frusta | Triangles]:
        look = self.appearance
        self._check_closed()
        outer = offsets.united(trimesh.Trimesh(vertices, self.model.faces, process=False))
        if not is_hollow:
            return [Triangles(np.array(outer.triangles), 0, _BODY)]
        is_open = look.mouth is not None and look.mouth.open
        mouth = look.mouth.z if look.mouth is not None and is_open else None
        cavity = (offsets.lifted(self._inner(), mouth) if look.inner
                  else offsets.cavity_of(outer, look.wall or 0, mouth))
        low, high = cavity.bounds[:, 2].tolist()
        if look.floor is not None:
            if not look.floor < high:
                raise ObjectModelError(f'its floor is {look.floor:g} m high, its cavity ends at '
                                       f'{high:.4g} m')
            cavity, low = offsets.above(cavity, look.floor), max(low, look.floor)
        level = look.liquid.level if look.liquid else None
        self._check_level(level, low, high if mouth is None else min(high, mouth))
        body = offsets.without(outer, cavity, mouth)
        if level is None:
            if is_open:
                return [Triangles(np.array(body.triangles), 0, _BODY)]
            return [Triangles(np.array(outer.triangles), 0, _BODY),
                    Triangles(np.array(cavity.triangles), _BODY, _GAS)]
        dry, wet = offsets.above(cavity, level), offsets.below(cavity, level)
        _, sides = _split(wet, level)
        if is_open:
            surface, walls = _split(offsets.without(outer, dry, mouth), level)
            return [Triangles(walls, 0, _BODY), Triangles(sides, _BODY, _LIQUID),
                    Triangles(surface, 0, _LIQUID)]
        surface, walls = _split(dry, level)
        return [Triangles(np.array(outer.triangles), 0, _BODY),
                Triangles(walls, _BODY, _GAS), Triangles(sides, _BODY, _LIQUID),
                Triangles(surface, _LIQUID, _GAS)]

    def _check_closed(self) -> None:
        if not self.model.closed:
            raise _not_closed('its mesh', trimesh.Trimesh(self.model.vertices, self.model.faces,
                                                          process=False))

    def _inner(self) -> trimesh.Trimesh:
        """The mesh of the cavity, its z up."""
        inner = read_mesh(self.path.parent / (self.appearance.inner or ''))
        if not inner.is_volume:
            raise _not_closed(str(self.appearance.inner), inner)
        vertices = mesh_file(self.path)[1] * np.asarray(inner.vertices) @ self.turn.T
        return trimesh.Trimesh(vertices, inner.faces, process=False)

    def _check_level(self, level: float | None, low: float, high: float) -> None:
        if level is not None and not low < level < high:
            raise ObjectModelError(f'its liquid reaches to {level:g} m, its cavity from {low:.4g} '
                                   f'to {high:.4g} m: give a level between them')


def _split(mesh: trimesh.Trimesh, level: float
           ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Triangles (n, 3, 3) of a mesh in the plane z = level, and the others."""
    corners = np.array(mesh.triangles)
    at = (np.abs(corners[:, :, 2] - level) < _PLANE).all(axis=1)
    return corners[at], corners[~at]


def _not_closed(what: str, mesh: trimesh.Trimesh) -> ObjectModelError:
    if mesh.is_watertight:
        return ObjectModelError(f'{what} has no inside: its faces cannot all look outwards; '
                                'remesh it')
    if is_apart(mesh):
        return ObjectModelError(f'{what} is not closed, its faces share no corners: merge close '
                                'vertices')
    return ObjectModelError(f'{what} is not closed: fill its holes, with a lid at the mouth')


def _mouth(top: float) -> str:
    """The line to write for a mouth at a height [m]."""
    return f'mouth: {{z: {round(top, 6) + 0:.4g}, open: true}}'


def _upright(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) turns the direction (3,) that is up to z."""
    if up[2] > 1 - 1e-12:
        return np.eye(3)
    if up[2] < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    return np.asarray(least_turn(up, np.array([0, 0, 1.0])).as_matrix())
