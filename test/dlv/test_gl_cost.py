"""The compute shaders against the plain form, and against numba: one task, three forms."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import moderngl
import numpy as np
import pytest
from dlv_fields import make_grid, noise_field, planes_field

from pmcl_ros.dlv import cost, reference
from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.gl_cost import GlArray, GlCost
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.runtime.errors import RenderError, VolumeError
from pmcl_ros.runtime.gl import GlContext


@pytest.fixture(scope='module')
def _programs(_session_context):
    """Compiled once: that takes longer than most tests."""
    _session_context.use()
    made = GlCost(_session_context)
    yield made
    _session_context.use()
    made.release()


@pytest.fixture
def gl_cost(context, _programs):
    return _programs


def likelihood_of(cost_volume):
    """The formula, in double precision."""
    share = (cost_volume.max(axis=0) - cost_volume) / cost_volume.sum(axis=0)
    return np.log1p(share).transpose(1, 2, 0)


def assert_same(gl_cost, field, depths, options):
    plain = reference.cost_volume(field, depths, options)
    numba = cost.cost_volume(field, depths, options)
    shader = gl_cost.cost_volume(field, depths, options)
    on_gpu = gl_cost.log_likelihood(field, depths, options)
    forms = [cost.likelihood_volume(field, depths, options), on_gpu.read()]
    on_gpu.release()
    for one, other in ((numba, plain), (shader, plain), (shader, numba)):
        assert (np.abs(one - other) <= 1e-5 * plain.max(axis=0)).all()
    exact = likelihood_of(plain)
    # a likelihood is a difference from the worst label's: relative to what it lies between
    tolerance = 1e-4 * exact.max(axis=2, keepdims=True)
    for one, other in ((forms[0], exact), (forms[1], exact), forms):
        assert (np.abs(one - other) <= tolerance).all()
        assert (one.argmax(axis=2) == other.argmax(axis=2)).mean() > 0.999


def dimmed(grid):
    weights = np.random.default_rng(1).uniform(0.1, 1, grid.shape).astype(np.float32)
    weights[grid.centre] = 1
    return replace(grid, weights=weights)


@pytest.mark.parametrize('interpolation', ['neutral', 'bilinear'])
@pytest.mark.parametrize('color_cost', ['l2', 'sad'])
@pytest.mark.parametrize('options', [
    {},
    {'window': 1, 'view_weights': 'equal', 'beta': 0.2},
    {'tau_color': 0.1, 'tau_gradient': 0.05, 'labels': 97},  # one more than a work group's
    {'crop': (7, 5, 20, 13)},
    {'crop': (3, 0, 0, 17), 'stride': 2},
    {'crop': (2, 3, 0, 0), 'stride': 4, 'window': 9},
], ids=str)
def test_the_three_forms_agree(gl_cost, options, color_cost, interpolation):
    settings = DlvSettings(**{'labels': 31, 'views': 3, 'color_cost': color_cost,
                              'interpolation': interpolation} | options)
    field = noise_field(dimmed(make_grid((3, 3), (41, 33), 0.012, 0.05)))
    assert_same(gl_cost, field, depth_labels(0.3, 0.9, settings.labels), settings)


@pytest.mark.parametrize(('views', 'size', 'baseline', 'jitter', 'labels'), [
    ((3, 3), (67, 20), 0.0025, 0, 15),  # within one cell; more than a line of a work group
    ((7, 7), (33, 29), 0.006, 0, 75),  # the proportions of a capture
    ((1, 5), (40, 9), 0.03, 0.3, 75),  # up to 20 px, rows not in line
    ((1, 3), (15, 1), 0.006, 0, 15),
])
def test_the_three_forms_agree_whatever_the_views(gl_cost, views, size, baseline, jitter, labels):
    field = noise_field(make_grid(views, size, baseline, jitter))
    assert_same(gl_cost, field, depth_labels(0.3, 0.9, labels), DlvSettings())


def test_the_three_forms_agree_on_two_planes(gl_cost):
    grid = make_grid((5, 5), (80, 40), 0.0006, 0.02, focal=(1000, 1000))
    field = planes_field(grid, 0.75, 0.4, 40)
    assert_same(gl_cost, field, depth_labels(0.3, 0.9, 40), DlvSettings())


@pytest.mark.parametrize('window', [1, 5, 9])
def test_the_three_forms_agree_where_labels_hardly_differ(gl_cost, window):
    """Noise in a capture's geometry: the range of a ray's costs is a thousandth of a cost."""
    for sigma in (None, 0.05):
        field = noise_field(make_grid((7, 7), (24, 20), 0.00074, focal=(945, 945)), sigma=sigma)
        assert_same(gl_cost, field, depth_labels(0.39, 0.71, 75), DlvSettings(window=window))


def test_pixels_without_cost_have_no_likelihood(gl_cost):
    field = noise_field(make_grid((3, 3), (20, 12), 0.006))
    field = replace(field, views=np.full_like(field.views, 0.5))
    made = gl_cost.log_likelihood(field, depth_labels(0.3, 0.9, 9), DlvSettings())
    assert (made.read() == 0).all()
    made.release()


def test_a_shader_reads_the_likelihood_where_it_is(gl_cost, context):
    field, depths = noise_field(make_grid()), depth_labels(0.3, 0.9, 7)
    made = gl_cost.log_likelihood(field, depths, DlvSettings())
    assert isinstance(made, GlArray)
    assert made.shape == (20, 24, 7)
    context.use()
    program = context.gl.compute_shader("""
