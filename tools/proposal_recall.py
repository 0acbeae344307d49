"""How often proposals hold the true pose, and the search finds it: docs/results/poses.md.

python tools/proposal_recall.py FOLDER, of scenes that `pmcl scenes render` made.
"""

import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.cli.learning.examples import example_of_edges
from pmcl_ros.evaluation.captures import find_captures
from pmcl_ros.geometry.pose_error import PoseError, pose_error
from pmcl_ros.learning.contour_tables import Example
from pmcl_ros.pmcl.history import Generation
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.settings import PmclSettings

_VIEWS = 5
_DISTANCE, _ANGLE = 0.03, np.deg2rad(20)  # m, rad: of a proposal that counts


def _error(example: Example, pose: NDArray[np.float64]) -> PoseError:
    return pose_error(pose, example.pose, example.model.symmetry)


def _result(example: Example) -> tuple[bool, bool, bool, float]:
    """Whether it is proposed, found, found elsewhere and not lost; CPU time [s]."""
    settings = PmclSettings(roi_center=example.region.center, roi_size=example.region.size,
                            renderer='numba')
    seen: list[Generation] = []
    with Localizer(example.model, settings) as localizer:
        begin = time.process_time()
        found = localizer.localize(example.volume, np.random.default_rng(0), watch=seen.append)
        took = time.process_time() - begin
    errors = [_error(example, each) for each in seen[0].poses]
    proposed = any(each.translation < _DISTANCE and each.rotation < _ANGLE for each in errors)
    right = _error(example, found.pose).right
    return proposed, right, not right and not found.lost, took


def main() -> None:
    """Of all scenes that show their object."""
    examples = (example_of_edges(each, _VIEWS) for each in find_captures(Path(sys.argv[1])))
    results = [_result(each) for each in examples if each.there]
    proposed, right, wrong, took = np.array(results).T
    sys.stdout.write(
        f'of {len(results)}: proposed {proposed.sum():.0f}, right {right.sum():.0f}, wrong and '
        f'not lost {wrong.sum():.0f}; median {np.median(took):.2f} s of CPU time\n')


if __name__ == '__main__':
    main()
