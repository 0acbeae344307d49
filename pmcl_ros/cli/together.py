"""`pmcl together`: several objects in generated scenes, localised jointly and alone."""

import multiprocessing
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path

import click
from rich.progress import track

from pmcl_ros.cli.base import FOLDER, STDERR
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.evaluation.studies.together import Together, summary
from pmcl_ros.evaluation.studies.together import together as in_scene
from pmcl_ros.simulation.scenes.random_scene import SceneSettings


@click.command()
@click.option('--count', type=click.IntRange(1), default=20, show_default=True, help='Scenes.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='Scene k is that of seed + k.')
@click.option('--objects', type=click.IntRange(2, 5), default=3, show_default=True,
              help='In each scene; one more is looked for, which is not there.')
@click.option('--views', type=click.IntRange(3), default=5, show_default=True,
              help='Side of the square of views, odd.')
@click.option('--size', type=click.IntRange(16), default=328, show_default=True,
              help='Side of a view [px].')
@click.option('--samples', type=click.IntRange(1), default=1, show_default=True,
              help='Rays per pixel and view.')
@click.option('--processes', type=click.IntRange(1, 64), default=1, show_default=True)
@click.option('--out', type=FOLDER, help='Folder for a picture of each scene, and the table.')
def together(count: int, seed: int, objects: int, views: int, size: int, samples: int,
             processes: int, out: Path | None) -> None:
    """Localise the objects of scenes in which some hide others: jointly, and each alone.

    Prints a row for each scene: errors of the origins in mm, in brackets where the object is
    reported as lost. Two of the objects overlap in the image at least; some are copies.
    """
    settings = SceneSettings.make({'views': views, 'size': size, 'near': 0.5, 'far': 0.8},
                                  'pmcl together')
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    run = partial(in_scene, count=objects, settings=settings, samples=samples)
    seeds = range(seed, seed + count)
    done: list[Together] = []
    for each in track(_all(run, seeds, processes), total=count, console=STDERR, transient=True,
                      description='scenes'):
        done = sorted([*done, each], key=lambda one: one.seed)
        if out is not None:
            write_png(out / f'{each.seed:06d}.png', each.picture)
            (out / 'results.md').write_text(summary(done) + '\n')
    click.echo(summary(done))


def _all(run: Callable[[int], Together], seeds: Iterable[int], processes: int
         ) -> Iterator[Together]:
    """Of each seed, as soon as it is done."""
    if processes == 1:
        yield from map(run, seeds)
        return
    # Spawned, not forked: numba's threads do not survive a fork.
    with ProcessPoolExecutor(processes, multiprocessing.get_context('spawn')) as pool:
        for job in as_completed([pool.submit(run, each) for each in seeds]):
            yield job.result()
