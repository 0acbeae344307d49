"""Draws a moving object before a moving camera, frame by frame."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.settings import Odd, Settings
from pmcl_ros.simulation.layers import Plane, TexturedMesh, composited, view_shifts
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_sensor
from pmcl_ros.simulation.scenes.sensor import Sensor, exposure, noisy, sensed
from pmcl_ros.simulation.scenes.shapes.vessels import outer_mesh, random_vessel
from pmcl_ros.simulation.scenes.textures import random_texture

Kind = Literal['opaque', 'translucent', 'film']
_WAVES = 3  # sines that the motion along an axis is the sum of
_FINE = 4000  # samples of a path at which its speed is computed
_LONG = 200.0  # rad: time over which the speed is computed
_SPAN = 6  # view steps of an F01 from side to side of its inner 7x7 views
_REACH = np.array([0.045, 0.035, 0.03])  # m: of the object's motion
_TURN = 0.25  # rad: likewise
_CAMERA_REACH, _CAMERA_TURN = np.array([0.02, 0.02, 0.02]), 0.03  # m, rad: of the camera's
_LARGEST = 0.11  # m: diameter of the object; larger ones are made smaller
_KINDS = ('stemmed', 'bottle', 'free')  # jars and bowls look much the same upside down
_FROM_SIDE = 0.7  # rad: least angle between the object's axis and the line of sight at rest
_RIM = 0.003  # m: width of the rim of a translucent object
_MARGIN = 0.02  # m: of the region of interest around the object's path
_BEGIN = 1_700_000_000_000_000_000  # ns


class SequenceSettings(Settings):
    """Parameters of `Sequence`."""

    kinds: tuple[Kind, ...] = Field(
        ('opaque', 'translucent', 'film'), min_length=1,
        description='kinds of objects, one of which is drawn: opaque; one that lets '
        'light through, with a rim; opaque behind a film that does')
    frames: int = Field(200, ge=1, le=100_000, description='length of the sequence [frames]')
    rate: float = Field(10.0, gt=0, le=1000, description='frames per second [Hz]')
    object_speed: float = Field(
        0.02, ge=0, le=0.1, description='largest motion of the object in its fixed frame from '
        'frame to frame [m]; 0: it rests')
    camera_speed: float = Field(
        0.004, ge=0, le=0.1, description='largest motion of the camera from frame to frame [m]; '
        '0: it rests')
    occluded: int = Field(10, ge=0, le=1000, description='frames, in the middle, in which a card '
                          'before the camera hides all [frames]')
    views: Odd = Field(3, ge=3, le=9, description='side of the square of views, odd [views]; they '
                       'span what the inner 7x7 of an F01 do')
    size: int = Field(256, ge=32, le=2000, description='side of a view [px]')
    field: float = Field(0.36, gt=0.1, le=1.5,
                         description="field of view: the image's side over the focal length [1]")
    distance: float = Field(0.6, ge=0.3, le=5,
                            description='mean distance of the object from the camera [m]')
    noise: float = Field(1.0, ge=0, le=20, description='noise: standard deviation in units of '
                         'that of an F01 at ISO 80 in a lit room; 0: none')

    @model_validator(mode='after')
    def _seen_at_all(self) -> 'SequenceSettings':
        if self.occluded and self.occluded + 2 > self.frames:
            raise ValueError(f'{self.occluded} hidden frames leave none before and after them of '
                             f'{self.frames}: set occluded to {max(self.frames - 2, 0)} at most')
        return self


def wander(rng: np.random.Generator, frames: int, reach: NDArray[np.float64], turn: float,
           speed: float) -> NDArray[np.float64]:
    """(frames, 4, 4) poses near the identity: sums of sines along and about x, y, z.

    reach: (3,) largest displacement of the origin [m]. turn: largest rotation about each axis
    [rad]. speed: largest step of the origin from frame to frame [m]; 0: at rest.
    """
    rates = rng.uniform(0.6, 1.7, (6, _WAVES))
    phases = rng.uniform(0, 2 * np.pi, (6, _WAVES))
    sizes = rng.dirichlet(np.full(_WAVES, 3.0), 6) * np.append(reach, np.full(3, turn))[:, None]
    if speed == 0:
        return np.tile(np.eye(4), (frames, 1, 1))
    fine = np.linspace(0, _LONG, _FINE)[:, None, None]
    slopes = (sizes * rates * np.cos(rates * fine + phases)).sum(axis=2)
    step = speed / np.linalg.norm(slopes[:, :3], axis=1).max()
    time = step * np.arange(frames)[:, None, None]
    way = (sizes * np.sin(rates * time + phases)).sum(axis=2)
    return pose_of(Rotation.from_rotvec(way[:, 3:]), way[:, :3])


@dataclass(frozen=True)
class Frame:
    """One frame and its truth.

    pose: (4, 4), object to camera [m]. camera: (4, 4), camera to the fixed frame. occluded: a card
    hides everything.
    """

    light_field: LightField
    pose: NDArray[np.float64]
    camera: NDArray[np.float64]
    occluded: bool


class Sequence:
    """A random sequence of a seed. Frames can be drawn in any order, always with the same digits.

    model: of the object. cameras: (frames, 4, 4), camera to fixed frame. poses: (frames, 4, 4),
    object to camera. roi_center, roi_size: a box that holds the object's origin in all frames [m].
    hidden: frames in which a card hides everything. kind: of `SequenceSettings.kinds`.
    """

    def __init__(self, seed: int, settings: SequenceSettings | None = None) -> None:
        self.seed, self.settings = seed, settings or SequenceSettings()
        of = self.settings
        rng = np.random.default_rng([23, seed])
        self.kind = of.kinds[seed % len(of.kinds)]
        self.sensor = _sensor(rng, of)
        self.model = _vessel(rng)
        rest = pose_of(_attitude(rng), np.array([0, 0, of.distance]))
        moves = wander(rng, of.frames, _REACH, _TURN, of.object_speed)
        world = np.tile(rest, (of.frames, 1, 1))
        world[:, :3, :3] = moves[:, :3, :3] @ rest[:3, :3]
        world[:, :3, 3] += moves[:, :3, 3]
        self.cameras = wander(rng, of.frames, _CAMERA_REACH, _CAMERA_TURN, of.camera_speed)
        self.poses = np.linalg.inv(self.cameras) @ world
        low, high = self.poses[:, :3, 3].min(axis=0), self.poses[:, :3, 3].max(axis=0)
        x, y, z = (float(each) for each in (low + high) / 2)
        across, down, deep = (float(each) for each in high - low + 2 * _MARGIN)
        self.roi_center, self.roi_size = (x, y, z), (across, down, deep)
        first = (of.frames - of.occluded) // 2
        self.hidden = range(first, first + of.occluded)
        self._lay(rng)
        self._gain = exposure(self._light(0, False)[self.sensor.grid.centre], self.sensor.level)

    def __len__(self) -> int:
        return self.settings.frames

    def __iter__(self) -> Iterator[Frame]:
        return (self.frame(number) for number in range(len(self)))

    def header(self, number: int) -> Header:
        """Stamp and frame id of a frame."""
        return Header(_BEGIN + round(1e9 * number / self.settings.rate))

    def frame(self, number: int) -> Frame:
        """Draw a frame."""
        sensor, rng = self.sensor, np.random.default_rng([29, self.seed, number])
        hidden = number in self.hidden
        light = self._light(number, hidden)
        views = np.zeros_like(light)
        for at in np.ndindex(sensor.grid.shape):
            view = sensed(light[at], self._gain, sensor.blur, 0)
            views[at] = noisy(view, float(sensor.grid.weights[at]), sensor, rng)
        return Frame(LightField(self.header(number), views, sensor.grid), self.poses[number],
                     self.cameras[number], hidden)

    def _lay(self, rng: np.random.Generator) -> None:
        """Draw the layers: a wall, cards before it, the object, a film, the occluding card."""
        of = self.settings
        pixel = of.field / of.size  # of a plane one metre away [m]

        def plane(depth: float, size: tuple[float, float] | None, side: float, tilt: float,
                  opacity: float = 1.0, kinds: tuple[str, ...] = ()) -> Plane:
            place = np.append(rng.uniform(-0.5, 0.5, 2) * depth * of.field, depth)
            turn = Rotation.from_rotvec(np.append(rng.normal(0, tilt, 2), rng.uniform(0, 7)))
            return Plane.from_texture(pose_of(turn, place), random_texture(rng, kinds), side,
                                      pixel * depth, size, opacity)

        far = of.distance + 0.2
        planes = [plane(rng.uniform(far + 0.2, far + 0.7), None, rng.uniform(0.3, 0.8), 0.3)]
        for _ in range(int(rng.integers(2, 7))):
            width, height = rng.uniform(0.04, 0.2, 2)
            planes.append(plane(rng.uniform(far, far + 0.2), (width, height),
                                rng.uniform(0.15, 0.5), 0.2))
        self._behind = planes
        clear = self.kind == 'translucent'
        texture = random_texture(rng)
        if clear:  # its rim shows dark or bright parts of the room
            texture = np.clip(0.2 * texture + rng.choice([0.0, 0.8]), 0, 1, dtype=np.float32)
        self._solid = TexturedMesh(
            self.model, texture, side=float(rng.uniform(0.1, 0.2)),
            opacity=float(rng.uniform(0.35, 0.6)) if clear else 1.0,
            rim=float(rng.uniform(0.7, 0.95)) if clear else 1.0, width=_RIM,
            light=np.array([0.5, -0.7, -0.5]))
        depth = max(0.15, of.distance - 0.2)
        self._film = plane(depth, None, rng.uniform(0.15, 0.4), 0.1, rng.uniform(0.12, 0.3),
                           ('panes', 'clouds', 'lettering')) if self.kind == 'film' else None
        self._card = plane(max(0.1, of.distance - 0.3), None, rng.uniform(0.2, 0.5), 0.1,
                           kinds=('clouds', 'lettering', 'checks'))

    def _light(self, number: int, hidden: bool) -> NDArray[np.float32]:
        """(rows, columns, height, width, 3) noise-free light of all views of a frame."""
        grid = self.sensor.grid
        fixed_to_camera = np.linalg.inv(self.cameras[number])
        seen, window = self._solid.drawn(grid, self.poses[number],
                                         fixed_to_camera[:3, :3] @ self._solid.light)
        across = slice(window.left, window.left + window.size[0])
        down = slice(window.top, window.top + window.size[1])
        pictures = []
        for shift, solid in zip(view_shifts(grid), seen, strict=True):
            view = fixed_to_camera.copy()
            view[:3, 3] -= shift
            if hidden:
                pictures.append(self._card.drawn(grid.pinhole, view)[..., :3])
                continue
            picture = self._behind[0].drawn(grid.pinhole, view)[..., :3]
            for each in self._behind[1:]:
                picture = composited(picture, each.drawn(grid.pinhole, view))
            picture[down, across] = composited(picture[down, across], solid)
            if self._film is not None:
                picture = composited(picture, self._film.drawn(grid.pinhole, view))
            pictures.append(picture)
        return np.stack(pictures).reshape(*grid.shape, grid.pinhole.height, grid.pinhole.width, 3)


def _sensor(rng: np.random.Generator, of: SequenceSettings) -> Sensor:
    """An F01 with fewer views that span the same aperture."""
    sensor = random_sensor(rng, SceneSettings(views=of.views, size=of.size, field=of.field,
                                              noise=of.noise))
    spacing = _SPAN / (of.views - 1)
    return replace(sensor, grid=replace(sensor.grid, baseline=spacing * sensor.grid.baseline))


def _vessel(rng: np.random.Generator) -> ObjectModel:
    vessel = random_vessel(rng, _KINDS)
    vertices, faces = outer_mesh(vessel.closed)
    size = 2 * np.linalg.norm(vertices, axis=1).max()
    return ObjectModel(vessel.kind, vertices * min(1.0, _LARGEST / size), faces,
                       np.array([0, 0, 1.0]), True)


def _attitude(rng: np.random.Generator) -> Rotation:
    """Any attitude seen from the side: along its axis every vessel looks the same."""
    lean, turn, spin = rng.uniform([_FROM_SIDE, 0, 0], [np.pi - _FROM_SIDE, 7, 7])
    return Rotation.from_euler('zyz', [turn, lean, spin])
