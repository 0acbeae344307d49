"""One place that makes the headless OpenGL context, and says in words why it cannot.

A context belongs to the thread that made it: from another thread GL calls can be lost without an error.
"""

import logging
import threading

import moderngl

from pmcl_ros.errors import RenderError

_LOG = logging.getLogger(__name__)
_REMEDY = ('on Debian or Ubuntu: apt-get install libegl1 libgl1 libgl1-mesa-dri; '
           'in a container with an NVIDIA GPU, give it the graphics capability')


class GlContext:
    """A headless OpenGL 4.3 core context (EGL), bound to the thread that made it.

    Raises RenderError naming the missing library or driver and what to install.
    """

    def __init__(self) -> None:
        try:
            self.gl = moderngl.create_context(standalone=True, require=430, backend='egl')
        except Exception as error:  # moderngl and glcontext raise plain Exception for every cause
            raise RenderError(f'no headless OpenGL 4.3 context ({error}); {_REMEDY}') from error
        self.renderer: str = self.gl.info['GL_RENDERER']
        self._thread = threading.get_ident()
        _LOG.info('OpenGL renderer: %s', self.renderer)

    def check_thread(self) -> None:
        """Raise RenderError when called from a thread that does not own the context."""
        if threading.get_ident() != self._thread:
            raise RenderError('this OpenGL context belongs to another thread; make and use it in one thread')

    def close(self) -> None:
        """Release the context and everything that was made in it."""
        self.check_thread()
        self.gl.release()
