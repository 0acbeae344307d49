"""Times of the depth likelihood volume."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv import back_end
from pmcl_ros.dlv.cost import likelihood_of
from pmcl_ros.dlv.cost_inputs import CostInputs
from pmcl_ros.dlv.gl_cost import GlArray, GlCost
from pmcl_ros.dlv.planes import ENCODING
from pmcl_ros.dlv.settings import BackEnd, DlvSettings
from pmcl_ros.dlv.superposition import fit_superposition
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.bench import plain_dlv
from pmcl_ros.evaluation.bench.machine import copied_bytes, multiply_adds
from pmcl_ros.evaluation.bench.result import Bench, best_ms
from pmcl_ros.evidence.edges import edge_volume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, linear_views, nominal_positions
from pmcl_ros.runtime.gl import GlContext

_PLAIN_LABELS = 3  # that the plain form is run on: each takes it a third of a second


def bench_dlv(repeats: int = 7, wanted: BackEnd = 'numba', side: int = 328) -> Bench:
    """The volume of 7x7 views of side x side, 75 labels, uint8 views to float32 likelihood.

    Stages: `views`, from uint8 to a checked LightField; `planes`, what is matched (smoothed
    colours and gradients); then by numba `sweep`, from planes to likelihood, or by gl `upload`,
    `resident` (planes on the GPU to likelihood on the GPU) and `read`. `total` is all of it in one
    go, by the product's own functions; apart are `edges`, the edge volume, and `layers`, the joint
    fit of two layers to every other pixel, across and down. `plain` is `plain_dlv`
    from the same uint8, on a few of the labels, scaled; ratios are those of `total`, to `plain`
    and to the `bound` of `least_work`. Raises RenderError when `wanted` is gl and there is none.
    """
    settings = DlvSettings(near=0.39, far=0.71, back_end=wanted)
    depths = depth_labels(settings.near, settings.far, settings.labels)
    grid, counts = _grid(side), _noise(side)
    speeds = [(multiply_adds(), copied_bytes())]
    light_field = _light_field(grid, counts)
    task = CostInputs.of(light_field, depths, settings)
    chosen = back_end.choose(wanted)
    ms = {'views': best_ms(lambda: _light_field(grid, counts), repeats),
          'planes': best_ms(lambda: CostInputs.of(light_field, depths, settings), repeats)}
    ms |= (_gl_stages if chosen == 'gl' else _numba_stages)(task, settings, repeats)

    def total() -> None:
        back_end.make_likelihood(_light_field(grid, counts), depths, settings)

    edge_depths = depth_labels(settings.near, settings.far, settings.edge_labels)
    ms['total'] = _best_after_first(total, repeats)
    ms['edges'] = _best_after_first(
        lambda: edge_volume(light_field, edge_depths, settings.views), repeats)
    fewer = settings.model_copy(update={'stride': 2})
    ms['layers'] = _best_after_first(lambda: fit_superposition(light_field, fewer), 1)
    ms['plain'] = _plain_ms(grid, counts, depths, settings)
    # The greatest speed counts: a busy machine makes the ratio too large rather than too small.
    speeds.append((multiply_adds(), copied_bytes()))
    ms['bound'] = 1e3 * max(least_work(task, settings) / np.max(speeds, axis=0))
    geometry = (f'{settings.views}x{settings.views} views of {side}x{side}, uint8, '
                f'{settings.labels} labels, {settings.near} to {settings.far} m, F01 at 0.55 m, '
                f'by {chosen}')
    return Bench(geometry, ms, ms['plain'] / ms['total'],
                 ratio_to_bound=ms['total'] / ms['bound'])


def _numba_stages(task: CostInputs, settings: DlvSettings, repeats: int) -> dict[str, float]:
    return {'sweep': _best_after_first(lambda: likelihood_of(task, settings), repeats)}


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


def _plain_ms(grid: ViewGrid, counts: NDArray[np.uint8], depths: NDArray[np.float64],
              settings: DlvSettings) -> float:
    made: list[NDArray[np.float32]] = []
    few = depths[::len(depths) // _PLAIN_LABELS][:_PLAIN_LABELS]
    several = len(depths) // len(few)
    channels = plain_dlv.channels(counts)
    ms = best_ms(lambda: plain_dlv.channels(counts), 1)
    ms += several * best_ms(
        lambda: made.append(plain_dlv.costs(*channels, grid, few, settings)), 1)
    volume = np.repeat(made[0], several, axis=0)
    return ms + best_ms(lambda: plain_dlv.log_likelihood(volume), 1)


def _best_after_first(step: Callable[[], object], repeats: int) -> float:
    """The first run compiles, or makes what is kept."""
    step()
    return best_ms(step, repeats)


def least_work(task: CostInputs, settings: DlvSettings) -> NDArray[np.float64]:
    """(2,) float32 operations and bytes without which views do not become a likelihood.

    An operation is what a vector unit does in one instruction: a multiply-add, but also an
    addition, a product, a minimum, a division, a root (which in truth takes several times as
    long). Signs and loads are free. Counted are, with the exact numbers of pixels at which a pair
    counts, of nodes and of runs:

    - a sample of a channel at a node, 14: four pixels mixed down, three differences, a product,
      two multiply-adds, a sum (7), and the same across;
    - a channel's quadratic through three nodes, 8: three differences, two multiply-adds, three
      products;
    - a cell (pair, label, pixel): two multiply-adds for each of 5 channels, the colour distance (3
      and a root, or 2 sums), 3 truncations, 3 sums;
    - a label of a pixel: 4 for its window by running sums, where there is one, and 15 for its
      likelihood: maximum, sum, difference, product, logarithm by a series of 7 terms (11).

    The views' conversion, the planes' encoding and smoothing are left out. The bytes are the uint8
    views read, and the likelihood written, once: all else could stay near the cores. The bound is
    the longer of the two: operations and bytes go side by side.
    """
    labels, height, width = task.shape
    areas = np.prod(np.diff(task.inside.reshape(-1, 2, 2), axis=2), axis=(1, 2))
    where = task.runs.where
    # Of each run two nodes and, of the first in a row that share theirs, one more.
    shared = np.zeros(len(where), bool)
    shared[1:] = where[1:, 3] == where[:-1, 3] + 2
    nodes = int((areas[where[:, 0]] * np.where(shared, 2, 3)).sum())
    distance = 4 if settings.color_cost == 'l2' else 2
    operations = (5 * 14 * nodes + 5 * 8 * int(areas[where[:, 0]].sum())
                  + (5 * 2 + distance + 3 + 3) * labels * int(areas.sum())
                  + ((4 if task.half else 0) + 15) * labels * height * width)
    whole = task.lattice.whole
    seen = 3 * whole.width * whole.height * len(task.planes)
    return np.array([operations, seen + 4 * labels * len(task.wanted.rows)
                     * len(task.wanted.columns)], float)


def _grid(side: int) -> ViewGrid:
    middle = (side - 1) / 2
    return ViewGrid(Pinhole(side, side, 945, 945, middle, middle), 0.00074,
                    nominal_positions(7, 7), np.ones((7, 7), np.float32))


def _noise(side: int) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, (7, 7, side, side, 3), np.uint8)


def _light_field(grid: ViewGrid, counts: NDArray[np.uint8]) -> LightField:
    """Of pictures as displays show them: their values are encoded."""
    return LightField(Header(), linear_views(counts, 255) ** np.float32(1 / ENCODING), grid)
