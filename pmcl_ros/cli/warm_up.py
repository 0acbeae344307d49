"""`pmcl warm-up`: compiles kernels ahead, for container images and robots."""

import click

from pmcl_ros.cli.base import STDERR
from pmcl_ros.warm_up.chain import CHAIN, OTHER_MODES
from pmcl_ros.warm_up.stage import compile_ahead


@click.command('warm-up')
@click.option('--all', 'everything', is_flag=True, help='Also what few users need: the mode '
              'faithful, layers by superposition, generated scenes.')
def warm_up(everything: bool) -> None:
    """Compile the kernels of the chain from picture to pose, so that no later start waits.

    On all cores, each kernel once, into NUMBA_CACHE_DIR if that is set. After an update, or on
    another kind of processor, it is needed again. Kernels on disk are not compiled again.
    """
    stages = CHAIN
    if everything:
        # Here: the chain needs no simulation.
        from pmcl_ros.simulation.warm_up import LABELS, RAW_PICTURES, RENDER
        from pmcl_ros.warm_up.raw import light_stages
        stages += *OTHER_MODES, *light_stages(), *RENDER, *RAW_PICTURES, *LABELS
    compile_ahead(STDERR, stages)
