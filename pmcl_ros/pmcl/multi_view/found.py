"""What one search in several views found."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_view.joint_contours import ViewFit


@dataclass(frozen=True)
class Found:
    """What a search found.

    estimate: in the reference frame. fits: of the views, to its pose. modes: (n, 4, 4) in the
    reference frame. shown: views that show a lost object (`shown_in`). understated: factor
    by which stated errors of the cameras' poses are too small. how: warnings of how it was found,
    for the log unless it is lost for another reason.
    """

    estimate: PoseEstimate
    fits: Sequence[ViewFit]
    modes: NDArray[np.float64]
    shown: tuple[int, ...]
    understated: float
    how: tuple[str, ...] = ()
