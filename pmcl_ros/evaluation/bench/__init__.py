"""Times the stages against their plain forms, run beside them in the same process."""

from pmcl_ros.evaluation.bench.chain import ChainBench, bench_chain
from pmcl_ros.evaluation.bench.decode import bench_decode
from pmcl_ros.evaluation.bench.dlv import bench_dlv
from pmcl_ros.evaluation.bench.driver import DriverBench, bench_driver
from pmcl_ros.evaluation.bench.pmcl import PmclBench, bench_pmcl
from pmcl_ros.evaluation.bench.ros_programs import (
    GraphBench,
    TransportBench,
    bench_graph,
    bench_transport,
)
from pmcl_ros.evaluation.bench.timing import Bench

__all__ = ['Bench', 'ChainBench', 'DriverBench', 'GraphBench', 'PmclBench', 'TransportBench',
           'bench_chain', 'bench_decode', 'bench_dlv', 'bench_driver', 'bench_graph', 'bench_pmcl',
           'bench_transport']
