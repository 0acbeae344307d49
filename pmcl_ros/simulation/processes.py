"""Runs a function over many values in several processes, or on a Dask cluster."""

from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from typing import Any, TypeVar

from pmcl_ros.runtime.errors import PmclError

Value = TypeVar('Value')
Result = TypeVar('Result')


def run_all(function: Callable[[Value], Result], values: Sequence[Value], jobs: int = 1,
            backend: str = 'loky', scheduler: str | None = None) -> Iterator[Result]:
    """The result for each value as it is ready, in any order.

    jobs: processes; with 1 all is done here. backend: of joblib, 'loky' (processes of this
    machine) or 'dask' (workers of the cluster at the address `scheduler`, which see the same
    folders). Raises PmclError where a library lacks, or no scheduler answers.
    """
    if backend == 'loky' and jobs == 1:
        yield from map(function, values)
        return
    joblib = _library('joblib')
    options: dict[str, Any] = {'n_jobs': jobs, 'inner_max_num_threads': 1}
    if backend == 'dask':
        if not scheduler:
            raise PmclError('the backend dask needs the address of a scheduler, as '
                            '--scheduler tcp://HOST:8786')
        distributed = _library('distributed')
        try:
            distributed.Client(scheduler, timeout='10s')
        except OSError as error:
            raise PmclError(f'no Dask scheduler answers at {scheduler}: {error}') from error
        options = {}
    with joblib.parallel_config(backend=backend, **options):
        yield from joblib.Parallel(return_as='generator_unordered')(
            joblib.delayed(function)(each) for each in values)


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise PmclError(f'{name} is not installed: pip install joblib "dask[distributed]", or '
                        'use one process and no cluster') from error
