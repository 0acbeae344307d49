"""What `pmcl simulate` and `pmcl feasibility` have in common: object, camera, scenes, renderer."""

import hashlib
import json
import math
import pickle
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import click
import numpy as np

from pmcl_ros import __version__
from pmcl_ros.cli.base import OBJECT, counter, with_options
from pmcl_ros.evaluation.feasibility.findings import Aim
from pmcl_ros.lightfield.posed_view import LEAST_SIDE
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.outputs import write_file
from pmcl_ros.runtime.text_file import read_json
from pmcl_ros.simulation.camera_plan import CameraPlan
from pmcl_ros.simulation.described.object_description import load_object
from pmcl_ros.simulation.described.ring_sheet import RingSheet
from pmcl_ros.simulation.described.surroundings import (
    SURROUNDINGS,
    WITH_RING,
    DescribedSettings,
    Surroundings,
    described_scene,
)
from pmcl_ros.simulation.described.wet_places import tank_distance
from pmcl_ros.simulation.lytro.camera import F01, F01_RAW, LytroCamera
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera
from pmcl_ros.simulation.path_tracing.render import physical, physical_along, prepare
from pmcl_ros.simulation.processes import run_all
from pmcl_ros.simulation.scenes.objects import SceneObject
from pmcl_ros.simulation.scenes.random_scene import random_sensor
from pmcl_ros.simulation.scenes.rays import RayRenderer, fast_along
from pmcl_ros.simulation.scenes.render import Renderer, fast
from pmcl_ros.simulation.scenes.scene import Scene
from pmcl_ros.simulation.scenes.sensor import Sensor
from pmcl_ros.simulation.simulated_captures import NOTE, Simulation, is_there, place_of
from pmcl_ros.simulation.warm_up import FIRST_SURFACES, RAW_PICTURES, RENDER
from pmcl_ros.warm_up.stage import Stages

_REST = 'all that is simulated'  # its digest: what has no name in the note
RENDERERS: dict[str, tuple[Renderer, int]] = {'fast': (fast, 8), 'physical': (physical, 48)}
# Samples are of a raw pixel: one view's pixel gathers those of some ten.
_ALONG: dict[str, tuple[RayRenderer, int]] = {
    'fast': (fast_along, 4), 'physical': (physical_along, 16)}
RAW_CAMERA = LytroCamera()  # of --camera f01-raw
Result = TypeVar('Result')
_REGION = re.compile(r'(\d*\.?\d+):(\d*\.?\d+)(?::(\d*\.?\d+))?')
_CLEARANCE = 0.02  # m: between an object and the camera, at least

_OPTIONS = (
    click.argument('object_file', metavar='OBJECT', type=OBJECT),
    click.option('--camera', required=True, metavar='FILE', help='An ordinary camera, YAML, as '
                 f'for `pmcl scenes render`; or {F01}: light fields of a camera like it; or '
                 f'{F01_RAW}: its raw pictures.'),
    click.option('--region', default='0.35:0.7', show_default=True, metavar='NEAR:FAR[:SIDE]',
                 help='Distances of the object from the camera, and side of the box that is the '
                 'region of interest (default 0.16) [m].'),
    click.option('--surroundings', multiple=True, type=click.Choice(SURROUNDINGS),
                 default=('table', 'clutter'), show_default=True, help='Where the object is; may '
                 'be repeated: scenes take turns.'),
    click.option('--attitude', type=click.Choice(['any', 'upright', 'lying']), default='any',
                 show_default=True, help=DescribedSettings.model_fields['attitude'].description),
    click.option('--renderer', type=click.Choice(list(RENDERERS)), default='physical',
                 show_default=True, help="physical: path tracing, extra 'simulate'; fast: the "
                 "package's own renderer."),
    click.option('--samples', type=click.IntRange(1), show_default=', '.join(
        f'{name} {samples}' for name, (_, samples) in RENDERERS.items())
        + '; of a raw pixel ' + ', '.join(
            f'{name} {samples}' for name, (_, samples) in _ALONG.items()),
        help='Rays or paths per pixel: four times as many halve the noise.'),
    click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
                 help='Scene k is that of seed + k.'),
    click.option('--force', is_flag=True, help='Make everything again, and overwrite files, '
                 'whoever wrote them.'))


_AIM_OPTIONS = (
    click.option('--within', 'millimetres', type=click.FloatRange(0, min_open=True),
                 default=Aim().mm, show_default=True,
                 help='Largest error that is good enough [mm].'),
    click.option('--degrees', type=click.FloatRange(0, min_open=True), default=Aim().degrees,
                 show_default=True, help='Largest error of the attitude that is good enough.'))


