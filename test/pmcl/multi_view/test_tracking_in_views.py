"""A cup that moves before two fixed cameras, is hidden, and comes back."""

from dataclasses import replace

import numpy as np
import pytest
from pmcl_scenes import CAMERA
from scipy.spatial.transform import Rotation
from test_multi_view import CUP, MIDDLE, ROI, around, error, maps_seen, truth_of

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.sampler import Gaussian
from pmcl_ros.pmcl.tracking.settings import TrackingSettings
from pmcl_ros.pmcl.tracking.tracker import PREDICTED, Tracker

PERIOD = 10 ** 8
STEP = np.array([[0.008, -0.003, 0.004, 0.03, -0.02, 0.01]])
HIDDEN = 2
FRAME = np.eye(4)  # of the first camera in the base, in which all poses are
FRAME[:3, :3] = Rotation.from_euler('xyz', [170, 20, -40], degrees=True).as_matrix()
FRAME[:3, 3] = 0.5, -0.2, 0.9


def of_strength(evidence, factor):
    return replace(evidence, views=tuple(replace(each, evidence=replace(
        each.evidence, tensor=factor * each.evidence.tensor,
        inside=factor * each.evidence.inside)) for each in evidence.views))


@pytest.fixture(scope='module')
def captures(_session_context):
    """The evidence of both cameras at each time, and the pose in the base frame."""
    _session_context.use()
    truth, made = truth_of(CUP), []
    for number in range(4):
        evidence = maps_seen(_session_context, CUP, FRAME @ truth, FRAME @ around([-20, 20]))
        evidence = of_strength(evidence, 0.0 if number == HIDDEN else 1.5)
        made.append((replace(evidence, header=Header(number * PERIOD, 'base')), FRAME @ truth))
        truth = retract(truth, STEP)[0]
    return made


@pytest.fixture(scope='module')
def of():
    centre = FRAME[:3, :3] @ MIDDLE + FRAME[:3, 3]
    return TrackingSettings(tracking='constant_velocity', roi_center=tuple(centre),
                            roi_size=(max(ROI),) * 3, proposals=100, track_candidates=256)


def test_it_is_followed_lost_predicted_and_found_again(captures, of):
    with MultiViewLocalizer(CUP, of) as localizer:
        tracker, rng = Tracker(localizer, CUP, of), np.random.default_rng(0)
        found = [tracker.track(each, rng) for each, _ in captures]
    assert [each.mode for each in found[:3]] == ['default', 'followed', PREDICTED]
    assert [each.lost for each in found] == [False, False, True, False]
    for number, (estimate, (evidence, truth)) in enumerate(zip(found, captures, strict=True)):
        assert estimate.header == evidence.header
        if number != HIDDEN:
            off = error(CUP, estimate.pose, truth)
            assert off[0] < 2
            assert off[1] < 3
    assert np.trace(found[2].covariance[:3, :3]) > np.trace(found[1].covariance[:3, :3])


def test_what_is_followed_is_the_product_of_prior_and_evidence(captures, of):
    """The surer the prior, the nearer the pose is to it, and the surer."""
    evidence, truth = captures[0]
    evidence = of_strength(evidence, 0.05)  # else it leaves less than a mode is found to
    with MultiViewLocalizer(CUP, of) as localizer:
        def follow(pose, sigma, seed=1):
            wide = np.diag(np.repeat(np.square(sigma), 3))
            prior = Gaussian.from_covariance(pose, wide, CUP.symmetry)
            return localizer.follow(evidence, prior, np.random.default_rng(seed), 4000, 64)

        free = follow(truth, (0.01, 0.1))
        # Along the axis that the evidence knows least, off by one deviation.
        values, vectors = np.linalg.eigh(free.covariance[:3, :3])
        sigma = float(np.sqrt(values[-1]))
        aside = free.pose.copy()
        aside[:3, 3] += sigma * vectors[:, -1]
        # Which proposals a mode is refined from scatters its place by some tenths of sigma.
        bound = [[follow(aside, (part * sigma, 0.1), seed) for seed in range(3)]
                 for part in (1, 0.2)]
        scores = localizer.log_likelihoods(evidence, np.stack([truth, aside @ np.diag(
            [1, -1, -1, 1])]))
    axis = vectors[:, -1]
    moved = [np.median([(each.pose - free.pose)[:3, 3] @ axis / sigma for each in found])
             for found in bound]
    assert 0.05 < moved[0] < 0.95 * moved[1] < 1
    left = [np.median([axis @ each.covariance[:3, :3] @ axis / sigma ** 2 for each in found])
            for found in bound]
    assert 1 > left[0] > left[1]
    assert scores[0] > scores[1] + 1


def test_uncertain_cameras_make_likelihoods_no_surer(context, of):
    """Overconfident evidence is scaled, whether or not the cameras are known exactly."""
    truth = FRAME @ truth_of(CUP)
    evidence = of_strength(maps_seen(context, CUP, truth, FRAME @ around([-20, 20]), CAMERA), 1.5)
    aside = truth.copy()
    aside[:3, 3] += 0.004 * FRAME[:3, 0]

    def ratio(localizer, sigma):
        views = tuple(replace(each, sigma=(sigma, sigma), evidence=replace(
            each.evidence, tensor=8 * each.evidence.tensor)) for each in evidence.views)
        here, there = localizer.log_likelihoods(replace(evidence, views=views),
                                                np.stack([truth, aside]))
        return here - there

    with MultiViewLocalizer(CUP, of) as localizer:
        exact, almost, uncertain = (ratio(localizer, sigma) for sigma in (0.0, 1e-7, 2e-3))
    assert almost == pytest.approx(exact, rel=0.01)
    assert 0 < uncertain < 0.9 * exact


def test_nothing_in_view_near_the_prior_gives_the_prior(captures, of):
    evidence, truth = captures[0]
    behind = truth.copy()
    behind[:3, 3] = FRAME[:3, 3] - 0.5 * FRAME[:3, 2]
    prior = Gaussian.from_covariance(behind, 1e-4 * np.eye(6), CUP.symmetry)
    with MultiViewLocalizer(CUP, of) as localizer:
        found = localizer.follow(evidence, prior, np.random.default_rng(0), 500, 64)
    assert found.lost
    np.testing.assert_allclose(found.pose, behind, atol=1e-9)
    np.testing.assert_allclose(np.diag(found.covariance)[:3], 1e-4, rtol=0.3)
