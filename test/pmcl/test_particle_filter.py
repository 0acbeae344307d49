"""The paper's filter, on likelihoods made up and rendered."""

import numpy as np
import pytest
from pmcl_scenes import cup, depth_of, model_of, random_poses, surface_seen

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.pmcl.particle_filter import ParticleFilterLocalizer, particle_filter
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.settings import PmclSettings

CAMERA = Pinhole(97, 81, 300, 290, 50, 41)
CUP = model_of(cup(), [0, 0, 1])
REGION = Region((0, 0, 0.5), (0.2, 0.2, 0.2))


def run(score, progress=lambda _: True, seed=0, **options):
    options = {'faithful_particles': 30, 'faithful_iterations': 10} | options
    calls = []

    def counted(poses):
        calls.append(poses.copy())
        return score(poses)

    settings = PmclSettings(mode='faithful', **options)
    result = particle_filter(counted, REGION, settings, np.random.default_rng(seed), progress)
    return *result, calls


def test_it_starts_uniform_in_the_region_and_ends_at_once_above_the_threshold():
    poses, scores, calls = run(lambda poses: np.full(len(poses), 0.02))
    assert len(calls) == 1
    np.testing.assert_array_equal(poses, calls[0])
    np.testing.assert_array_equal(scores, 0.02)
    assert REGION.contains(poses[:, :3, 3]).all()
    assert len(poses) == 30


@pytest.mark.parametrize('value', [2 ** -7, 0.0])  # the threshold itself is not above it
def test_it_ends_after_its_iterations(value):
    parts = []
    _, _, calls = run(lambda poses: np.full(len(poses), value),
                      lambda part: parts.append(part) is None, faithful_threshold=2 ** -7)
    assert len(calls) == 11
    np.testing.assert_allclose(parts, np.arange(10) / 10)


def test_progress_ends_it_early():
    poses, scores, calls = run(lambda poses: poses[:, 0, 3] ** 2, lambda part: part < 0.25,
                               faithful_threshold=9)
    assert len(calls) == 4
    np.testing.assert_array_equal(poses, calls[-1])
    np.testing.assert_array_equal(scores, poses[:, 0, 3] ** 2)


def test_it_ends_as_soon_as_the_mean_passes_the_threshold():
    def score(poses):
        return np.exp(-0.5 * (np.linalg.norm(poses[:, :3, 3] - [0.05, 0, 0.5], axis=1)
                              / 0.03) ** 2)

    _, scores, calls = run(score, faithful_particles=300, faithful_iterations=500,
                           faithful_threshold=0.6)
    means = [score(poses).mean() for poses in calls]
    assert means[-1] == scores.mean() > 0.6
    assert max(means[:-1]) <= 0.6
    assert 3 < len(calls) < 100


def test_without_motion_particles_only_double():
    poses, _, calls = run(lambda poses: np.where(np.arange(len(poses)) == 4, 1.0, 0),
                          faithful_iterations=1, faithful_threshold=1,
                          faithful_sigma_translation=1e-12, faithful_sigma_rotation=1e-12)
    np.testing.assert_allclose(poses, np.tile(calls[0][4], (30, 1, 1)), atol=1e-9)


@pytest.mark.parametrize('seed', range(3))
def test_it_finds_the_rendered_surface(context, seed):
    truth = random_poses(1, seed, depth=(0.4, 0.45), aside=0.01)[0]
    depths = depth_labels(0.3, 0.6, 40)
    volume = surface_seen(depth_of(context, CUP, truth, CAMERA), CAMERA, depths, 2)
    settings = PmclSettings(
        mode='faithful', roi_center=tuple(truth[:3, 3] + [0.004, -0.003, 0.005]),
        roi_size=(0.04, 0.04, 0.04), faithful_iterations=30, faithful_threshold=0.9,
        faithful_sigma_translation=0.003, faithful_sigma_rotation=0.15)
    with ParticleFilterLocalizer(CUP, settings) as localizer:
        estimate = localizer.localize(volume, np.random.default_rng(seed))
    error = pose_error(estimate.pose, truth, CUP.symmetry)
    assert error.translation < 0.008
    # The mean likelihood hardly knows the object from its flip (paper, section VI).
    assert min(error.rotation, np.pi - error.rotation) < np.deg2rad(20)
    assert estimate.score > 0.7
    assert not estimate.lost
    assert estimate.mode == 'faithful'
    assert np.exp(estimate.log_weights).sum() == pytest.approx(1)
    # Particles that left the region in the last step have no weight; some have.
    outside = ~Region(settings.roi_center, settings.roi_size).contains(
        estimate.particles[:, :3, 3])
    assert outside.any()
    np.testing.assert_array_equal(np.isneginf(estimate.log_weights[outside]), True)
    assert np.isfinite(estimate.log_weights[~outside]).any()


def test_where_no_ray_supports_it_the_object_is_lost():
    volume = surface_seen(np.zeros((81, 97)), CAMERA, depth_labels(0.3, 0.6, 5))
    settings = PmclSettings(mode='faithful', roi_center=(0, 0, 0.45), faithful_iterations=2)
    with ParticleFilterLocalizer(CUP, settings) as localizer:
        estimate = localizer.localize(volume, np.random.default_rng(0))
    assert estimate.lost
    assert estimate.score == 0
    assert np.isfinite(estimate.covariance).all()