def simulation_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options; `Simulated.from_options` takes their values."""
    return with_options(_OPTIONS, command)


def aim_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of the errors that are good enough, of an `Aim`."""
    return with_options(_AIM_OPTIONS, command)


@dataclass(frozen=True)
class Draw:
    """Draws the scene of a seed (`Simulation.draw`)."""

    item: SceneObject
    surroundings: tuple[Surroundings, ...]
    settings: DescribedSettings
    ring: RingSheet | None = None

    def __call__(self, seed: int, rng: np.random.Generator, sensor: Sensor | None) -> Scene:
        """As `Simulation.draw`."""
        return described_scene(rng, self.item, self.surroundings[seed % len(self.surroundings)],
                               sensor or random_sensor(rng, self.settings), self.settings,
                               self.ring)


@dataclass(frozen=True)
class Simulated:
    """The chosen simulation. about: names and values for people."""

    simulation: Simulation
    about: dict[str, str]

    @property
    def digest(self) -> str:
        """Of object, camera, plan and settings: other values, another digest."""
        of = self.simulation
        assert isinstance(of.draw, Draw)
        # As text: a pickle of settings differs from process to process.
        settings = [each.model_dump_json()
                    for each in (of.draw.settings, of.camera, of.plan, of.draw.item.appearance)
                    if each is not None]
        item = replace(of.draw.item, appearance=None)
        ring = () if of.draw.ring is None else (of.draw.ring.options,)
        values = (item, of.draw.surroundings, settings, of.samples, __version__, *ring)
        return hashlib.sha256(pickle.dumps(values)).hexdigest()[:16]

    @property
    def stages(self) -> Stages:
        """The kernels of its pictures: of path-traced ones, those of what goes with them."""
        of = self.simulation
        if isinstance(of.camera, LytroCamera):
            return RAW_PICTURES  # of the white image, whatever renders the scenes
        if of.renderer is fast:
            return RENDER
        return FIRST_SURFACES if of.camera is None else ()

    @classmethod
    def from_options(cls, plan: str | None, object_file: Path, camera: str, region: str,
                     surroundings: tuple[Surroundings, ...], attitude: str, renderer: str,
                     samples: int | None, seed: int, ring: RingSheet | None = None
                     ) -> 'Simulated':
        """Raises SettingsError, ObjectModelError and SimulationError for what is impossible."""
        limits = _REGION.fullmatch(region)
        if not limits:
            raise SettingsError(f'--region {region}: expected NEAR:FAR or NEAR:FAR:SIDE in '
                                'metres, as 0.35:0.7:0.16')
        near, far, side = limits.groups()
        if float(near) > float(far):
            raise SettingsError(f'--region {region}: NEAR is beyond FAR')
        values: dict[str, Any] = {'near': near, 'far': far, 'attitude': attitude, 'empty': 0}
        if side:
            values['roi'] = side
        draws, usual = RENDERERS[renderer]
        along, usual_raw = _ALONG[renderer]
        seen_by: OrdinaryCamera | LytroCamera | None = None
        pictures = 'light fields'
        if camera in (F01, F01_RAW):
            values |= {'views': 9}
            if plan is not None:
                raise SettingsError(f'--cameras {plan}: several poses are of an ordinary camera')
            if camera == F01_RAW:
                seen_by, usual, pictures = RAW_CAMERA, usual_raw, 'raw pictures'
                values |= {'field': seen_by.field}
        else:
            if not Path(camera).is_file():
                raise SettingsError(f'--camera {camera}: there is no such file; a YAML with '
                                    f'width, height, fx, cx, cy, or {F01} or {F01_RAW}')
            seen_by = OrdinaryCamera.load(Path(camera))
            if min(seen_by.width, seen_by.height) < LEAST_SIDE:
                raise SettingsError(f'--camera {camera}: its pictures have {seen_by.width}x'
                                    f'{seen_by.height} px; {LEAST_SIDE} a side are needed')
            values |= {'field': min(seen_by.field, 1.5)}
            pictures = f'{seen_by.width} x {seen_by.height} px, {plan or "one picture"}'
        settings = DescribedSettings.make(values, '--region')
        if ring is not None:
            _check_ring(ring, plan, surroundings, side)
        draw = Draw(load_object(object_file), surroundings, settings, ring)
        if ring is not None:
            ring.check_holds(draw.item, attitude)
        _check_size(draw, region)
        simulation = Simulation(draw, seen_by, None if plan is None else CameraPlan.parse(plan),
                                draws, samples or usual, along)
        about = {} if ring is None else {'ring': ring.options}
        return cls(simulation, about | {
            'object': object_file.name, 'camera': f'{Path(camera).name}: {pictures}',
            'distance': f'{float(near):g} to {float(far):g} m',
            'surroundings': ', '.join(surroundings),
            'attitude': attitude, 'renderer': f'{renderer}, {simulation.samples} samples a pixel',
            'seeds': f'from {seed}'})

    def to_make(self, seeds: Sequence[int], folder: Path, force: bool) -> list[int]:
        """The seeds whose scenes a folder lacks; with `force` all. Loads the renderer for them.

        Raises SimulationError where that does not run here.
        """
        left = [seed for seed in seeds if force or not is_there(place_of(seed, folder))]
        if left and self.simulation.renderer is physical:
            prepare(along=isinstance(self.simulation.camera, LytroCamera))
        return left

    def claim(self, folder: Path, seed: int) -> None:
        """Make a folder for scenes, and note what they are of.

        The first is drawn before: what cannot be drawn claims no folder. Raises SettingsError
        where it holds scenes of something else, and as `Simulation.draw`.
        """
        self._first_scene(seed)
        folder.mkdir(parents=True, exist_ok=True)
        note, mine = folder / NOTE, {
            name: value for name, value in self.about.items() if name != 'seeds'}
        mine[_REST] = self.digest
        if not note.exists():
            if any(folder.glob('*/truth.json')):
                raise SettingsError(f'{folder} has scenes of something else than pmcl simulate: '
                                    'choose another --out')
            write_file(note, json.dumps(mine, indent=1) + '\n')
            return
        others = read_json(note)
        for name, value in mine.items():
            if others.get(name) != value:
                differs = (f'{name} {others.get(name)}, not {value}' if name != _REST
                           else 'object, camera or settings have changed since')
                raise SettingsError(f'{folder} has scenes of another simulation: {differs}; '
                                    'choose another --out')

    def _first_scene(self, seed: int) -> Scene:
        of, rng = self.simulation, np.random.default_rng(seed)
        return of.draw(seed, rng, None if of.camera is None else of.camera.sensor(rng))


