"""LightField -> DepthLikelihoodVolume: the paper's volume of one capture."""

import logging
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv import cost
from pmcl_ros.dlv.gl_cost import GlCost
from pmcl_ros.dlv.likelihood import log_likelihood, truncate
from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.settings import BackEnd, DlvSettings, LayersFrom
from pmcl_ros.dlv.superposition import fit_superposition
from pmcl_ros.dlv.volume import DepthLikelihoodVolume, checked_labels
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.gl import GlContext, choose_back_end

_LOG = logging.getLogger(__name__)
# The only thread that uses the GL context; any thread may call `build_volume`.
_THREAD = ThreadPoolExecutor(1, 'dlv_gl')


def build_volume(light_field: LightField, settings: DlvSettings) -> DepthLikelihoodVolume:
    """The paper's depth likelihood volume of one capture (section V.A).

    It is made for the pixels of `PixelGrid.from_crop` the settings, and carries their camera. With
    `interpolation` 'phase' every view is shifted to every label by a Fourier transform, which
    takes many seconds. Raises VolumeError when fewer than two views have light, the labels are too
    near, or the volume would be too large; RenderError when `back_end` is 'gl' and GL cannot.
    """
    pinhole = PixelGrid.from_crop(light_field.grid.pinhole, settings.crop, settings.stride).pinhole
    pairs = StereoPairs.from_grid(light_field.grid, settings.views)
    depths = checked_labels(pairs, settings, pinhole, 'labels')
    likelihood = make_likelihood(light_field, depths, settings)
    if settings.truncate:
        likelihood = truncate(likelihood, settings.maxima, settings.neighbours)
    superposition = (fit_superposition(light_field, settings) if settings.layers == 'joint'
                     else None)
    return DepthLikelihoodVolume(light_field.header, likelihood, depths, pinhole, superposition)


def warm_up(back_end: BackEnd = 'auto', layers: LayersFrom = 'volume') -> None:
    """Compile this stage on a tiny light field, so that the first capture does not wait for it.

    back_end, layers: those of the settings to come. Raises RenderError when back_end is 'gl' and
    GL cannot.
    It takes seconds once on a machine that lets numba keep its cache, else in every process.
    """
    build_volume(tiny_light_field(), DlvSettings(labels=3, views=3, truncate=True,
                                                 back_end=back_end, layers=layers))


def tiny_light_field() -> LightField:
    """3x3 views of 48x48 px of noise, to compile with."""
    side = 48
    pinhole = Pinhole(side, side, 100, 100, side / 2, side / 2)
    grid = ViewGrid(pinhole, 0.001, nominal_positions(3, 3), np.ones((3, 3), np.float32))
    views = np.random.default_rng(0).random((3, 3, side, side, 3), np.float32)
    return LightField(Header(), views, grid)


def make_likelihood(light_field: LightField, depths: NDArray[np.float64], settings: DlvSettings
                    ) -> NDArray[np.float32]:
    """L(x, l), (height, width, labels), by the settings' back end; any thread may call.

    depths: (labels,) [m]. Where 'auto' chose gl, what GL cannot hold is made by numba, with a
    warning. Raises VolumeError as `CostInputs.from_light_field` does, and RenderError when 'gl' is
    forced and GL cannot.
    """
    if settings.interpolation == 'phase':
        from pmcl_ros.dlv import reference  # imports scipy.fft, for nothing in the default mode
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


def choose(wanted: BackEnd) -> Literal['numba', 'gl']:
    """The back end that `wanted` stands for on this machine; logged when first asked."""
    return choose_back_end(wanted, 'volumes are made')


@lru_cache(maxsize=16)  # logged once, not at every capture
def _warn(reason: str) -> None:
    _LOG.warning('volumes are made by numba instead of gl: %s', reason)


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
