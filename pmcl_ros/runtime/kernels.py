"""How loops over pixels are compiled and called."""

import hashlib
import os
import threading
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
from numba import njit

# numba's workqueue threading layer aborts the process when two threads enter parallel kernels.
LOCK = threading.Lock()

# Sums may be reordered and fused; NaN and infinities keep their meaning.
_FASTMATH = {'nsz', 'arcp', 'contract', 'afn', 'reassoc'}
_PACKAGE = Path(__file__).parents[1]


def compiled(parallel: bool = False, inlined: bool = False
             ) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit` as this package uses it: no GIL, the machine code kept on disk if it may be.

    inlined: for what other kernels call and sums up numbers: it becomes a part of each of them.
    Else there are copies of it, which sum in different orders, and which of them runs depends on
    what was compiled in this process and what came from the disk: so would the last digits.
    """
    options: dict[str, Any] = {'nogil': True, 'fastmath': _FASTMATH, 'parallel': parallel,
                               'forceinline': inlined}

    def decorate(function: Callable[..., Any]) -> Any:
        folder, before = cache_folder(), numba.config.CACHE_DIR  # type: ignore[attr-defined]
        if folder is None:
            return njit(**options)(function)
        numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
        try:
            return njit(cache=True, **options)(function)
        except RuntimeError:  # a function without a file, as in a zip, has no place in the cache
            return njit(**options)(function)
        finally:
            numba.config.CACHE_DIR = before  # type: ignore[attr-defined]
    return decorate


@lru_cache
def cache_folder() -> Path | None:
    """Where machine code is kept: a folder of its own for each state of the kernels' sources.

    numba looks only whether the file of the function that is called has changed, not those of the
    functions that this one calls. In NUMBA_CACHE_DIR if that is set, else beside the source, else
    in the user's cache folder. None where none of them can be written: every process compiles.
    """
    name, home = f'kernels-{_stamp()}', Path(os.environ.get('XDG_CACHE_HOME') or '~/.cache')
    places = [_PACKAGE / '__pycache__', home.expanduser() / 'pmcl_ros']
    if given := os.environ.get('NUMBA_CACHE_DIR'):
        places = [Path(given)]
    for place in places:
        try:
            (place / name).mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(place / name, os.W_OK):
            return place / name
    return None


def _stamp() -> str:
    digest = hashlib.sha1(usedforsecurity=False)
    for path in sorted(_PACKAGE.rglob('*.py')):
        source = path.read_bytes()
        if b'compiled' in source:
            digest.update(source)
    return digest.hexdigest()[:12]
