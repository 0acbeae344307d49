"""From shutter to pose through the whole graph in one process, against the same without ROS."""

from pmcl_ros.evaluation.bench import bench_graph


def test_the_graph_costs_little_more_than_the_same_without_ros():
    result = bench_graph(3)
    assert result.captures == result.equal == 3
    assert set(result.ms) == set(result.cpu_ms) == {'graph', 'offline'}
    # The processor's time: what else runs on this machine hardly changes it.
    assert result.cpu_ratio < 1.3
