from concurrent.futures import ThreadPoolExecutor

import numpy as np
from dlv_fields import make_grid, noise_field

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.kernels import compiled


def test_compiles_where_nothing_can_be_cached():
    names = {}
    exec('def twice(x): return 2 * x', names)  # a function without a file has no cache
    assert compiled()(names['twice'])(21) == 42


def test_two_threads_may_build_at_once():
    fields = [noise_field(make_grid((3, 3), (40, 32), 0.006), seed) for seed in range(4)]
    options = DlvSettings(labels=9, views=3, edge_labels=3, truncate=True)
    alone = [build_volume(field, options).likelihood for field in fields]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda field: build_volume(field, options).likelihood, fields))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)
