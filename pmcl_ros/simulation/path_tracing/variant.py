"""Mitsuba, with the fastest variant that this machine can run."""

import logging
from functools import cache
from multiprocessing import parent_process
from types import ModuleType

from numba import config

from pmcl_ros.runtime.errors import SimulationError

_LOG = logging.getLogger(__name__)
_VARIANTS = {'llvm_ad_rgb': 'compiled for this processor by LLVM',
             'scalar_rgb': 'ray by ray, some ten times slower: no LLVM library was found '
             '(Debian, Ubuntu: apt install libllvm15 or newer)'}


@cache
def mitsuba() -> ModuleType:
    """The module, its variant set: `llvm_ad_rgb` where an LLVM library is found, else
    `scalar_rgb`. Which one is logged once, the slow one as a warning. It has as many threads as
    numba.

    Raises SimulationError where Mitsuba is not installed.
    """
    try:
        import drjit
        import mitsuba as module
    except ImportError:
        raise SimulationError('physically based pictures need Mitsuba 3: pip install '
                           "'pmcl_ros[simulate]'") from None
    has_llvm = drjit.has_backend(drjit.JitBackend.LLVM)
    name = next(name for name in _VARIANTS if has_llvm or not name.startswith('llvm'))
    module.set_variant(name)
    threads: int = config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    drjit.set_thread_count(threads)  # one in a process of a pool
    module.set_log_level(module.LogLevel.Error)
    warns = not has_llvm and parent_process() is None  # processes of a pool say it no more
    _LOG.log(logging.WARNING if warns else logging.INFO, 'Mitsuba %s, %s: %s',
             module.__version__, name, _VARIANTS[name])
    return module


def is_compiled() -> bool:
    """Whether `mitsuba` runs compiled by LLVM."""
    return str(mitsuba().variant()).startswith('llvm')
