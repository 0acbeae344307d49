"""`pmcl warm-up`: compiles kernels ahead, for container images and robots."""

import click

from pmcl_ros.cli.base import STDERR
from pmcl_ros.warm_up import CHAIN, OTHER_MODES, Stage, Stages, compile_ahead


@click.command('warm-up')
@click.option('--all', 'everything', is_flag=True, help='Also what few users need: the mode '
              'faithful, layers by superposition, generated scenes.')
def warm_up(everything: bool) -> None:
    """Compile the kernels of the chain from picture to pose, so that no later start waits.

    On all cores, each kernel once, into NUMBA_CACHE_DIR if that is set. After an update, or on
    another kind of processor, it is needed again. Kernels on disk are not compiled again.
    """
    compile_ahead(STDERR, (*CHAIN, *OTHER_MODES, *scene_stages()) if everything else CHAIN)


def scene_stages() -> Stages:
    """Of generated scenes."""
    # Imported here: it is a room of its own, and the progress counts kernels that are imported.
    from pmcl_ros.simulation.scenes.render import warm_up as render
    return Stage(render, tuple(f'simulation.scenes.{each}.' for each in (
        'environment', 'lamps', 'lit', 'materials', 'render', 'sampling', 'shapes', 'trace'))),
