"""How loops over pixels are compiled and called."""

import threading
from collections.abc import Callable
from typing import Any

from numba import njit

# numba's workqueue threading layer aborts the process when two threads enter parallel kernels.
LOCK = threading.Lock()

# Sums may be reordered and fused; NaN and infinities keep their meaning.
_FASTMATH = {'nsz', 'arcp', 'contract', 'afn', 'reassoc'}


def compiled(parallel: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit` as this package uses it: no GIL, the machine code kept on disk if it may be.

    numba caches in NUMBA_CACHE_DIR if that is set, else beside the source, else in the user's
    cache folder, and refuses to define a function where it may write to none of them: there the
    code is compiled again in every process.
    """
    def decorate(function: Callable[..., Any]) -> Any:
        try:
            return njit(nogil=True, cache=True, fastmath=_FASTMATH, parallel=parallel)(function)
        except RuntimeError:
            return njit(nogil=True, fastmath=_FASTMATH, parallel=parallel)(function)
    return decorate
