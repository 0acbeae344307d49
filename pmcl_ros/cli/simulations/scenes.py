"""`pmcl scenes`: light fields and pictures of generated scenes, with truth."""

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import click
import numpy as np
from rich.progress import Progress

from pmcl_ros import __version__
from pmcl_ros.cli.base import CAMERA, FOLDER, FORCE, STDERR, check_scheduler, process_options
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.outputs import refuse_existing
from pmcl_ros.runtime.text_file import read_json
from pmcl_ros.simulation.camera_plan import CameraPlan
from pmcl_ros.simulation.files import write_sequence
from pmcl_ros.simulation.labelled_pictures import PictureSettings, write_many
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera
from pmcl_ros.simulation.processes import run_all
from pmcl_ros.simulation.scenes.broad_scene import broad_scene
from pmcl_ros.simulation.scenes.random_scene import KINDS, SceneSettings, random_scene
from pmcl_ros.simulation.scenes.scene import Scene
from pmcl_ros.simulation.scenes.sensor import Sensor
from pmcl_ros.simulation.sequence import Sequence, SequenceSettings
from pmcl_ros.simulation.simulated_captures import NOTE, Simulation, simulate
from pmcl_ros.simulation.warm_up import LABELS, RENDER
from pmcl_ros.warm_up.chain import DRAW
from pmcl_ros.warm_up.stage import compile_ahead

_SEQUENCE = SequenceSettings.model_fields
_PRESETS: dict[str, Callable[..., Scene]] = {'standard': random_scene, 'broad': broad_scene}


@click.group()
def scenes() -> None:
    """Generated scenes: glass, film, clutter, seen by a light-field camera."""


@scenes.command('render')
@click.option('--count', type=click.IntRange(1), default=10, show_default=True, help='Scenes.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='Scene k is that of seed + k.')
@click.option('--kind', 'kinds', multiple=True, type=click.Choice(KINDS),
              help='Only this kind; may be repeated.')
@click.option('--camera', type=CAMERA, help='An ordinary camera, YAML: width, height, fx, cx, cy, '
              'optional fy, model, distortion, gamma, noise, blur. It takes one picture of '
              'each scene. Default: a light-field camera.')
@click.option('--cameras', 'plan', metavar='PLAN', help='With --camera: pictures of each scene '
              'from several poses: arc:COUNT:DEGREES about the object, grid:ROWSxCOLUMNS:METRES, '
              'or a YAML file with these or poses, and errors of the reported poses.')
@click.option('--views', type=click.IntRange(1), show_default='7; with --camera 1',
              help='Side of the square of views, odd; with --camera the number of pictures, 1.')
@click.option('--size', type=click.IntRange(16), show_default='328',
              help="Side of a view [px]; with --camera it is the camera's.")
@click.option('--targets', type=click.IntRange(1, 8), default=1, show_default=True,
              help='Objects to look for in a scene.')
@click.option('--samples', type=click.IntRange(1), show_default='2; with --camera 16',
              help='Rays per pixel and view.')
@click.option('--noise', type=click.FloatRange(0), default=1.0, show_default=True,
              help=f"{SceneSettings.model_fields['noise'].description}; with --camera in units of "
              "that camera's")
@click.option('--preset', type=click.Choice(list(_PRESETS)), default='standard',
              show_default=True, help='Distributions of scenes; broad has the surroundings, '
              'clutter and cameras of `pmcl scenes pictures`.')
@process_options
@click.option('-o', '--out', required=True, type=FOLDER, help='Folder; a subfolder per scene. '
              'Its scenes with the same options are kept.')
@FORCE
def render_scenes(count: int, seed: int, kinds: tuple[str, ...], camera: Path | None,
                  plan: str | None, views: int | None, size: int | None, targets: int,
                  samples: int | None, noise: float, preset: str, jobs: int, backend: str,
                  scheduler: str | None, out: Path, force: bool) -> None:
    """Render scenes into --out, as captures that `pmcl evaluate` and `pmcl localize` read."""
    check_scheduler(backend, scheduler)
    given = {'views': views, 'size': size, 'kinds': kinds}
    values = {'targets': targets, 'noise': noise} | {
        name: value for name, value in given.items() if value}
    ordinary, placed = None, None if plan is None else CameraPlan.parse(plan)
    if camera is None and plan is not None:
        raise click.UsageError(f'--cameras {plan}: of which camera? Say --camera too')
    if camera is not None:
        if size is not None or views not in (None, 1):
            raise click.UsageError(f'--camera {camera}: it has its own size and takes one picture '
                                   'of each scene; leave out --size, and --views or say 1')
        ordinary = OrdinaryCamera.load(camera)
        ordinary = ordinary.model_copy(update={'noise': noise * ordinary.noise})
        values |= {'views': 3, 'field': min(ordinary.field, 1.5)}
    settings = SceneSettings.make(values, 'pmcl scenes')
    if (out / NOTE).exists():
        raise SettingsError(f'{out} has scenes of pmcl simulate: choose another --out')
    samples = samples or (2 if ordinary is None else 16)
    made_of = [__version__, preset, str(samples), *(
        each.model_dump_json() for each in (settings, ordinary, placed) if each is not None)]
    simulation = Simulation(
        partial(_drawn, preset=preset, settings=settings), ordinary, placed, samples=samples,
        digest=hashlib.sha256('\n'.join(made_of).encode()).hexdigest()[:16])
    compile_ahead(STDERR, RENDER)
    one = partial(simulate, folder=out.resolve(), of=simulation, force=force)
    with Progress(console=STDERR, transient=True) as bar:
        for place in bar.track(run_all(one, range(seed, seed + count), jobs, backend, scheduler),
                               total=count, description='scenes'):
            click.echo(f"{out / place.name}: {read_json(place / 'truth.json')['name']}")


def _drawn(_: int, rng: np.random.Generator, sensor: Sensor | None, preset: str,
           settings: SceneSettings) -> Scene:
    """As `Simulation.draw`."""
    return _PRESETS[preset](rng, settings, sensor=sensor)


@scenes.command('pictures')
@click.option('--first-seed', type=click.IntRange(0), default=0, show_default=True,
              help='Picture k is that of first-seed + k.')
@click.option('--count', type=click.IntRange(1), default=100, show_default=True, help='Pictures.')
@process_options
@click.option('--renderer', type=click.Choice(['fast', 'physical']), default='fast',
              show_default=True, help=PictureSettings.model_fields['renderer'].description)
@click.option('--no-film', is_flag=True, help='No scene has a film before the object, as with '
              '--renderer physical.')
@click.option('-o', '--out', required=True, type=FOLDER, help='Folder; a file SEED.npz per '
              'picture. Its pictures are kept.')
def pictures(first_seed: int, count: int, jobs: int, backend: str, scheduler: str | None,
             renderer: str, no_film: bool, out: Path) -> None:
    """Write pictures of generated scenes, with the labels that a contour map is learned from."""
    check_scheduler(backend, scheduler)
    seeds = range(first_seed, first_seed + count)
    settings = PictureSettings.make({'renderer': renderer, 'film': not no_film},
                                    'pmcl scenes pictures')
    compile_ahead(STDERR, (*RENDER, *LABELS) if renderer == 'fast' else LABELS)
    with Progress(console=STDERR, transient=True) as bar:
        task = bar.add_task('pictures', total=count)
        made = 0
        for path in write_many(out, seeds, settings, jobs, backend, scheduler):
            made += 1
            bar.update(task, completed=made, description=path.name)
    click.echo(f'{out}: {made} pictures made, {count - made} were there')


@scenes.command('sequence')
@click.option('--frames', type=click.IntRange(1), default=_SEQUENCE['frames'].default,
              show_default=True, help=_SEQUENCE['frames'].description)
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True)
@click.option('--occluded', type=click.IntRange(0), show_default=True,
              default=_SEQUENCE['occluded'].default, help=_SEQUENCE['occluded'].description)
