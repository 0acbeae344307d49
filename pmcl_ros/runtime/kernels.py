"""Compiles kernels, the loops over pixels, keeps their machine code on disk, reports progress."""

import fcntl
import hashlib
import logging
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property, lru_cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import IO, Any

import numba
import numpy as np
from numba import config, njit
from numba.core import cgutils
from numba.core.caching import CompileResultCacheImpl, FunctionCache, NullCache
from numba.core.types import Array, BaseTuple, unliteral
from numba.extending import intrinsic

from pmcl_ros.runtime.kernel_threads import Threads

_LOG = logging.getLogger(__name__)

# Division by zero gives what it gives in numpy: a loop that may raise cannot be vectorised.
_COMMON: dict[str, Any] = {'nogil': True, 'error_model': 'numpy', 'no_cfunc_wrapper': True}
# Sums may be reordered and fused; NaN and infinities keep their meaning.
_FASTMATH = {'nsz', 'arcp', 'contract', 'afn', 'reassoc'}
_PACKAGE = Path(__file__).parents[1]
_PATIENCE = 60.0  # s: after that a kernel is compiled although another process holds its lock

Report = Callable[[str], None]
_KERNELS: 'list[Kernel]' = []
_REPORTS: list[Report] = []


def compiled(parallel: bool = False, inlined: bool = False, inner: bool = False,
             exact: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit` as this package uses it: no GIL, the machine code kept on disk if it may be.

    parallel: its last argument is its portion of the work, as of `rounds`, and `Threads` calls it.
    inlined: for what other kernels call and sums up numbers: it becomes a part of each of them.
    Else there are copies of it, which sum in different orders, and which of them runs depends on
    what was compiled in this process and what came from the disk: so would the last digits.
    inner: for what only other kernels call. A function for Python is not compiled, which saves
    time; from Python the kernel raises TypeError.
    exact: operations are neither reordered nor fused, so that the digits depend on nothing but the
    source, at some cost in speed. All that such a kernel calls must be exact too.
    """
    options: dict[str, Any] = _COMMON | {'fastmath': False if exact else _FASTMATH,
                                         'forceinline': inlined, 'no_cpython_wrapper': inner}

    def decorate(function: FunctionType) -> Any:
        if config.DISABLE_JIT:  # type: ignore[attr-defined]
            return Threads(function) if parallel else function
        dispatcher: Any = njit(**options)(function)
        dispatcher._cache = Kernel(function, (parallel, inlined, inner, exact))
        call_template = dispatcher.get_call_template

        def without_literals(arguments: Any, keywords: Any) -> Any:
            # numba would compile once for each literal integer that a kernel passes.
            return call_template(tuple(map(unliteral, arguments)), keywords)

        dispatcher.get_call_template = without_literals
        if inner:
            _close(dispatcher)
        return Threads(dispatcher) if parallel else dispatcher
    return decorate  # type: ignore[return-value]


def _close(dispatcher: Any) -> None:
    """Refuse calls from Python: numba would jump to the function that was not compiled."""
    def add_overload(result: Any) -> None:
        dispatcher.overloads[tuple(result.signature.args)] = result

    def refuse(*_: object) -> None:
        raise TypeError(f'the kernel {dispatcher.py_func.__qualname__} is for other kernels only; '
                        'compile it without `inner` to call it from Python')

    dispatcher.add_overload, dispatcher._compile_for_args = add_overload, refuse


@lru_cache
def cache_folder() -> Path | None:
    """The folder that machine code is kept in.

    NUMBA_CACHE_DIR if that is set, else beside the source, else in the user's cache folder.
    None, with a warning, where none of them can be written: every process compiles.
    """
    places = [_PACKAGE / '__pycache__',
              Path(os.environ.get('XDG_CACHE_HOME') or '~/.cache').expanduser() / 'pmcl_ros']
    if given := os.environ.get('NUMBA_CACHE_DIR'):
        places = [Path(given)]
    for place in places:
        folder = place / 'kernels'
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder
    _LOG.warning('compiled kernels cannot be kept, as %s cannot be written: every process '
                 'compiles them anew; set NUMBA_CACHE_DIR to a folder that can be written',
                 ' and '.join(str(place) for place in places))
    return None


def report_to(report: Report) -> None:
    """Call `report` with the name of each kernel that is about to be compiled, in any thread."""
    _REPORTS.append(report)


@contextmanager
def reporting(report: Report) -> Iterator[None]:
    """`report_to`, as long as the context lasts."""
    report_to(report)
    try:
        yield
    finally:
        _REPORTS.remove(report)


def progress(names: str | tuple[str, ...] = '') -> tuple[int, int]:
    """How many kernels of the modules imported so far are on disk, and how many there are.

    names: what the names of those that count begin with.
    """
    kernels = _named(names)
    return sum(each.kept for each in kernels), len(kernels)


def digest(names: str | tuple[str, ...]) -> str:
    """Of what the machine code of kernels depends on. names: as of `progress`."""
    keys = ''.join(sorted(each.key for each in _named(names)))
    return hashlib.sha1(keys.encode(), usedforsecurity=False).hexdigest()[:16]


def _named(names: str | tuple[str, ...]) -> 'list[Kernel]':
    return [each for each in _KERNELS if each.name.startswith(names)]


class Kernel(NullCache):
    """Machine code of one kernel on disk, as numba's dispatcher asks for it.

    Its place follows from what the code depends on: its own byte code and constants, and those of
    the kernels it calls. An edit recompiles what depends on it, whatever the folder of the source.
    Of several processes that need a kernel one compiles it; the others wait for its code.
    """

    def __init__(self, function: FunctionType, options: object) -> None:
        self.name = f'{function.__module__.removeprefix("pmcl_ros.")}.{function.__qualname__}'
        self._function, self._options = function, options
        self._lock: IO[bytes] | None = None
        _KERNELS.append(self)

    @cached_property
    def key(self) -> str:
        """Digest of all that the machine code depends on, but for the types of its arguments."""
        # One version of numba takes an index of another for an empty one, and writes over it.
        options = numba.__version__, self.name, self._options, sorted(_FASTMATH), _COMMON
        digest = hashlib.sha1(repr(options).encode(), usedforsecurity=False)
        names: set[str] = set()
        for code in _codes(self._function.__code__):
            constants = [each for each in code.co_consts
                         if not isinstance(each, CodeType) and each != self._function.__doc__]
            digest.update(code.co_code + repr((constants, code.co_names)).encode())
            names.update(code.co_names)
        for name in sorted(names & self._function.__globals__.keys()):
            digest.update(f'{name}={_described(self._function.__globals__[name])};'.encode())
        return digest.hexdigest()[:16]

    @property
    def kept(self) -> bool:
        """Whether there is machine code of it on disk, for some types of arguments."""
        return self._disk is not None and self._disk.index.exists()

    @cached_property
    def _disk(self) -> '_Disk | None':
        folder = cache_folder()
        return None if folder is None else _Disk(self._function, folder, self.key)

    # numba's interface

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for these types, or None: then numba compiles it and calls `save_overload`."""
        found = None
        if self._disk is not None:
            found = self._disk.load_overload(sig, target_context)
            if found is None and self._acquire(self._disk.lock):
                found = self._disk.load_overload(sig, target_context)
        if found is None:
            for report in tuple(_REPORTS):
                report(self.name)
        else:
            self._release()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled."""
        try:
            if self._disk is not None:
                self._disk.save_overload(sig, data)
        except OSError as error:
            _LOG.warning('cannot keep the compiled kernel %s: %s', self.name, error)
        finally:
            self._release()

    def _acquire(self, path: Path) -> bool:
        """Wait until no other process compiles this kernel; False where that was done before."""
        if self._lock is not None:  # compiling failed, and is tried with other types
            return False
        deadline = time.monotonic() + _PATIENCE
        with suppress(OSError):
            self._lock = path.open('wb')
            while time.monotonic() < deadline:
                try:
                    fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    time.sleep(0.02)
        return True

    def _release(self) -> None:
        if self._lock is not None:
            Path(self._lock.name).unlink(missing_ok=True)
            self._lock.close()
            self._lock = None


class _Disk(FunctionCache):
    """numba's files of one function, under a name that says what they were made from."""

    def __init__(self, function: FunctionType, folder: Path, key: str) -> None:
        class Locator:
            """Where the files are; numba makes one by `from_function`."""

            def get_cache_path(self) -> str:
                return str(folder)

            def ensure_cache_path(self) -> None:
                folder.mkdir(parents=True, exist_ok=True)

            def get_source_stamp(self) -> str:
                return key

            def get_disambiguator(self) -> str:
                return key

            @classmethod
            def from_function(cls, *_: object) -> 'Locator':
                return cls()

        class Implementation(CompileResultCacheImpl):
            def __init__(self, function: FunctionType) -> None:
                locators: list[Any] = [Locator]
                self._locator_classes = locators
                super().__init__(function)

        self._impl_class = Implementation
        super().__init__(function)
        self.index = folder / f'{self._impl.filename_base}.nbi'
        self.lock = self.index.with_suffix('.lock')

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for these types, or None; an index of types that are gone is emptied."""
        try:
            return super().load_overload(sig, target_context)
        except (ImportError, AttributeError):  # a type of an argument was moved or renamed
            self.flush()
            return None

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        # numba compares named tuples without the names of their fields.
        return *super()._index_key(sig, codegen), tuple(_fields(sig))


@compiled(inlined=True)
def rounds(count, portion):  # type: ignore[no-untyped-def]
    """Those of `count` rounds of a loop that are a portion of the work: (number, of how many)."""
    number, of = portion
    return range(count * number // of, count * (number + 1) // of)


def borrowed(arrays: Any) -> Any:
    """In a kernel: an array, or those of a tuple, without their owners.

    The kernel's caller keeps these alive. Where an owned array is sliced or handed on, its owner's
    references are counted up and down, atomically. In the loops that draw and score a pose this
    took as long as the drawing, and in those that trace rays nearly as long as the rest.
    """
    return arrays


def _without_owner(_: Any, arrays: Any) -> Any:
    def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
        return _not_owned(context, builder, arrays, values[0])
    return arrays(arrays), generate


def _not_owned(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, Array):
        made = context.make_array(kind)(context, builder, value)
        made.meminfo = cgutils.get_null_value(made.meminfo.type)
        made.parent = cgutils.get_null_value(made.parent.type)
        return made._getvalue()
    if isinstance(kind, BaseTuple):
        kinds: Any = kind
        return context.make_tuple(builder, kind, [
            _not_owned(context, builder, *each)
            for each in zip(kinds, cgutils.unpack_tuple(builder, value), strict=True)])
    return value


if not config.DISABLE_JIT:  # type: ignore[attr-defined]
    borrowed = intrinsic(_without_owner)  # type: ignore[assignment]


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield from _codes(each)


def _described(value: object) -> str:
    """What a kernel's machine code depends on of a global name's value."""
    kernel = getattr(value, '_cache', None)
    if isinstance(kernel, Kernel):
        return kernel.key
    if isinstance(value, np.ndarray):
        return f'{value.dtype}{value.shape}{value.tobytes()!r}'
    if isinstance(value, tuple):
        return ','.join(map(_described, value))
    if isinstance(value, ModuleType | type) or callable(value):
        return f'{getattr(value, "__module__", "")}.{getattr(value, "__name__", "")}'
    return repr(value)


def _fields(types: Any) -> Iterator[tuple[str, ...]]:
    for each in types:
        if isinstance(each, BaseTuple):
            yield getattr(each, 'fields', ())
            yield from _fields(each)
