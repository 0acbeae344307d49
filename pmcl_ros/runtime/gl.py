"""One place that makes the headless OpenGL context, and says in words why it cannot.

A context belongs to the thread that made it: from another thread GL calls can be lost without an
error.
"""

import logging
import threading
from functools import lru_cache
from typing import Any, Literal

import moderngl

from pmcl_ros.runtime.errors import RenderError

_LOG = logging.getLogger(__name__)
# Mesa's renderers that need no GPU, by their names; swrast calls itself the last.
_SOFTWARE = ('llvmpipe', 'softpipe', 'swr', 'software rasterizer')
_REMEDY = ('on Debian or Ubuntu: apt-get install libegl1 libgl1 libgl1-mesa-dri; '
           'in a container with an NVIDIA GPU, give it the graphics capability')


class GlContext:
    """A headless OpenGL 4.3 core context (EGL), bound to the thread that made it.

    A thread may have several: whatever works in one says `use()` first.
    Raises RenderError naming the missing library or driver and what to install.
    """

    def __init__(self) -> None:
        backend: dict[str, Any] = {'backend': 'egl'}
        try:
            self.gl = moderngl.create_context(require=430, standalone=True, **backend)
        except Exception as error:  # moderngl and glcontext raise plain Exception for every cause
            raise RenderError(f'no headless OpenGL 4.3 context ({error}); {_REMEDY}') from error
        self.renderer: str = self.gl.info['GL_RENDERER']
        self._thread = threading.get_ident()
        self._open = True
        _LOG.info('OpenGL renderer: %s', self.renderer)

    def use(self) -> None:
        """Make this context the one that GL calls go to.

        Raises RenderError in a thread that does not own it, and after `close`.
        """
        self._check_thread()
        if not self._open:
            raise RenderError('this OpenGL context has been closed; make a new one')
        context: Any = self.gl
        context.__enter__()  # moderngl has no other name for it

    def limit(self, name: str) -> int:
        """What this GL allows at most, by the limit's name in GL: 'GL_MAX_TEXTURE_SIZE'."""
        return int(self.gl.info[name])

    def close(self) -> None:
        """Release the context and everything that was made in it; a second time does nothing."""
        self._check_thread()
        if self._open:
            self._open = False
            with self.gl:
                pass  # leaves no context current: GL keeps a current one alive
            self.gl.release()

    def _check_thread(self) -> None:
        if threading.get_ident() != self._thread:
            raise RenderError('this OpenGL context belongs to another thread; '
                              'make and use it in one thread')


def is_software(renderer: str) -> bool:
    """Whether an OpenGL renderer of this name runs on the processor."""
    return any(each in renderer.lower() for each in _SOFTWARE)


@lru_cache
def choose_back_end(wanted: Literal['auto', 'gl', 'numba'], what: str
                    ) -> Literal['gl', 'numba']:
    """The back end that `wanted` stands for on this machine; logged when first asked.

    auto: gl where OpenGL runs on a GPU, else numba. what: is done by it, for the log.
    """
    if wanted != 'auto':
        _LOG.info('%s by %s, as the settings say', what, wanted)
        return wanted
    try:
        context = GlContext()
    except RenderError as error:
        _LOG.info('%s by numba: %s', what, error)
        return 'numba'
    context.close()
    chosen: Literal['gl', 'numba'] = 'numba' if is_software(context.renderer) else 'gl'
    _LOG.info('%s by %s: the OpenGL renderer is %s', what, chosen, context.renderer)
    return chosen
