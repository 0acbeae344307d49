"""The posterior view by view: surer with each, and as sure as the localizer is with all."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from test_multi_view import CUP, MIDDLE, around, found, maps_seen, settings, truth_of

from pmcl_ros.evidence.posed_evidence import PosedEvidence
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence
from pmcl_ros.pmcl.multi_view.joint_posterior import JointPosterior, numbers_of
from pmcl_ros.pmcl.multi_view.next_view import position_sigma
from pmcl_ros.pmcl.multi_view.view_by_view import sigmas_by_views
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer


def test_each_view_makes_it_surer_up_to_what_all_of_them_tell(context):
    evidence = maps_seen(context, CUP, truth_of(CUP), around([0, 25, -40]))
    estimate = found(CUP, evidence)
    sigmas = sigmas_by_views(evidence, CUP, settings(), estimate.pose)
    assert (np.diff(sigmas) < 0).all()
    assert sigmas[1] < 0.6 * sigmas[0]
    assert sigmas[2] == pytest.approx(position_sigma(estimate.covariance), rel=0.2)
    # Views that do not see the region say nothing.
    away = retract(around([180]), np.array([[0, 0, 0, 0, np.pi, 0.]]))[0]
    blind = PosedEvidence(evidence.views[0].evidence, away)
    later = replace(evidence, views=(blind, *evidence.views))
    np.testing.assert_allclose(sigmas_by_views(later, CUP, settings(), estimate.pose),
                               [np.nan, *sigmas])


def test_a_mode_is_as_sure_as_its_own_views_agree_whatever_was_refined_later(context):
    truth = truth_of(CUP)
    evidence = maps_seen(context, CUP, truth, around([-20, 20]))
    # A region without the modes: no step leads into it, and each stays where it was begun.
    elsewhere = settings(MIDDLE + np.array([0.03, 0, 0]), (0.01, 0.01, 0.01))
    joint = JointEvidence.from_views(evidence, NumbaRenderer(), CUP, elsewhere)
    pose = np.linalg.inv(evidence.views[0].camera_to_reference) @ truth
    with contextlib.ExitStack() as stack:
        posterior = JointPosterior.opened(joint, elsewhere, numbers_of(joint), stack)
        right = posterior.refine(pose)
        wrong = posterior.refine(retract(pose, np.array([[0.006, 0, 0, 0, 0, 0.]]))[0])
        assert posterior.error_share_near(wrong.pose) > 4 * posterior.error_share_near(pose)
        np.testing.assert_array_equal(posterior.local_model_at(pose, True).spread,
                                      right.local.spread)
        # About its axis a cup looks the same; a tenth of a millimetre is another pose.
        spun = retract(right.pose, np.array([[0, 0, 0, *(0.7 * right.pose[:3, :3] @ CUP.axis)]]))
        np.testing.assert_array_equal(posterior.local_model_at(spun[0], True).spread,
                                      right.local.spread)
        moved = retract(right.pose, np.array([[1e-4, 0, 0, 0, 0, 0.]]))[0]
        assert posterior.local_model_at(moved, True).evidence != right.local.evidence
