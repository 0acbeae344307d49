"""Draws pictures with the labels that a contour map learns from, many at once, onto disk."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.colour import Colour
from pmcl_ros.lightfield.posed_view import GAMMA
from pmcl_ros.runtime.errors import FileError, PmclError
from pmcl_ros.runtime.npz_file import read_arrays
from pmcl_ros.runtime.outputs import replacing
from pmcl_ros.runtime.settings import Settings
from pmcl_ros.simulation.occluding import DIRECTIONS, contour_labels
from pmcl_ros.simulation.path_tracing.render import physical, prepare
from pmcl_ros.simulation.photograph import MARGIN, photograph
from pmcl_ros.simulation.processes import run_all
from pmcl_ros.simulation.scenes.broad_scene import broad_scene
from pmcl_ros.simulation.scenes.random_scene import Kind, SceneSettings, random_sensor
from pmcl_ros.simulation.scenes.render import light_of_view
from pmcl_ros.simulation.scenes.scene import Scene
from pmcl_ros.simulation.scenes.sensor import Sensor, exposure, noisy, one_view, sensed
from pmcl_ros.simulation.scenes.world import World

_MOST_BYTES = 2 ** 28  # of a picture and its labels
_SIZE = 0.12  # m: of an object, for its apparent size
_APPARENT = 40, 400  # px
_DISTANCES = 0.2, 2.5  # m
_AIMED = 0.8  # share of crops that hold the middle of an object
_KINDS: tuple[Kind, ...] = (
    'glass', 'glass', 'glass', 'glass', 'opaque', 'glass handle', 'glass handle', 'opaque handle',
    'glass block', 'glass block', 'opaque block', 'glass film', 'glass film', 'opaque film',
    'glass block film', 'glass handle film')


class PictureSettings(Settings):
    """Parameters of `labelled_picture`."""

    f01: float = Field(0.4, ge=0, le=1, description='share of pictures by a light-field camera: '
                       'its centre view, the noise averaged over 1 to 40 views; others are by '
                       'ordinary cameras')
    largest: int = Field(288, ge=32, le=2000, description='side of the square whose number of '
                         'pixels no picture exceeds; larger pictures are cropped [px]')
    renderer: Literal['fast', 'physical'] = Field(
        'fast', description="fast: the package's own; physical: path tracing (extra 'simulate'), "
        'without films')
    film: bool = Field(True, description='some scenes have a film before the object; only by the '
                       'renderer fast')
    samples: int = Field(2, ge=1, le=64, description='rays per pixel of the own renderer')
    paths: int = Field(48, ge=1, le=4096, description='paths per pixel of path tracing')
    clutter: int = Field(7, ge=0, le=20, description='other objects at most')
    empty: float = Field(0.08, ge=0, le=1, description='share of scenes without their object')


@dataclass(frozen=True)
class LabelledPicture:
    """A picture and what a contour map is to say of it.

    picture: (height, width, 3) uint8 RGB, gamma encoded as a camera gives it; of a grey camera
        three equal channels. direction (int8), inside (bool): as in `ContourLabels`.
    """

    picture: NDArray[np.uint8]
    direction: NDArray[np.int8]
    inside: NDArray[np.bool_]


def labelled_picture(seed: int, settings: PictureSettings | None = None) -> LabelledPicture:
    """Draw a scene, a camera and its picture. The same seed gives the same bytes.

    Raises SimulationError where path tracing is asked for and Mitsuba is missing.
    """
    of = settings or PictureSettings()
    rng = np.random.default_rng(seed)
    is_f01 = bool(rng.random() < of.f01)
    is_physical = of.renderer == 'physical'
    film = of.film and not is_physical
    kinds = tuple(each for each in _KINDS if film or 'film' not in each)
    scenes = SceneSettings(kinds=kinds, views=3, clutter=of.clutter, empty=of.empty,
                           outside=0.4)
    sensor = random_sensor(rng, scenes) if is_f01 else _ordinary(rng)
    whole = sensor.grid.pinhole
    distance = _distance(rng, whole)
    scene = broad_scene(rng, scenes.model_copy(update={'near': distance, 'far': distance}), sensor)
    part = _crop(rng, whole, scene, of.largest)
    sensor = replace(sensor, grid=replace(sensor.grid, pinhole=part),
                     blur=float(rng.uniform(0.5, 1.4)))
    world = World.from_scene(scene)
    # Contours of all things count: none is given fewer paths than the target.
    light_of, samples = ((physical(replace(scene, targets=())), of.paths) if is_physical
                         else (partial(light_of_view, world), of.samples))
    light = light_of(sensor, *sensor.grid.centre, MARGIN, samples, int(rng.integers(2 ** 62)))
    picture = (_centre_view(rng, light, sensor) if is_f01 else
               photograph(rng, light, _off_axis(part, whole)))
    labels = contour_labels(world, part)
    return LabelledPicture(picture, labels.direction, labels.inside)


def _ordinary(rng: np.random.Generator) -> Sensor:
    """A camera 25 to 75 degrees wide of 200 to 1,280 px; its aperture is small."""
    width = int(np.exp(rng.uniform(np.log(200), np.log(1280))))
    height = int(width * rng.choice([0.5625, 0.75, 0.75, 1.0]))
    focal = width / 2 / np.tan(np.deg2rad(rng.uniform(25, 75)) / 2)
    middle = (np.array([width, height]) - 1) / 2 + rng.normal(0, 0.01, 2) * width
    pinhole = Pinhole(width, height, focal, focal, *middle.tolist())
    aperture = float(np.exp(rng.uniform(np.log(5e-5), np.log(6e-4))))
    return Sensor(one_view(pinhole, aperture), 0.6, 4.2, 1.0, 0.3, 0.0, 0.0, (1.0, 1.0, 1.0))


def _distance(rng: np.random.Generator, pinhole: Pinhole) -> float:
    """At which an object of an ordinary size has a random apparent size [m]."""
    largest = min(_APPARENT[1], 1.2 * max(pinhole.width, pinhole.height))
    size = np.exp(rng.uniform(np.log(_APPARENT[0]), np.log(largest)))
    return float(np.clip(pinhole.fx * _SIZE / size, *_DISTANCES))


def _crop(rng: np.random.Generator, whole: Pinhole, scene: Scene, largest: int) -> Pinhole:
    """A window of at most largest ** 2 pixels, mostly with an object in it."""
    if whole.width * whole.height <= largest ** 2:
        return whole
    aspect = np.exp(rng.uniform(-0.3, 0.3))
    width = min(int(largest * aspect), whole.width)
    height = min(int(largest / aspect), whole.height)
    room = np.array([whole.width - width, whole.height - height])
    corner = rng.uniform(0, 1, 2) * room
    if rng.random() < _AIMED:
        seen = whole.project(scene.targets[0].pose[:3, 3])
        corner = seen - rng.uniform(0.1, 0.9, 2) * [width, height]
    left, top = np.clip(np.nan_to_num(corner), 0, room).astype(int).tolist()
    return whole.crop(left, top, width, height)


def _off_axis(part: Pinhole, whole: Pinhole) -> NDArray[np.float32]:
    """(height, width) distance of a crop's pixels from the axis, 1 at the whole's corners."""
    x, y = np.arange(part.width) - part.cx, np.arange(part.height) - part.cy
    half = np.hypot(whole.width, whole.height) / 2
    return (np.hypot(x, y[:, None]) / half).astype(np.float32)


def _centre_view(rng: np.random.Generator, light: NDArray[np.float32], sensor: Sensor
                 ) -> NDArray[np.uint8]:
    """As a decoder gives it, or averaged over several views; with or without white balance."""
    view = sensed(light, exposure(light, sensor.level), sensor.blur, MARGIN)
    view = noisy(view, float(np.exp(rng.uniform(0, np.log(40)))), sensor, rng)
    red, green, blue = (1 / each for each in sensor.gains)
    colour = Colour((red, green, blue)) if rng.random() < 0.7 else Colour()
    return colour.displayed(np.maximum(view, 0), 1 / GAMMA)


def path_of(folder: Path, seed: int) -> Path:
    """Where the picture of a seed lies."""
    return folder / f'{seed:06d}.npz'


def read_labelled(path: Path) -> LabelledPicture:
    """Read a picture that `write_labelled` wrote; PmclError where the file is none."""
    try:
        values = read_arrays(path, _MOST_BYTES)
        made = LabelledPicture(values['picture'], values['direction'], values['inside'])
    except (FileError, KeyError) as error:
        raise PmclError(f'{path} is not a labelled picture ({error}): remove it and make it '
                        'again with `pmcl scenes pictures`') from error
    size = made.picture.shape[:2]
    if (made.picture.shape != (*size, 3) or made.picture.dtype != np.uint8
            or made.direction.shape != size or made.direction.dtype != np.int8
            or made.inside.shape != size or made.inside.dtype != np.bool_
            or (made.direction >= DIRECTIONS).any()):
        raise PmclError(f'{path}: picture {made.picture.shape} {made.picture.dtype}, direction '
                        f'{made.direction.shape} {made.direction.dtype}, below {DIRECTIONS}, '
                        f'and inside {made.inside.shape} {made.inside.dtype} do not belong '
                        'together: remove it and make it again with `pmcl scenes pictures`')
    return made


def write_labelled(folder: Path, seed: int, settings: PictureSettings) -> Path:
    """Make the picture of a seed, unless it is there; a reader never sees half a file."""
    path = path_of(folder, seed)
    if not path.exists():
        made = labelled_picture(seed, settings)
        with replacing(path) as part, part.open('wb') as file:
            np.savez_compressed(file, picture=made.picture, direction=made.direction,
                                inside=made.inside)
    return path


def write_many(folder: Path, seeds: range, settings: PictureSettings, jobs: int = 1,
               backend: str = 'loky', scheduler: str | None = None) -> Iterator[Path]:
    """Make the pictures of all seeds that are not there, in `jobs` processes; yields each path.

    backend: of joblib, 'loky' (processes of this machine) or 'dask' (workers of the cluster at
    the address `scheduler`, which see the same folder). Raises PmclError where a library lacks.
    """
    missing = [seed for seed in seeds if not path_of(folder, seed).exists()]
    if missing and settings.renderer == 'physical':
        prepare()
    folder.mkdir(parents=True, exist_ok=True)
    yield from run_all(partial(write_labelled, folder.resolve(), settings=settings), missing,
                       jobs, backend, scheduler)
