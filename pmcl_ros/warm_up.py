"""Compiles the kernels ahead, on all cores, with progress: `pmcl warm-up`, the demo."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, wait
from multiprocessing import get_context
from multiprocessing.queues import SimpleQueue

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
    build_volume_of_views(PosedViews(views), DlvSettings(labels=3)).layers()


def _evidence() -> None:
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


Stages = tuple[Callable[[], None], ...]
# The longest first.
CHAIN: Stages = (_search, _volume, _decode, GaussNewton.warm_up, _evidence)
# Other modes and sources.
OTHER_MODES: Stages = (_filter, _layers, _plane_sweep)


def compile_ahead(console: Console, stages: Stages = CHAIN) -> None:
    """Compile the kernels that are not on disk yet, with a progress line."""
    folder = kernels.cache_folder()
    if folder is None:
        return
    done = folder / f'{kernels.digest()}.{len(stages)}.complete'
    if done.exists():
        return
    started, before = time.monotonic(), kernels.progress()[0]
    fork = get_context('fork')
    names: SimpleQueue[str] = fork.SimpleQueue()
    columns = TextColumn('compiling kernels'), BarColumn(), MofNCompleteColumn(), TextColumn(
        '{task.description}')
    with ProcessPoolExecutor(len(os.sched_getaffinity(0)), fork, _begin, (names,)) as pool:
        # Processes are forked before the progress line starts its thread.
        futures = [pool.submit(stage) for stage in stages]
        with Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task('', total=kernels.progress()[1])
            line, name = started + _LINE_EVERY, ''
            while wait(futures, 0.2).not_done:
                while not names.empty():
                    name = names.get()
                count, total = kernels.progress()
                bar.update(task, completed=count, description=name)
                if not console.is_terminal and time.monotonic() > line:
                    console.print(f'compiling kernels: {count} of {total}, {name}')
                    line += _LINE_EVERY
        for each in futures:
            each.result()
    done.touch()
    console.print(f'compiled {kernels.progress()[0] - before} kernels in '
                  f'{time.monotonic() - started:.0f} s', highlight=False)


def _begin(names: 'SimpleQueue[str]') -> None:
    """In each process: report which kernel is being compiled."""
    kernels.report_to(names.put)
