"""The search of the whole region, where other things have stronger edges than the object."""

import numpy as np
import pytest

from pmcl_ros.evaluation.studies.tracking import edges_of
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.simulation.sequence import Sequence, SequenceSettings


@pytest.mark.parametrize('seed', [24, 34])  # cards' edges fit every outline better than theirs
def test_an_object_among_stronger_edges_is_found(seed):
    sequence = Sequence(seed, SequenceSettings())
    settings = PmclSettings(roi_center=sequence.roi_center, roi_size=sequence.roi_size,
                            renderer='numba')
    frame = next(iter(sequence))
    with Localizer(sequence.model, settings) as localizer:
        volume = edges_of(sequence, frame)
        estimate = localizer.localize(volume, np.random.default_rng(0))
        there, found = (each.local.evidence
                        for each in localizer.observe(volume, [frame.pose, estimate.pose]))
    error = pose_error(estimate.pose, frame.pose, sequence.model.symmetry)
    assert not estimate.lost
    assert error.translation < 0.02
    assert error.rotation < np.deg2rad(10)
    assert found > there - 15
