"""A volume that stays in the localizer's GL context gives the poses of the same one in memory."""

from dataclasses import replace

import numpy as np
import pytest
from pmcl_scenes import CAMERA, cup, model_of

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.gl_volume import GlVolume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.pmcl.contour_evidence import scene
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.motion import uniform_poses
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.resident import volume_for
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import RenderError, VolumeError

CUP = model_of(cup(), [0, 0, 1])
SEARCH = PmclSettings(roi_center=(0, 0, 0.4), roi_size=(0.1, 0.1, 0.1), renderer='gl', proposals=4,
                      particles=16, moves=1, faithful_particles=30, faithful_iterations=3,
                      faithful_threshold=9.0)
VOLUME = DlvSettings(near=0.27, far=0.53, labels=24, edge_labels=8, views=3, back_end='gl')
FAITHFUL = {'mode': 'faithful'}


@pytest.fixture(scope='module')
def light_field():
    views = np.random.default_rng(0).random((3, 3, CAMERA.height, CAMERA.width, 3), np.float32)
    grid = ViewGrid(CAMERA, 0.001, nominal_positions(3, 3), np.ones((3, 3), np.float32))
    return LightField(Header(stamp_ns=5), views, grid)


@pytest.mark.parametrize('mode', ['faithful', 'default'])
def test_poses_are_those_of_the_volume_in_memory(light_field, mode):
    with Localizer(CUP, SEARCH.model_copy(update={'mode': mode})) as localizer:
        with volume_for(localizer, light_field, VOLUME) as resident:
            assert isinstance(resident, GlVolume)
            assert resident.likelihood.context is localizer.context
            first = localizer.localize(resident, np.random.default_rng(1))
            again = localizer.localize(resident, np.random.default_rng(1))
            copy = resident.read()
        found = localizer.localize(copy, np.random.default_rng(1))
    for other in (again, found):
        np.testing.assert_array_equal(first.pose, other.pose)
        np.testing.assert_array_equal(first.particles, other.particles)
        assert first.score == other.score
    assert first.header.stamp_ns == 5
    assert first.evaluations == found.evaluations > 0


def test_scores_are_those_of_numbas_volume_to_four_digits(light_field):
    region = Region(SEARCH.roi_center, SEARCH.roi_size)
    poses = uniform_poses(region, 40, np.random.default_rng(3))
    plain = build_volume(light_field, VOLUME.model_copy(update={'back_end': 'numba'}))
    with Localizer(CUP, SEARCH.model_copy(update=FAITHFUL)) as gl, \
            Localizer(CUP, SEARCH.model_copy(update={'renderer': 'numba'} | FAITHFUL)) as numba:
        assert numba.context is None
        with volume_for(gl, light_field, VOLUME) as resident:
            for localizer in (gl, numba):  # the latter reads a copy
                scores = []
                for volume in (resident, plain):
                    drawn = scene(CUP, region, CAMERA, region.window(CAMERA, CUP.radius))
                    with localizer._renderer.likelihood_score(drawn, volume) as score:
                        scores.append(score(poses))
                        assert score.evaluations == len(poses)
                np.testing.assert_allclose(*scores, rtol=1e-4)
                assert np.ptp(scores[0]) > 0.05 * scores[0].mean()


@pytest.mark.parametrize('change', [{'truncate': True}, {'back_end': 'numba'},
                                    {'layers': 'joint', 'stride': 4}], ids=str)
def test_what_cannot_stay_on_the_gpu_is_made_in_memory(light_field, change):
    wanted = VOLUME.model_copy(update=change)
    with Localizer(CUP, SEARCH) as localizer, volume_for(localizer, light_field, wanted) as volume:
        assert isinstance(volume, DepthLikelihoodVolume)


def test_errors_are_those_of_a_volume_in_memory(light_field):
    dark = replace(light_field.grid, weights=np.zeros((3, 3), np.float32))
    with Localizer(CUP, SEARCH) as localizer, pytest.raises(VolumeError), volume_for(
            localizer, replace(light_field, grid=dark), VOLUME):
        pass
    with pytest.raises(RenderError, match='has been closed'), volume_for(
            localizer, light_field, VOLUME):
        pass
