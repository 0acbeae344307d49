"""Times of the stages, against the plain form run beside them in the same process."""

from pmcl_ros.evaluation.bench.decode import bench_decode
from pmcl_ros.evaluation.bench.dlv import bench_dlv
from pmcl_ros.evaluation.bench.driver import DriverBench, bench_driver
from pmcl_ros.evaluation.bench.result import Bench

__all__ = ['Bench', 'DriverBench', 'bench_decode', 'bench_dlv', 'bench_driver']
