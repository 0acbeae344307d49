"""Times of the depth likelihood volume."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv import cost, reference
from pmcl_ros.dlv.edges import edge_volume
from pmcl_ros.dlv.likelihood import log_likelihood
from pmcl_ros.dlv.matching import Matching
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.bench.machine import copied_bytes, multiply_adds
from pmcl_ros.evaluation.bench.result import Bench, best_ms
from pmcl_ros.header import Header
from pmcl_ros.lightfield.geometry import Pinhole, ViewGrid, nominal_positions
from pmcl_ros.lightfield.light_field import LightField


def bench_dlv(repeats: int = 7) -> Bench:
    """The volume of 7x7 views of 328x328, 75 labels, float32 views to float32 likelihood.

    The reference (numpy, exact bilinear slices) runs on 3 of the labels; its time is scaled. The
    bound is that of `least_work` for cost and likelihood together.
    """
    settings = DlvSettings(near=0.39, far=0.71)
    depths = depth_labels(settings.near, settings.far, settings.labels)
    light_field = _noise()
    costs = cost.cost_volume(light_field, depths, settings)  # compiles
    log_likelihood(costs)
    edge_depths = depth_labels(settings.near, settings.far, settings.edge_labels)
    edge_volume(light_field, edge_depths, settings.views)
    speeds = [(multiply_adds(), copied_bytes())]
    ms = {'cost': best_ms(lambda: cost.cost_volume(light_field, depths, settings), repeats),
          'likelihood': best_ms(lambda: log_likelihood(costs), repeats),
          'edges': best_ms(lambda: edge_volume(light_field, edge_depths, settings.views), repeats)}
    few, bilinear = depths[::len(depths) // 2], settings.model_copy(
        update={'interpolation': 'bilinear'})
    plain = best_ms(lambda: reference.cost_volume(light_field, few, bilinear), 1)
    ms['reference cost'] = plain * len(depths) / len(few)
    # The greatest speed counts: a busy machine makes the ratio too large rather than too small.
    speeds.append((multiply_adds(), copied_bytes()))
    counts = least_work(Matching.of(light_field, depths, settings), settings)
    ms['bound'] = 1e3 * max(counts / np.max(speeds, axis=0))
    geometry = (f'{settings.views}x{settings.views} views of 328x328, {settings.labels} labels, '
                f'{settings.near} to {settings.far} m, F01 at 0.55 m')
    return Bench(geometry, ms, ms['reference cost'] / ms['cost'],
                 ratio_to_bound=(ms['cost'] + ms['likelihood']) / ms['bound'])


def least_work(task: Matching, settings: DlvSettings) -> NDArray[np.float64]:
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

    The planes' encoding and smoothing are left out: they are a few per cent. The bytes are the
    views of linear colours read, and the likelihood written, once: all else could stay near the
    cores. The bound is the longer of the two: operations and bytes go side by side.
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
    seen = 4 * 3 * whole.width * whole.height * len(task.planes)
    return np.array([operations, seen + 4 * labels * len(task.wanted.rows)
                     * len(task.wanted.columns)], float)


def _noise() -> LightField:
    rng = np.random.default_rng(0)
    grid = ViewGrid(Pinhole(328, 328, 945, 945, 163.5, 163.5), 0.00074, nominal_positions(9, 9),
                    np.ones((9, 9), np.float32))
    return LightField(Header(), rng.random((9, 9, 328, 328, 3), np.float32), grid)
