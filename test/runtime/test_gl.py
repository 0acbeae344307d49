"""The GL context: what it says when there is none, and whose it is."""

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.gl import GlContext

_MAKE = """
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.gl import GlContext
try:
    GlContext()
except RenderError as error:
    print(error)
"""


@pytest.mark.parametrize('library', ['EGL', 'GL'])
def test_a_missing_library_is_named_with_what_to_install(library):
    missing = f'/nowhere/lib{library}.so'
    environment = os.environ | {f'GLCONTEXT_LINUX_LIB{library}': missing}
    said = subprocess.run([sys.executable, '-c', _MAKE], env=environment, check=True,
                          capture_output=True, text=True).stdout
    assert f'{missing} not loaded' in said
    assert 'apt-get install libegl1 libgl1' in said


def test_the_renderer_has_a_name(context):
    assert context.renderer == context.gl.info['GL_RENDERER'] != ''


def test_another_thread_may_not_use_or_close_a_context(context):
    with ThreadPoolExecutor(1) as pool:
        for work in (context.use, context.close):
            with pytest.raises(RenderError, match='belongs to another thread'):
                pool.submit(work).result()
    context.use()


def test_a_context_made_in_a_thread_works_there(context):
    def work():
        made = GlContext()
        made.use()
        read = made.gl.buffer(np.arange(3, dtype='f4')).read()
        made.close()
        return threading.get_ident(), np.frombuffer(read, 'f4')

    with ThreadPoolExecutor(1) as pool:
        thread, values = pool.submit(work).result()
    assert thread != threading.get_ident()
    np.testing.assert_array_equal(values, [0, 1, 2])


def test_two_contexts_in_one_thread_keep_their_own():
    first, second = GlContext(), GlContext()
    buffers = []
    for context, value in ((first, 1), (second, 2)):
        context.use()
        buffers.append(context.gl.buffer(np.full(4, value, 'f4')))
    assert buffers[0].glo == buffers[1].glo  # the same name in each: mixing them up would show
    for context, buffer, value in ((first, buffers[0], 1), (second, buffers[1], 2)):
        context.use()
        np.testing.assert_array_equal(np.frombuffer(buffer.read(), 'f4'), value)
    second.close()
    first.use()
    np.testing.assert_array_equal(np.frombuffer(buffers[0].read(), 'f4'), 1)
    first.close()


def test_a_closed_context_says_so():
    context = GlContext()
    context.close()
    context.close()
    with pytest.raises(RenderError, match='has been closed'):
        context.use()
