"""One GL context for all the tests of the search, and a look at GL's errors after each."""

import pytest

from pmcl_ros.pmcl.gl import GlContext


@pytest.fixture(scope='session')
def _session_context():
    context = GlContext()
    yield context
    context.close()


@pytest.fixture
def context(_session_context):
    _session_context.use()
    assert _session_context.gl.error == 'GL_NO_ERROR'
    yield _session_context
    _session_context.use()
    assert _session_context.gl.error == 'GL_NO_ERROR'
