"""How long a simulation may take, told before it begins."""

from dataclasses import dataclass

import click
from numba import config

from pmcl_ros.cli.simulations.options import Draw, minutes
from pmcl_ros.simulation.lytro.camera import LytroCamera
from pmcl_ros.simulation.path_tracing.render import physical
from pmcl_ros.simulation.path_tracing.variant import is_compiled
from pmcl_ros.simulation.simulated_captures import Simulation

# CPU seconds, of a picture as docs/results/feasibility.md and decode.md have it.
_RAY, _RAW_RAY, _WHITE_RAY = 4.5e-6, 4.6e-6, 0.5e-6  # by the own renderer
_PATH, _RAW_PATH, _SCENE = 2e-6, 0.8e-6, 3.0  # by path tracing; a scene is translated, compiled
_NOT_COMPILED = 10  # times as long are paths
_CALIBRATION = 8  # rays of a pixel
_SEARCH = 3.0
_SPREAD = 2  # machines, objects and surroundings differ by such a factor, both ways


@dataclass(frozen=True)
class Work:
    """What is left to do. calibration: number of white images and boards. searches: of poses."""

    scenes: int
    searches: int = 0
    calibration: int = 0

    def seconds(self, of: Simulation) -> float:
        """CPU time, as of the machine that it was measured on."""
        raw = isinstance(of.camera, LytroCamera)
        if of.renderer is physical:
            path = (_RAW_PATH if raw else _PATH) * (1 if is_compiled() else _NOT_COMPILED)
            scene = _SCENE + path * _pixels(of) * of.samples
        else:
            scene = (_RAW_RAY if raw else _RAY) * _pixels(of) * of.samples
        white = _WHITE_RAY * _CALIBRATION * _pixels(of)
        return self.scenes * scene + self.calibration * white + self.searches * _SEARCH

    def print_time(self, of: Simulation, jobs: int, backend: str) -> None:
        """Print about how long it takes, unless nothing is left."""
        if not (self.scenes or self.searches or self.calibration):
            return
        cores: int = config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
        is_here = backend == 'loky'  # the number of a cluster's workers is not known
        each = self.seconds(of) / (1 if not is_here else cores if jobs == 1 else min(jobs, cores))
        times = f'about {minutes(each / _SPREAD)} to {minutes(each * _SPREAD)}'
        if self.scenes and isinstance(of.camera, LytroCamera):
            times = f'raw pictures take long: {times}'
        click.echo(times if is_here else f'{times} of one core; the workers share it', err=True)


def _pixels(of: Simulation) -> int:
    """Of all pictures of a scene."""
    if of.camera is not None:
        return of.camera.width * of.camera.height * (1 if of.plan is None else of.plan.count)
    assert isinstance(of.draw, Draw)
    return of.draw.settings.views ** 2 * of.draw.settings.size ** 2
