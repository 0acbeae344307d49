"""Simulated captures: scenes that are drawn, seen by a camera, written with their truth."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pmcl_ros.runtime.errors import FileError
from pmcl_ros.runtime.outputs import Results
from pmcl_ros.runtime.text_file import read_json
from pmcl_ros.simulation.camera_plan import CameraPlan, without_walls_between
from pmcl_ros.simulation.files import write_capture, write_raw, write_view, write_views
from pmcl_ros.simulation.lytro.camera import LytroCamera
from pmcl_ros.simulation.lytro.raw_picture import raw_picture
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera, take_picture
from pmcl_ros.simulation.scenes.rays import RayRenderer, fast_along
from pmcl_ros.simulation.scenes.render import Renderer, fast, render, seen_from
from pmcl_ros.simulation.scenes.scene import Scene
from pmcl_ros.simulation.scenes.sensor import Sensor

NOTE = 'simulation.json'  # in a folder of scenes: what `pmcl simulate` made them of


@dataclass(frozen=True)
class Simulation:
    """What is simulated.

    draw: a scene from its seed, random numbers and the camera; None: one like an F01 is drawn.
    camera: an ordinary one, or a Lytro whose raw pictures are taken; None: light fields, rendered
    directly. plan: where an ordinary camera takes its pictures; None: one picture. renderer:
    `scenes.render.fast` or `path_tracing.render.physical`. along: the same for raw pictures.
    samples: rays, or paths, of a pixel. digest: of all this, kept in truth.json: a capture of
    another one is made anew; '' where all captures of a folder are of one simulation.
    """

    draw: Callable[[int, np.random.Generator, Sensor | None], Scene]
    camera: OrdinaryCamera | LytroCamera | None
    plan: CameraPlan | None = None
    renderer: Renderer = fast
    samples: int = 8
    along: RayRenderer = fast_along
    digest: str = ''


def place_of(seed: int, folder: Path) -> Path:
    """The folder of a seed's capture."""
    return folder / f'{seed:06d}'


def is_there(folder: Path, digest: str = '') -> bool:
    """Whether a capture of that digest was written completely: its truth is written last."""
    try:
        return read_json(folder / 'truth.json').get('digest', '') == digest
    except FileError:
        return False


def simulate(seed: int, folder: Path, of: Simulation,
             progress: Callable[[float], None] = lambda _: None, force: bool = False) -> Path:
    """Write the capture of a seed into folder/SEED; returns that folder.

    It has the files of `pmcl scenes render`. progress: called with the share done. The same seed
    gives the same capture; one that is there is kept. force: it is made anew, whatever is there is
    overwritten. Raises SimulationError as the renderer does, OutputError where a file is there
    that no earlier run wrote.
    """
    place = place_of(seed, folder)
    if is_there(place, of.digest) and not force:
        return place
    with Results(place, 'feasibility', force) as trials:  # of a picture that is made anew
        trials.path('trials.json').unlink(missing_ok=True)
    rng = np.random.default_rng(seed)
    scene = of.draw(seed, rng, None if of.camera is None else of.camera.sensor(rng))
    if of.camera is None:
        write_capture(place, scene, render(scene, rng, of.samples, progress, of.renderer), seed,
                      force, of.digest)
    elif isinstance(of.camera, LytroCamera):
        frame = raw_picture(of.camera, of.along(scene), rng, of.samples, scene.sensor.level,
                            progress=progress)
        write_raw(place, scene, frame, seed, force)
    elif of.plan is None:
        picture = take_picture(scene, of.camera, rng, of.samples, of.renderer)
        write_view(place, scene, picture, of.camera, seed, force, of.digest)
    else:
        pictures, poses = [], of.plan.cameras(scene)
        shown = without_walls_between(scene, poses)
        for pose in poses:
            pictures.append(take_picture(seen_from(shown, pose), of.camera, rng, of.samples,
                                         of.renderer))
            progress(len(pictures) / len(poses))
        write_views(place, scene, pictures, of.camera, of.plan, seed, force, of.digest)
    return place
