"""Which back end makes a volume, what is said of it; for the values it does not matter."""

import logging
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from dlv_fields import make_grid, noise_field

from pmcl_ros.dlv.build import build_volume, warm_up
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.gl import choose_back_end, is_software

FEW = {'labels': 9, 'edge_labels': 3, 'views': 3}


@pytest.fixture(autouse=True)
def _asked_for_the_first_time():
    choose_back_end.cache_clear()


@pytest.mark.parametrize(('renderer', 'software'), [
    ('llvmpipe (LLVM 15.0.6, 256 bits)', True), ('softpipe', True), ('Software Rasterizer', True),
    ('SWR (LLVM 9.0, 256 bits)', True), ('NVIDIA H200/PCIe/SSE2', False),
    ('Mesa Intel(R) UHD Graphics 620 (KBL GT2)', False),
    ('AMD Radeon RX 6800 (radeonsi, navi21, LLVM 15.0.6, DRM 3.49)', False)])
def test_a_gpu_is_known_by_its_name(renderer, software):
    assert is_software(renderer) == software


def test_auto_goes_by_the_renderer_and_is_told_once(context, caplog):
    field = noise_field(make_grid())
    with caplog.at_level(logging.INFO, 'pmcl_ros'):
        build_volume(field, DlvSettings(**FEW))
        build_volume(field, DlvSettings(**FEW))
    expected = 'numba' if is_software(context.renderer) else 'gl'
    assert [each.getMessage() for each in caplog.records if 'made by' in each.getMessage()] == [
        f'volumes are made by {expected}: the OpenGL renderer is {context.renderer}']


def test_forced_back_ends_give_the_same_in_any_thread(caplog):
    field = noise_field(make_grid(size=(40, 30)))
    options = [DlvSettings(**FEW, truncate=True, back_end=each) for each in ('numba', 'gl')]
    with caplog.at_level(logging.INFO, 'pmcl_ros'):
        numba, here = (build_volume(field, each) for each in options)
    assert 'volumes are made by gl, as the settings say' in caplog.messages
    with ThreadPoolExecutor(2) as pool:
        there = list(pool.map(lambda _: build_volume(field, options[1]), range(4)))
    for volume in (here, *there):
        np.testing.assert_allclose(volume.likelihood, numba.likelihood,
                                   atol=1e-4 * numba.likelihood.max())
        np.testing.assert_array_equal(volume.likelihood, here.likelihood)
        np.testing.assert_allclose(volume.depth_map(), numba.depth_map(), rtol=1e-2)


def test_phase_has_no_form_for_gl():
    with pytest.raises(SettingsError, match='interpolation phase has no form for back_end gl'):
        DlvSettings.make({'interpolation': 'phase', 'back_end': 'gl'})


@pytest.mark.parametrize('wanted', ['numba', 'gl'])
def test_warm_up_is_for_the_back_end_that_will_be_used(wanted):
    warm_up(wanted)
    assert choose_back_end.cache_info().currsize == 1


_BUILD = """
import logging
import sys
import numpy as np
from pmcl_ros.dlv.build import warm_up
from pmcl_ros.runtime.errors import RenderError
logging.basicConfig(level=logging.INFO, stream=sys.stdout)
for each in ('auto', 'gl'):
    try:
        warm_up(each)
        print(each, 'made')
    except RenderError as error:
        print(each, 'refused:', error)
"""


def built(**environment):
    """What a process of its own says, which ends by itself and well."""
    return subprocess.run([sys.executable, '-c', _BUILD], env=os.environ | environment, check=True,
                          timeout=600, capture_output=True, text=True).stdout


def test_without_gl_auto_is_numba_and_gl_is_refused():
    said = built(GLCONTEXT_LINUX_LIBEGL='/nowhere/libEGL.so')
    assert 'volumes are made by numba: no headless OpenGL 4.3 context' in said
    assert 'auto made' in said
    assert 'gl refused: no headless OpenGL 4.3 context (/nowhere/libEGL.so not loaded)' in said


def test_a_process_that_made_volumes_by_gl_ends():
    said = built()
    assert 'auto made' in said
    assert 'gl made' in said
