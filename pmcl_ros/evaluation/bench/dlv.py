"""Times the depth likelihood volume, stage by stage, against its reference."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv import reference
from pmcl_ros.dlv.build import choose, make_likelihood
from pmcl_ros.dlv.cost import CostInputs, likelihood_of
from pmcl_ros.dlv.gl_cost import GlArray, GlCost
from pmcl_ros.dlv.likelihood import log_likelihood
from pmcl_ros.dlv.planes import ENCODING
from pmcl_ros.dlv.settings import BackEnd, DlvSettings
from pmcl_ros.dlv.superposition import fit_superposition
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.bench.timing import Bench, best_ms
from pmcl_ros.evidence.edges import edge_volume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.runtime.gl import GlContext

NEAR, FAR = 0.39, 0.71  # m
_PLAIN_LABELS = 3  # that the reference is run on


def bench_dlv(repeats: int = 7, wanted: BackEnd = 'numba', side: int = 328) -> Bench:
    """The volume of 7x7 views of side x side, 75 labels, uint8 views to float32 likelihood.

    Stages: `views`, from uint8 to a checked LightField; `planes`, the smoothed colours and
    gradients to match; then by numba `sweep`, from planes to likelihood, or by gl `upload`,
    `resident` (planes on the GPU to likelihood on the GPU) and `read`. `total` is all of it in one
    go, by the product's own functions; apart are `edges`, the edge volume, and `layers`, the joint
    fit of two layers to every other pixel, across and down. `plain` is `reference`, on a few of
    the labels, scaled. Raises RenderError when `wanted` is gl and there is none.
    """
    settings = DlvSettings(near=NEAR, far=FAR, back_end=wanted)
    depths = depth_labels(settings.near, settings.far, settings.labels)
    grid, counts = _grid(side), _noise(side)
    light_field = _light_field(grid, counts)
    task = CostInputs.from_light_field(light_field, depths, settings)
    chosen = choose(wanted)
    ms = {'views': best_ms(lambda: _light_field(grid, counts), repeats),
          'planes': best_ms(lambda: CostInputs.from_light_field(light_field, depths, settings),
                            repeats)}
    ms |= (_gl_stages(task, settings, repeats) if chosen == 'gl' else
           {'sweep': _best_after_first(lambda: likelihood_of(task, settings), repeats)})

    def total() -> None:
        make_likelihood(_light_field(grid, counts), depths, settings)

    edge_depths = depth_labels(settings.near, settings.far, settings.edge_labels)
    ms['total'] = _best_after_first(total, repeats)
    ms['edges'] = _best_after_first(
        lambda: edge_volume(light_field, edge_depths, settings.views), repeats)
    fewer = settings.model_copy(update={'stride': 2})
    ms['layers'] = _best_after_first(lambda: fit_superposition(light_field, fewer), 1)
    ms['plain'] = _plain_ms(light_field, depths, settings)
    geometry = (f'{settings.views}x{settings.views} views of {side}x{side}, uint8, '
                f'{settings.labels} labels, {settings.near} to {settings.far} m, F01 at 0.55 m, '
                f'by {chosen}')
    return Bench(geometry, ms, ms['plain'] / ms['total'])


def _gl_stages(task: CostInputs, settings: DlvSettings, repeats: int) -> dict[str, float]:
    """Each stage waits for the GPU."""
    context = GlContext()
    try:
        gl_cost = GlCost(context)

        def upload() -> None:
            with gl_cost.upload(task, settings):
                context.gl.finish()

        ms = {'upload': _best_after_first(upload, repeats)}
        with gl_cost.upload(task, settings) as uploaded:
            def resident() -> GlArray:
                made = gl_cost.likelihood_of(uploaded)
                context.gl.finish()
                return made

            made = resident()
            ms['resident'] = best_ms(lambda: resident().release(), repeats)
            ms['read'] = best_ms(made.read, repeats)
    finally:
        context.close()
    return ms


def _plain_ms(light_field: LightField, depths: NDArray[np.float64], settings: DlvSettings
              ) -> float:
    """The bilinear reference, timed on a few of the labels, for all of them."""
    plain = settings.model_copy(update={'interpolation': 'bilinear'})
    few = depths[::len(depths) // _PLAIN_LABELS][:_PLAIN_LABELS]
    return len(depths) / len(few) * best_ms(lambda: log_likelihood(
        reference.cost_volume(light_field, few, plain).astype(np.float32)), 1)


def _best_after_first(step: Callable[[], object], repeats: int) -> float:
    """The first run, which compiles and fills caches, is not counted."""
    step()
    return best_ms(step, repeats)


def light_field_like_f01(side: int) -> LightField:
    """7x7 views of side x side pixels of noise."""
    return _light_field(_grid(side), _noise(side))


def _grid(side: int) -> ViewGrid:
    middle = (side - 1) / 2
    return ViewGrid(Pinhole(side, side, 945, 945, middle, middle), 0.00074,
                    nominal_positions(7, 7), np.ones((7, 7), np.float32))


def _noise(side: int) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, (7, 7, side, side, 3), np.uint8)


def _light_field(grid: ViewGrid, counts: NDArray[np.uint8]) -> LightField:
    """Of pictures as displays show them: their values are encoded."""
    return LightField(Header(), (counts / np.float32(255)) ** np.float32(1 / ENCODING), grid)
