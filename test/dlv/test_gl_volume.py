"""A volume that stays in a GL context is the one that numba makes."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from dlv_fields import make_grid, noise_field

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.gl_cost import GlCost
from pmcl_ros.dlv.gl_volume import GlVolume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.runtime.errors import RenderError, VolumeError

FEW = {'labels': 25, 'edge_labels': 2, 'views': 3, 'back_end': 'numba'}


@pytest.fixture
def gl_cost(context):
    made = GlCost(context)
    yield made
    made.release()


@pytest.mark.parametrize('options', [
    {}, {'crop': (7, 5, 20, 13), 'window': 3}, {'stride': 2, 'interpolation': 'bilinear'},
], ids=str)
def test_it_is_the_volume_of_numba(gl_cost, options):
    field, settings = noise_field(make_grid(size=(60, 50))), DlvSettings(**FEW | options)
    expected = build_volume(field, settings)
    with GlVolume.of(gl_cost, field, settings) as volume:
        found = volume.read()
        assert volume.likelihood.shape == expected.likelihood.shape
    assert found.header is expected.header
    assert found.pinhole == expected.pinhole
    np.testing.assert_array_equal(found.depths, expected.depths)
    highest = expected.likelihood.max(axis=2, keepdims=True)
    assert (np.abs(found.likelihood - expected.likelihood) <= 1e-4 * highest).all()


def test_a_scorers_shader_reads_it_ray_by_ray(gl_cost, context):
    field = noise_field(make_grid(size=(30, 20)))
    program = context.gl.compute_shader("""
#version 430
layout(local_size_x = 1) in;
layout(std430, binding = 1) readonly buffer Volume { float likelihood[]; };
layout(std430, binding = 2) writeonly buffer Best { float best[]; };
uniform ivec2 size;  // width, labels
void main() {
    int ray = int(gl_GlobalInvocationID.y) * size.x + int(gl_GlobalInvocationID.x);
    float most = 0.0;
    for (int k = 0; k < size.y; ++k) most = max(most, likelihood[ray * size.y + k]);
    best[ray] = most;
}""")
    best = context.gl.buffer(reserve=4 * 30 * 20)
    with GlVolume.of(gl_cost, field, DlvSettings(**FEW)) as volume:
        volume.likelihood.bind(1)
        best.bind_to_storage_buffer(2)
        program['size'] = (30, 25)
        program.run(30, 20)
        context.gl.memory_barrier()
        found = np.frombuffer(best.read(), np.float32).reshape(20, 30)
        np.testing.assert_array_equal(found, volume.likelihood.read().max(axis=2))
    for each in (program, best):
        each.release()


def test_another_thread_may_not_have_it(gl_cost):
    field = noise_field(make_grid())
    with GlVolume.of(gl_cost, field, DlvSettings(**FEW)) as volume, ThreadPoolExecutor(1) as pool:
        for work in (volume.read, lambda: volume.likelihood.bind(0),
                     lambda: GlVolume.of(gl_cost, field, DlvSettings(**FEW))):
            with pytest.raises(RenderError, match='belongs to another thread'):
                pool.submit(work).result()


@pytest.mark.parametrize('options', [{'truncate': True}, {'interpolation': 'phase'}])
def test_what_the_gpu_has_no_form_for_is_refused(gl_cost, options):
    with pytest.raises(VolumeError, match='neither phase-shifted nor truncated; use build_volume'):
        GlVolume.of(gl_cost, noise_field(make_grid()), DlvSettings(**FEW | options))