def _check_ring(ring: RingSheet, plan: str | None, surroundings: tuple[Surroundings, ...],
                side: str | None) -> None:
    """Raise SettingsError for what does not go with a ring."""
    if plan is None:
        raise SettingsError(f'{ring.options}: it tells the poses of several pictures; add '
                            '--cameras arc:3:50')
    if others := sorted({*surroundings} - {*WITH_RING}):
        raise SettingsError(f'--surroundings {", ".join(others)}: a ring lies on a table; choose '
                            f'{" or ".join(WITH_RING)}')
    if side is not None:
        raise SettingsError(f'--region with a side of {side} m: the region of interest is the '
                            'middle of the ring; leave the side out')


def _check_size(draw: Draw, region: str) -> None:
    """Raise SettingsError where the camera could be in the object, or in its tank."""
    size = float(np.linalg.norm(np.ptp(draw.item.vertices, axis=0)))
    least = size / 2 + _CLEARANCE
    if 'tank' in draw.surroundings:
        least = max(least, tank_distance(size / 2))
    if draw.settings.near < least:
        raise SettingsError(
            f'--region {region}: the object is {size:.2g} m across, and its middle may be '
            f'{draw.settings.near:g} m from the camera: check scale in its YAML file, or set NEAR '
            f'to {math.ceil(100 * least) / 100:.2f} or more')


def shown(name: str, count: int, work: Callable[[Callable[[float], None]], Iterable[Result]]
          ) -> Iterator[Result]:
    """The results of work, while a bar shows how many of `count` there are.

    work: takes a function that it may call with the share done of the next result.
    """
    with counter() as bar:
        task, done = bar.add_task(name, total=count), 0

        def show(part: float) -> None:
            bar.update(task, completed=done + part)

        for each in work(show):
            done += 1
            show(0)
            yield each


def processed(name: str, function: Callable[..., Result], values: Sequence[Any], jobs: int = 1,
              backend: str = 'loky', scheduler: str | None = None) -> Iterator[Result]:
    """As `run_all`, `shown`. The function takes `progress` too, which other processes leave."""
    def work(progress: Callable[[float], None]) -> Iterator[Result]:
        here = jobs == 1 and backend == 'loky'
        return run_all(partial(function, progress=progress) if here else function, values, jobs,
                       backend, scheduler)
    return shown(name, len(values), work)


def minutes(seconds: float) -> str:
    """A time in words."""
    return f'{seconds:.0f} s' if seconds < 90 else f'{seconds / 60:.0f} min'


