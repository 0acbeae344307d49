"""Which back end draws and scores, what is said of it, and that numba needs no OpenGL."""

import logging
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pmcl_scenes
import pytest
from pmcl_scenes import CAMERA, cup, model_of, random_poses

from pmcl_ros.pmcl.render import back_end
from pmcl_ros.pmcl.render.gl_renderer import GlRenderer
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import RenderError, SettingsError
from pmcl_ros.runtime.gl import choose_back_end, is_software

SCENE = Scene(model_of(cup()), CAMERA, Window(0, 0, (CAMERA.width, CAMERA.height)), 0.2, 0.8)


@pytest.fixture(autouse=True)
def _asked_for_the_first_time():
    choose_back_end.cache_clear()


def test_auto_goes_by_the_renderer_and_is_told_once(context, caplog):
    with caplog.at_level(logging.INFO, 'pmcl_ros'):
        renderers = [back_end.make_renderer('auto') for _ in range(2)]
    software = is_software(context.renderer)
    for each in renderers:
        assert isinstance(each, NumbaRenderer if software else GlRenderer)
        each.close()
    assert [line for line in caplog.messages if 'scored by' in line] == [
        f'poses are scored by {"numba" if software else "gl"}: '
        f'the OpenGL renderer is {context.renderer}']


@pytest.mark.parametrize(('wanted', 'kind'), [('gl', GlRenderer), ('numba', NumbaRenderer)])
def test_a_back_end_can_be_forced(wanted, kind, caplog):
    with caplog.at_level(logging.INFO, 'pmcl_ros'):
        renderer = back_end.make_renderer(wanted)
    assert isinstance(renderer, kind)
    renderer.close()
    assert f'poses are scored by {wanted}, as the settings say' in caplog.messages


def test_settings_know_three():
    assert PmclSettings().renderer == 'auto'
    with pytest.raises(SettingsError, match='renderer'):
        PmclSettings.make({'renderer': 'cuda'})


def test_gl_belongs_to_its_thread_and_numba_to_any():
    poses = random_poses(2, 0)
    gl, cpu = GlRenderer(), NumbaRenderer()
    with ThreadPoolExecutor(1) as pool:
        with pytest.raises(RenderError, match='belongs to another thread'):
            pool.submit(gl.depths, SCENE, poses).result()
        there = pool.submit(cpu.depths, SCENE, poses).result()
    np.testing.assert_array_equal(there, cpu.depths(SCENE, poses))
    gl.close()
    with pytest.raises(RenderError, match='has been closed'):
        gl.depths(SCENE, poses)


_WITHOUT_GL = """
import logging, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from pmcl_scenes import CAMERA, cup, model_of, random_poses
from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.geometry.header import Header
from pmcl_ros.pipeline import make_localizer
from pmcl_ros.pmcl.settings import PmclSettings
logging.basicConfig(level=logging.INFO, stream=sys.stdout)
depths = depth_labels(0.3, 0.6, 4)
shape = CAMERA.height, CAMERA.width, 4
tensor = np.random.default_rng(0).random((*shape, 3), np.float32)
edges = EdgeVolume(Header(), tensor * np.float32([1, 1, 0.1]), depths, CAMERA)
volume = DepthLikelihoodVolume(Header(), tensor[..., 0].copy(), depths, CAMERA)
for renderer in ('numba', 'auto', 'gl'):
    for mode in ('default', 'faithful'):
        settings = PmclSettings(mode=mode, renderer=renderer, roi_center=(0, 0, 0.4),
                                roi_size=(0.05, 0.05, 0.03), proposals=4, particles=16, moves=1,
                                faithful_iterations=1)
        try:
            with make_localizer(model_of(cup(), [0, 0, 1]), settings) as localizer:
                evidence = edges if mode == 'default' else volume
                localizer.localize(evidence, np.random.default_rng(0))
                print(renderer, mode, 'ended with', localizer.renderer)
        except RenderError as error:
            print(renderer, mode, 'refused:', error)
"""


def test_without_opengl_numba_localises_and_gl_is_refused():
    environment = os.environ | {'GLCONTEXT_LINUX_LIBEGL': '/nowhere/libEGL.so'}
    support = os.path.dirname(pmcl_scenes.__file__)
    said = subprocess.run([sys.executable, '-c', _WITHOUT_GL, support], env=environment,
                          check=True, capture_output=True, text=True).stdout
    before, after = said.split('poses are scored by numba: no headless OpenGL 4.3 context')
    assert 'OpenGL' not in before  # nobody has even asked for it
    for mode in ('default', 'faithful'):
        assert f'numba {mode} ended with numba' in before
        assert f'auto {mode} ended with numba' in after
        assert f'gl {mode} refused: no headless OpenGL 4.3 context (/nowhere/libEGL.so' in after
