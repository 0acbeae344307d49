"""Compiles kernels ahead, on all cores, with progress: commands, `pmcl warm-up`, the demo."""

import os
import signal
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.dlv import build
from pmcl_ros.dlv.plane_sweep import build_volume_of_views
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.evidence.edges import EdgeVolume, build_edges
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.calibration import Calibration
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.particle_filter import ParticleFilterLocalizer
from pmcl_ros.pmcl.render.gauss_newton import GaussNewton
from pmcl_ros.pmcl.settings import Mode, PmclSettings
from pmcl_ros.runtime import kernels
from pmcl_ros.runtime.errors import PmclError
from pmcl_ros.runtime.resources import resolve

_LINE_EVERY = 5.0  # s: between lines where the output is a log, not a terminal
_CAMERA, _DEPTHS = Pinhole(64, 64, 100.0, 100.0, 31.5, 31.5), depth_labels(0.4, 0.8, 8)


def _decode() -> None:
    """Decode the shipped white image as a picture."""
    folder = resolve('package://pmcl_ros/config/cameras', 'config')
    white = folder / 'demo_white.RAW.xz'
    Decoders(Calibration.load(folder / 'demo.yaml'), white).decode(read_raw_frame(white))


def _volume() -> None:
    build.warm_up('numba')
    settings = DlvSettings(labels=9, views=3, back_end='numba')
    build.build_volume(build.tiny_light_field(), settings).layers()


def _layers() -> None:
    build.warm_up('numba', 'joint')


def _plane_sweep() -> None:
    beside = np.eye(4)
    beside[0, 3] = 0.01
    views = tuple(PosedView(Header(), _noise(3)[:, :, 0], _CAMERA, each)
                  for each in (np.eye(4), beside))
    build_volume_of_views(PosedViews(views), DlvSettings(labels=4)).layers()


def _edges() -> None:
    build_edges(build.tiny_light_field(), DlvSettings(views=3, edge_labels=2))


def _search() -> None:
    """Look for an object in noise."""
    model, settings = _object('default')
    edges = EdgeVolume(Header(), _noise(3), _DEPTHS, _CAMERA)
    with Localizer(model, settings) as localizer:
        localizer.contour(edges, localizer.localize(edges, np.random.default_rng(0)).pose)


def _filter() -> None:
    """Look for an object in noise by the paper's filter."""
    model, settings = _object('faithful')
    volume = DepthLikelihoodVolume(Header(), _noise(1)[..., 0].copy(), _DEPTHS, _CAMERA)
    with ParticleFilterLocalizer(model, settings) as localizer:
        localizer.localize(volume, np.random.default_rng(0))


def _noise(components: int) -> NDArray[np.float32]:
    return np.random.default_rng(0).random((64, 64, 8, components), np.float32)


def _object(mode: Mode) -> tuple[ObjectModel, PmclSettings]:
    return (ObjectModel.load(resolve('package://pmcl_ros/models/shaker.obj', 'object')),
            PmclSettings(mode=mode, renderer='numba', proposals=20, particles=8, moves=1,
                         faithful_particles=8, faithful_iterations=2))


class Stage(NamedTuple):
    """Compiles kernels, by running on little data what calls them.

    kernels: what the names of those begin with.
    """

    run: Callable[[], None]
    kernels: tuple[str, ...]

    def mark(self, folder: Path) -> Path:
        """The file that says that all its kernels, as they are now, are in a folder."""
        return folder / f'{self.run.__qualname__}.{kernels.digest(self.kernels)}.complete'


_PLANES = 'lightfield.light_field', 'dlv.planes', 'dlv.sampling'
_LIKELIHOODS = *_PLANES, 'dlv.cost', 'dlv.row_costs', 'dlv.window_sums', 'dlv.likelihood'
Stages = tuple[Stage, ...]
# Of a raw picture; of a pose by the contour; of edges of a light field.
DECODE: Stages = Stage(_decode, ('camera.packing', 'lightfield.')),
SEARCH: Stages = (Stage(_search, ('geometry.faces', 'evidence.energies', 'pmcl.')),
                  Stage(GaussNewton.warm_up, ('pmcl.render.',)))
EDGES: Stages = Stage(_edges, (*_PLANES, 'evidence.')),
# Of the depth likelihood volume of a light field, of posed views; of the paper's filter in it.
VOLUME: Stages = Stage(_volume, (*_LIKELIHOODS, 'dlv.layers')),
PLANE_SWEEP: Stages = Stage(_plane_sweep, (*_PLANES, 'dlv.plane_sweep', 'dlv.window_sums',
                                           'dlv.likelihood', 'dlv.layers')),
FILTER: Stages = Stage(_filter, ('geometry.faces', 'dlv.sampling', 'pmcl.render.')),
# The longest first.
CHAIN: Stages = *SEARCH[:1], *VOLUME, *DECODE, *SEARCH[1:], *EDGES
# Other modes and sources.
OTHER_MODES: Stages = (
    *FILTER, Stage(_layers, (*_LIKELIHOODS, 'dlv.layer_fit', 'dlv.view_moments')), *PLANE_SWEEP)


def compile_ahead(console: Console, stages: Stages = CHAIN) -> None:
    """Compile the kernels that are not on disk yet, on all cores, with a progress line.

    Where all are, and where none can be kept, this takes milliseconds and prints nothing.
    Call it before there are threads: it forks. Raises PmclError where a process is killed.
    """
    folder = kernels.cache_folder()
    if folder is None:
        return
    missing = [each for each in stages if not each.mark(folder).exists()]
    names = tuple(name for each in missing for name in each.kernels)
    started, (before, total) = time.monotonic(), kernels.progress(names)
    if not total:  # nothing is missing, or numba is switched off
        return
    fork = get_context('fork')
    begun: SimpleQueue[str] = fork.SimpleQueue()
    columns = TextColumn('compiling kernels'), BarColumn(), MofNCompleteColumn(), TextColumn(
        '{task.description}')
    with ProcessPoolExecutor(len(os.sched_getaffinity(0)), fork, _begin, (begun,)) as pool:
        # Processes are forked before the progress line starts its thread.
        futures = [pool.submit(each.run) for each in missing]
        with Progress(*columns, console=console, transient=True,
                      disable=not console.is_terminal) as bar:
            task = bar.add_task('', total=total)
            line, name = started, ''
            while wait(futures, 0.2).not_done:
                while not begun.empty():
                    name = begun.get()
                count, _ = kernels.progress(names)
                bar.update(task, completed=count, description=name)
                if name and not console.is_terminal and time.monotonic() > line:
                    console.print(f'compiling kernels: {count} of {total}, {name}')
                    line = time.monotonic() + _LINE_EVERY
        try:
            for each in futures:
                each.result()
        except BrokenProcessPool:
            raise PmclError('a process that compiled kernels was killed, probably for lack of '
                            'memory; start again: what is compiled is kept') from None
    for stage in missing:
        stage.mark(folder).touch()
    if count := kernels.progress(names)[0] - before:
        console.print(f'compiled {count} kernels in {time.monotonic() - started:.0f} s',
                      highlight=False)


def _begin(names: 'SimpleQueue[str]') -> None:
    """In each process: report which kernel is being compiled; end at once by Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    kernels.report_to(names.put)
