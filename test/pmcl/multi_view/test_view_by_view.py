"""The posterior view by view: surer with each, and as sure as the localizer is with all."""

from dataclasses import replace

import numpy as np
import pytest
from test_multi_view import CUP, around, found, maps_seen, settings, truth_of

from pmcl_ros.evidence.posed_evidence import PosedEvidence
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.multi_view.next_view import position_sigma
from pmcl_ros.pmcl.multi_view.view_by_view import sigmas_by_views


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