#version 430
layout(local_size_x = 1) in;
layout(std430, binding = 0) readonly buffer Volume { float likelihood[]; };
layout(std430, binding = 1) writeonly buffer Sum { float total; };
void main() {
    float sum = 0.0;
    for (int i = 0; i < likelihood.length(); ++i) sum += likelihood[i];
    total = sum;
}""")
    total = context.gl.buffer(reserve=4)
    made.buffer.bind_to_storage_buffer(0)
    total.bind_to_storage_buffer(1)
    program.run()
    read = np.frombuffer(total.read(), np.float32)[0]
    np.testing.assert_allclose(read, made.read().sum(dtype=float), rtol=1e-4)
    for each in (program, total, made):
        each.release()


def resident():
    """Of this process [bytes]."""
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE')


def test_the_same_every_time_and_nothing_is_left_behind(gl_cost):
    field, depths = noise_field(make_grid((7, 7), (80, 80))), depth_labels(0.3, 0.9, 3)
    options = DlvSettings(crop=(30, 30, 8, 8))

    def make():
        made = gl_cost.log_likelihood(field, depths, options)
        values = made.read()
        made.release()
        with pytest.raises(VolumeError, match='reaches out of views'):
            gl_cost.log_likelihood(field, depths, DlvSettings(crop=(0, 0, 99, 0)))
        return values

    first = make()
    before = resident()
    for _ in range(20):
        np.testing.assert_array_equal(make(), first)
    planes = 4 * 49 * 5 * 80 * 80
    assert resident() - before < 10 * planes  # on software GL its memory is this process'


def test_nothing_is_left_of_a_volume_that_was_read():
    field, made = noise_field(make_grid(size=(80, 80))), []
    options = DlvSettings(labels=100, edge_labels=2, views=3, window=1, back_end='gl')
    for _ in range(12):
        size = build_volume(field, options).likelihood.nbytes
        made.append(resident())
    assert made[-1] - made[1] < 5 * size


def test_another_thread_is_refused(gl_cost):
    field, depths = noise_field(make_grid()), depth_labels(0.3, 0.9, 7)
    made = gl_cost.log_likelihood(field, depths, DlvSettings())
    with ThreadPoolExecutor(1) as pool:
        for work in (lambda: gl_cost.cost_volume(field, depths, DlvSettings()),
                     lambda: gl_cost.log_likelihood(field, depths, DlvSettings()), made.read):
            with pytest.raises(RenderError, match='belongs to another thread'):
                pool.submit(work).result()
    made.release()


def test_a_closed_context_is_told():
    own = GlContext()
    gl_cost = GlCost(own)
    own.close()
    with pytest.raises(RenderError, match='has been closed'):
        gl_cost.cost_volume(noise_field(make_grid()), depth_labels(0.3, 0.9, 7), DlvSettings())


def test_what_gl_cannot_hold_is_refused_with_a_remedy(gl_cost, context):
    most = context.limit('GL_MAX_SHADER_STORAGE_BLOCK_SIZE')
    labels = 1000
    side = int(np.sqrt(most / 4 / labels)) + 1
    if side > 400:
        pytest.skip('this GL holds more than a test should make')
    field = noise_field(make_grid((1, 3), (side, side), 0.006))
    with pytest.raises(RenderError, match=f'holds {most} at most; choose back_end numba'):
        gl_cost.cost_volume(field, depth_labels(0.3, 0.9, labels), DlvSettings())


def test_the_likelihood_is_an_array_of_the_caller(gl_cost):
    made = gl_cost.log_likelihood(noise_field(make_grid()), depth_labels(0.3, 0.9, 7),
                                  DlvSettings())
    assert isinstance(made.buffer, moderngl.Buffer)
    values = made.read()
    assert values.flags.writeable
    values[:] = -1
    assert (made.read() >= 0).all()
    made.release()
