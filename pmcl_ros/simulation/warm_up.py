"""The kernels of generated scenes, by the package's own renderer."""

import numpy as np

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.simulation.lytro.calibration_pictures import white_picture
from pmcl_ros.simulation.lytro.camera import LytroCamera
from pmcl_ros.simulation.occluding import contour_labels
from pmcl_ros.simulation.scenes import render
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene
from pmcl_ros.simulation.scenes.world import World
from pmcl_ros.warm_up.stage import Stage, Stages

_PINHOLE = Pinhole(16, 16, 16.0, 16.0, 7.5, 7.5)


def _raw_picture() -> None:
    white_picture(LytroCamera(width=80, height=80), np.random.default_rng(0), samples=1)


def _first_surfaces() -> None:
    world = _world()
    render.first_surfaces(world, _PINHOLE, np.zeros(len(world.kinds), np.int64))


def _labels() -> None:
    contour_labels(_world(), _PINHOLE)


def _world() -> World:
    return World.from_scene(random_scene(np.random.default_rng(0), SceneSettings()))


def _scenes(*names: str) -> tuple[str, ...]:
    return tuple(f'simulation.scenes.{each}' for each in names)


_NEAREST = _scenes('shapes.', 'trace._face_normal', 'trace.nearest')
_LIGHT = _scenes(*(f'{each}.' for each in ('environment', 'lamps', 'lit', 'materials', 'shapes',
                                           'trace')),
                 *(f'sampling.{each}' for each in ('across', 'scattered', 'stream', 'tilted',
                                                   'uniform')))
# Of pictures and light fields; of raw pictures of a Lytro, and what it is calibrated with.
RENDER: Stages = Stage(render.warm_up, (*_LIGHT, *_scenes('render.', 'sampling.'))),
RAW_PICTURES: Stages = Stage(_raw_picture, (*_LIGHT, *_scenes('rays.'), 'simulation.lytro.')),
# Of the truth of light fields, whatever renders them; of the labels of pictures.
FIRST_SURFACES: Stages = Stage(_first_surfaces, (*_NEAREST, *_scenes('render._first'))),
LABELS: Stages = *FIRST_SURFACES, Stage(_labels, ('simulation.occluding.',))