@click.option('--kind', type=click.Choice(['opaque', 'translucent', 'film']),
              help=_SEQUENCE['kinds'].description)
@click.option('--object-speed', type=click.FloatRange(0), show_default=True,
              default=_SEQUENCE['object_speed'].default,
              help=_SEQUENCE['object_speed'].description)
@click.option('--camera-speed', type=click.FloatRange(0), show_default=True,
              default=_SEQUENCE['camera_speed'].default,
              help=_SEQUENCE['camera_speed'].description)
@click.option('--views', type=click.IntRange(3), default=_SEQUENCE['views'].default,
              show_default=True, help=_SEQUENCE['views'].description)
@click.option('--size', type=click.IntRange(32), default=_SEQUENCE['size'].default,
              show_default=True, help=_SEQUENCE['size'].description)
@click.option('-o', '--out', required=True, type=FOLDER, help='Folder; it gets bag/, model.obj, '
              'truth.json and parameters.yaml.')
@FORCE
def sequence(frames: int, seed: int, occluded: int, kind: str | None, object_speed: float,
             camera_speed: float, views: int, size: int, out: Path, force: bool) -> None:
    """Write a bag of a moving object before a moving camera, with the truth of every frame.

    Its views are those of textured layers. `pmcl_replay OUT/bag --preset views --in-step` plays
    them to the nodes that `pmcl_bringup --params-file OUT/parameters.yaml --without lytro_driver
    --without subaperture_node` starts.
    """
    refuse_existing([out / each for each in ('bag', 'model.obj', 'truth.json', 'parameters.yaml')],
                    force)
    values = {'frames': frames, 'occluded': occluded, 'object_speed': object_speed,
              'camera_speed': camera_speed, 'views': views, 'size': size}
    kinds = {'kinds': [kind]} if kind else {}
    settings = SequenceSettings.make(values | kinds, 'pmcl scenes sequence')
    compile_ahead(STDERR, DRAW)
    made = Sequence(seed, settings)
    with Progress(console=STDERR, transient=True) as bar:
        task = bar.add_task(made.kind, total=len(made))
        write_sequence(out, made, lambda done: bar.update(task, completed=done), force)
    click.echo(f'{out}: {made.kind}, {made.model.name}')
