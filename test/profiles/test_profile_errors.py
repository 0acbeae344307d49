from dataclasses import replace

import numpy as np
import pytest
from conftest import PLACE

from pmcl_ros.evaluation.studies.profile_errors import ProfileTrial, profile_distances, summary
from pmcl_ros.profiles.measured import MeasuredProfile


def _measured(surface):
    return MeasuredProfile(surface, np.full(len(surface.wall), 1e-3), 2.0, 1.0)


def test_distances_are_those_of_the_surfaces(true_surface, vessel):
    assert profile_distances(_measured(true_surface), vessel).max() < 3e-4
    wider = replace(true_surface, radii=true_surface.radii + 1e-3)
    off = profile_distances(_measured(wider), vessel)
    assert off.max() == pytest.approx(1e-3, abs=1e-4)
    assert np.median(off) == pytest.approx(1e-3, abs=2e-4)


def test_object_of_a_surface_stands_where_that_does(true_surface, vessel):
    found = _measured(replace(true_surface, low=-0.03, high=0.07))
    np.testing.assert_allclose(found.pose[:3, 3], PLACE + np.array([0, 0, 0.02]), atol=1e-12)
    assert abs(np.ptp(found.model.vertices[:, 2]) - 0.1) < 1e-4
    assert found.model.closed
    assert found.model.radius == pytest.approx(vessel.radius, abs=5e-4)


def test_vessels_without_a_profile_count(true_surface):
    good = ProfileTrial(1, 'jar', 0.5, 0.2, 0.1, 0.9, None, None)
    none = ProfileTrial(2, 'bowl', None, None, None, None, None, None)
    text = summary([good, none, none])
    assert 'profiles: 1 of 3; largest deviation, median of all inf' in text
    assert 'at most 1 mm in 33 %' in text
