"""The search near a prior, on evidence of which modes and posterior are known."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from pmcl_scenes import bracket, model_of, pose_of
from quadratic_evidence import assert_sampled, deviations, mode_at, value_about
from scipy.spatial.transform import Rotation

from pmcl_ros.pmcl.modes import ambiguous_poses
from pmcl_ros.pmcl.posterior import ContourPosterior, Mode
from pmcl_ros.pmcl.sampler import Gaussian
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.tracking.local_search import sample_near
from pmcl_ros.pmcl.tracking.near_prior import NearPrior

BRACKET = model_of(bracket())
HERE = pose_of(Rotation.from_euler('xyz', [0.4, -0.3, 0.8]), [0.01, -0.02, 0.45])
PRIOR = Gaussian.from_covariance(HERE, np.diag(np.repeat([0.02, 0.1], 3) ** 2), BRACKET.symmetry)
SIGMA = np.array([0.003, 0.002, 0.004, 0.02, 0.02, 0.03])


def aside(*by):
    """A pose moved from the prior's [m]."""
    pose = HERE.copy()
    pose[:3, 3] += by
    return pose


def no_points(_):
    raise AssertionError('the search needs no points of a contour')


@dataclass(frozen=True)
class About:
    """The evidence about one mode, as `LinearizedContour`."""

    mode: Mode

    def evidence(self, off):
        return value_about(self.mode, off)


@dataclass(frozen=True)
class Peaks:
    """The largest of the evidence of several modes."""

    modes: list[Mode]

    def _about(self, poses):
        return np.stack([value_about(each, deviations(poses, each)) for each in self.modes])

    def evidence(self, poses):
        return self._about(poses).max(axis=0)

    def nearest(self, pose):
        return self.modes[self._about(pose[None])[:, 0].argmax()]

    def refined(self, poses):
        poses = np.stack([self.nearest(each).pose for each in poses]) if len(poses) else poses
        return poses, self.evidence(poses)

    def near(self, feasible, count=100):
        return NearPrior(BRACKET, lambda _: self.evidence, self.refined, self.refined,
                         self.nearest, feasible, count)


def everywhere(poses):
    return np.ones(len(poses), bool)


def found(peaks, feasible=everywhere, count=100):
    modes = peaks.near(feasible, count).modes(PRIOR, np.random.default_rng(0))
    return [next(number for number, each in enumerate(peaks.modes) if each is mode)
            for mode in modes]


def sampled(near, posterior, prior, count):
    rng = np.random.default_rng(1)
    return sample_near(posterior, prior, near.modes(prior, rng), count, rng)


def test_the_two_likeliest_modes_by_evidence_and_prior_are_found_and_the_most_evident_is_first():
    assert found(Peaks([mode_at(aside(x, 0, 0), value, SIGMA) for x, value in (
        (0.0, 10.0), (0.02, 10.3), (-0.05, 12.0))])) == [1, 0]


def test_a_mode_in_which_nothing_is_in_view_is_none():
    mode = mode_at(HERE, 10.0, SIGMA)
    blind = replace(mode, local=replace(mode.local, length=0.0))
    assert found(Peaks([mode])) == [0]
    assert found(Peaks([blind])) == []
    # a step of the last refinement that leads out of the region
    beyond = replace(Peaks([mode]).near(everywhere), feasible=lambda poses: ~np.isclose(
        poses[:, 0, 3], HERE[0, 3] + 0.001), mode=lambda _: replace(mode, pose=aside(0.001, 0, 0)))
    assert beyond.modes(PRIOR, np.random.default_rng(0)) == []


def test_the_middle_of_the_prior_is_always_tried():
    peaks = Peaks([mode_at(HERE, 10.0, SIGMA)])
    assert found(peaks, lambda poses: np.abs(deviations(poses, peaks.modes[0])).max(axis=1) < 1e-9,
                 count=1) == [0]


@pytest.mark.parametrize('number', range(4))
def test_what_a_pose_could_be_mistaken_for_is_found_where_the_prior_did_not_lead(number):
    other = ambiguous_poses(BRACKET, HERE)[number]
    wide = Gaussian.from_covariance(HERE, np.diag(np.repeat([0.02, 1.0], 3) ** 2),
                                    BRACKET.symmetry)
    peaks = Peaks([mode_at(HERE, 10.0, SIGMA), mode_at(other, 30.0, SIGMA)])
    modes = replace(peaks.near(everywhere, 20), rigid=lambda _: lambda poses: np.zeros(
        len(poses)) - 1e3 * (deviations(poses, peaks.modes[0])[:, 3:] ** 2).sum(axis=1)).modes(
            wide, np.random.default_rng(0))
    assert modes == peaks.modes[::-1]


@pytest.mark.parametrize('more', [0.0, 4.0])
def test_a_sample_is_prior_times_evidence(more):
    """Shares, means and covariances of the modes are those of the product of Gaussians."""
    modes = [mode_at(aside(0.004, 0, -0.002), 30.0 + more, SIGMA),
             mode_at(aside(-0.03, 0.01, 0), 20.0, 2 * SIGMA)]
    peaks = Peaks(modes)
    posterior = ContourPosterior(
        BRACKET, PmclSettings(), peaks.evidence, lambda pose, _: peaks.nearest(pose).local,
        lambda pose: About(peaks.nearest(pose)), everywhere, no_points)
    sample = sampled(peaks.near(everywhere), posterior, PRIOR, 3000)
    assert_sampled(sample, PRIOR)


def test_evidence_is_scaled_as_about_the_modes_that_are_left():
    """Not as about the most evident one, which is far too unlikely where it is."""
    near, far = (mode_at(pose, evidence, SIGMA) for pose, evidence in (
        (HERE, 30.0), (ambiguous_poses(BRACKET, HERE)[0], 60.0)))
    far = replace(far, local=replace(far.local, variability=4 * far.local.variability))
    peaks = Peaks([near, far])
    posterior = ContourPosterior(
        BRACKET, PmclSettings(), peaks.evidence, lambda pose, _: peaks.nearest(pose).local,
        lambda pose: About(peaks.nearest(pose)), everywhere, no_points)
    assert found(peaks) == [1, 0]
    sample = sampled(peaks.near(everywhere), posterior, PRIOR, 3000)
    assert sample.modes == (near,)
    assert_sampled(sample, PRIOR)


def test_a_sample_stays_in_the_region():
    """Where prior and evidence together lead out of it too."""
    mode = mode_at(aside(-0.0005, 0, 0), 20.0, SIGMA)
    peaks = Peaks([mode])

    def inside(poses):
        return poses[:, 0, 3] < HERE[0, 3]

    def exact(poses):
        return np.where(inside(poses), peaks.evidence(poses), -np.inf)

    off = replace(PRIOR, pose=aside(0.03, 0, 0))
    posterior = ContourPosterior(BRACKET, PmclSettings(), exact, lambda *_: mode.local,
                                 lambda _: About(mode), inside, no_points)
    near = replace(peaks.near(inside), rigid=lambda _: exact)
    sample = sampled(near, posterior, off, 500)
    assert inside(sample.poses).all()
    assert np.isfinite(sample.values).all()
    assert len(np.unique(sample.poses[:, 0, 3])) > 100
