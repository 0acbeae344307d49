"""`pmcl scenes`: light fields of generated scenes, with truth."""

from pathlib import Path

import click
import numpy as np
from rich.progress import Progress, TimeRemainingColumn

from pmcl_ros.cli.base import FOLDER, STDERR
from pmcl_ros.simulation.files import write_capture, write_sequence
from pmcl_ros.simulation.scenes.random_scene import KINDS, SceneSettings, random_scene
from pmcl_ros.simulation.scenes.render import render
from pmcl_ros.simulation.sequence import Sequence, SequenceSettings

_SEQUENCE = SequenceSettings.model_fields


@click.group()
def scenes() -> None:
    """Generated scenes: glass, film, clutter, seen by a light-field camera."""


@scenes.command('render')
@click.option('--count', type=click.IntRange(1), default=10, show_default=True, help='Scenes.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='Scene k is that of seed + k.')
@click.option('--kind', 'kinds', multiple=True, type=click.Choice(KINDS),
              help='Only this kind; may be repeated.')
@click.option('--views', type=click.IntRange(3), default=7, show_default=True,
              help='Side of the square of views, odd.')
@click.option('--size', type=click.IntRange(16), default=328, show_default=True,
              help='Side of a view [px].')
@click.option('--targets', type=click.IntRange(1, 8), default=1, show_default=True,
              help='Objects to look for in a scene.')
@click.option('--samples', type=click.IntRange(1), default=2, show_default=True,
              help='Rays per pixel and view.')
@click.option('--noise', type=click.FloatRange(0), default=1.0, show_default=True,
              help=SceneSettings.model_fields['noise'].description)
@click.option('-o', '--out', required=True, type=FOLDER, help='Folder; a subfolder per scene.')
def render_scenes(count: int, seed: int, kinds: tuple[str, ...], views: int, size: int,
                  targets: int, samples: int, noise: float, out: Path) -> None:
    """Render scenes into --out, as captures that `pmcl evaluate` and `pmcl localize` read."""
    values = {'views': views, 'size': size, 'targets': targets, 'noise': noise}
    settings = SceneSettings.make(values | ({'kinds': kinds} if kinds else {}), 'pmcl scenes')
    with Progress(*Progress.get_default_columns()[:-1], TimeRemainingColumn(), console=STDERR,
                  transient=True) as bar:
        task = bar.add_task('', total=float(count))
        for number in range(count):
            rng = np.random.default_rng(seed + number)
            scene = random_scene(rng, settings)
            bar.update(task, description=scene.name)

            def show(part: float, done: int = number) -> None:
                bar.update(task, completed=done + part)

            capture = render(scene, rng, samples, show)
            write_capture(out / f'{seed + number:06d}', scene, capture, seed + number)
            click.echo(f'{out / f"{seed + number:06d}"}: {scene.name}')


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
def sequence(frames: int, seed: int, occluded: int, kind: str | None, object_speed: float,
             camera_speed: float, views: int, size: int, out: Path) -> None:
    """Write a bag of a moving object before a moving camera, with the truth of every frame.

    Its views are those of textured layers. `pmcl_replay OUT/bag --preset views --in-step` plays
    them to the nodes that `pmcl_bringup --params-file OUT/parameters.yaml --without lytro_driver
    --without subaperture_node` starts.
    """
    values = {'frames': frames, 'occluded': occluded, 'object_speed': object_speed,
              'camera_speed': camera_speed, 'views': views, 'size': size}
    kinds = {'kinds': [kind]} if kind else {}
    made = Sequence(seed, SequenceSettings.make(values | kinds, 'pmcl scenes sequence'))
    with Progress(*Progress.get_default_columns()[:-1], TimeRemainingColumn(), console=STDERR,
                  transient=True) as bar:
        task = bar.add_task(made.kind, total=len(made))
        write_sequence(out, made, lambda done: bar.update(task, completed=done))
    click.echo(f'{out}: {made.kind}, {made.model.name}')
