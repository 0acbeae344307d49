"""Times of the depth likelihood volume."""

import numpy as np

from pmcl_ros.dlv import cost, reference
from pmcl_ros.dlv.edges import edge_volume
from pmcl_ros.dlv.likelihood import log_likelihood
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.bench.result import Bench, best_ms
from pmcl_ros.header import Header
from pmcl_ros.lightfield.geometry import Pinhole, ViewGrid, nominal_positions
from pmcl_ros.lightfield.light_field import LightField


def bench_dlv(repeats: int = 7) -> Bench:
    """The volume of 7x7 views of 328x328, 75 labels, float32 views to float32 likelihood.

    The reference (numpy, exact bilinear slices) runs on 3 of the labels; its time is scaled.
    """
    settings = DlvSettings(near=0.39, far=0.71)
    depths = depth_labels(settings.near, settings.far, settings.labels)
    light_field = _noise()
    costs = cost.cost_volume(light_field, depths, settings)  # compiles
    log_likelihood(costs)
    edge_depths = depth_labels(settings.near, settings.far, settings.edge_labels)
    edge_volume(light_field, edge_depths, settings.views)
    ms = {'cost': best_ms(lambda: cost.cost_volume(light_field, depths, settings), repeats),
          'likelihood': best_ms(lambda: log_likelihood(costs), repeats),
          'edges': best_ms(lambda: edge_volume(light_field, edge_depths, settings.views), repeats)}
    few, bilinear = depths[::len(depths) // 2], settings.model_copy(
        update={'interpolation': 'bilinear'})
    plain = best_ms(lambda: reference.cost_volume(light_field, few, bilinear), 1)
    ms['reference cost'] = plain * len(depths) / len(few)
    geometry = (f'{settings.views}x{settings.views} views of 328x328, {settings.labels} labels, '
                f'{settings.near} to {settings.far} m, F01 at 0.55 m')
    return Bench(geometry, ms, ms['reference cost'] / ms['cost'])


def _noise() -> LightField:
    rng = np.random.default_rng(0)
    grid = ViewGrid(Pinhole(328, 328, 945, 945, 163.5, 163.5), 0.00074, nominal_positions(9, 9),
                    np.ones((9, 9), np.float32))
    return LightField(Header(), rng.random((9, 9, 328, 328, 3), np.float32), grid)
