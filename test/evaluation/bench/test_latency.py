"""From shutter to pose through the whole graph in one process, against the same without ROS."""

import numpy as np

from pmcl_ros.evaluation.bench.ros_programs import bench_graph


def test_the_graph_costs_little_more_than_the_same_without_ros():
    # What else runs on this machine may take the processor from one of the two and not from the
    # other: tried again then, and each ratio is the best of all tries. A node that sleeps, or
    # computes twice, never comes through.
    ratios = []
    while len(ratios) < 4 and not (ratios and (np.min(ratios, axis=0) < 1.15).all()):
        result = bench_graph(1, edges=True)
        assert result.captures == result.equal == 1
        assert set(result.ms) == set(result.cpu_ms) == {'graph', 'offline'}
        ratios.append((result.ratio, result.cpu_ratio))
    assert (np.min(ratios, axis=0) < 1.15).all(), ratios
