"""Which of the poses that a search found are refined as modes of a posterior by several views."""

import numpy as np
import pytest

from pmcl_ros.pmcl.search import ScoredPoses


@pytest.mark.parametrize(('values', 'count'), [
    ([5000.0, 4700.0, 4500.0], 2),  # hundreds of nats behind, whatever their ratio
    ([300.0, 20.0, -50.0], 3),
    ([-50.0, -600.0, -np.inf], 1),
    ([-np.inf, -np.inf, -np.inf], 3),  # nothing is known of any
])
def test_poses_far_behind_the_best_are_no_contenders(values, count):
    poses = np.eye(4) * np.arange(1, 4)[:, None, None]
    scored = ScoredPoses(poses, np.array(values))
    np.testing.assert_array_equal(scored.contenders, poses[:count])
    np.testing.assert_array_equal(scored.first(2).poses, poses[:2])
