"""Which machine makes the likelihoods: the processor by numba, or a GPU by GL."""

import logging
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv import cost, reference
from pmcl_ros.dlv.gl_cost import GlCost
from pmcl_ros.dlv.likelihood import log_likelihood
from pmcl_ros.dlv.settings import BackEnd, DlvSettings
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.gl import GlContext

_LOG = logging.getLogger(__name__)

# Mesa's renderers that need no GPU, by their names; swrast calls itself the last.
_SOFTWARE = ('llvmpipe', 'softpipe', 'swr', 'software rasterizer')

# A context is its thread's: volumes are asked for by any thread, and made by this one.
_THREAD = ThreadPoolExecutor(1, 'dlv_gl')


def is_software(renderer: str) -> bool:
    """Whether an OpenGL renderer of this name runs on the processor."""
    return any(each in renderer.lower() for each in _SOFTWARE)


def make_likelihood(light_field: LightField, depths: NDArray[np.float64], settings: DlvSettings
                    ) -> NDArray[np.float32]:
    """L(x, l), (height, width, labels), by the settings' back end; any thread may call.

    depths: (labels,) [m]. Where 'auto' chose gl, what GL cannot hold is made by numba, with a
    warning. Raises VolumeError as `Matching.of` does, and RenderError when 'gl' is forced and GL
    cannot.
    """
    if settings.interpolation == 'phase':
        return log_likelihood(
            reference.cost_volume(light_field, depths, settings).astype(np.float32))
    if choose(settings.back_end) == 'gl':
        try:
            return _THREAD.submit(_on_gl, light_field, depths, settings).result()
        except RenderError as error:
            if settings.back_end == 'gl':
                raise
            _warn(str(error))
    return cost.likelihood_volume(light_field, depths, settings)


@lru_cache
def choose(wanted: BackEnd) -> Literal['numba', 'gl']:
    """The back end that `wanted` stands for on this machine; logged when first asked."""
    if wanted != 'auto':
        _LOG.info('volumes are made by %s, as the settings say', wanted)
        return wanted
    try:
        renderer = _THREAD.submit(_renderer).result()
    except RenderError as error:
        _LOG.info('volumes are made by numba: %s', error)
        return 'numba'
    chosen: Literal['numba', 'gl'] = 'numba' if is_software(renderer) else 'gl'
    _LOG.info('volumes are made by %s: the OpenGL renderer is %s', chosen, renderer)
    return chosen


@lru_cache(maxsize=16)  # told once, not at every capture
def _warn(reason: str) -> None:
    _LOG.warning('volumes are made by numba instead of gl: %s', reason)


def _renderer() -> str:
    context = GlContext()
    context.close()
    return context.renderer


@lru_cache(maxsize=1)
def _gl_cost() -> GlCost:
    return GlCost(GlContext())


def _on_gl(light_field: LightField, depths: NDArray[np.float64], settings: DlvSettings
           ) -> NDArray[np.float32]:
    likelihood = _gl_cost().log_likelihood(light_field, depths, settings)
    try:
        return likelihood.read()
    finally:
        likelihood.release()
