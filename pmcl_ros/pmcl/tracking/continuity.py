"""Which of the poses that look alike is published: the one nearest to the last."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import covariance_at, inverse
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.prior.region import Box


@dataclass(frozen=True)
class _Published:
    """The last pose (4, 4), its frame, and that of the camera in the fixed frame, if known."""

    pose: NDArray[np.float64]
    frame_id: str
    camera: NDArray[np.float64] | None


class Continuity:
    """Keeps the frame of a symmetric object from turning between captures when the object did not.

    A search chooses among the poses that look alike by one capture alone, so that the choice can
    change with noise, or with the camera. Here the first capture's choice goes on.
    symmetry: of the object. region: holds the origin of what is chosen, if it holds one.
    """

    def __init__(self, symmetry: Symmetry, region: Box) -> None:
        self._symmetry, self._region = symmetry, region
        self.reset()

    def reset(self) -> None:
        """Forget the last pose: the next estimate stays as it is."""
        self._last: _Published | None = None

    def follow(self, estimate: PoseEstimate, camera: NDArray[np.float64] | None = None
               ) -> PoseEstimate:
        """The estimate by the equivalent pose whose rotation is nearest to the last found one's.

        camera: (4, 4), camera to a fixed frame. Where it is known of both captures, nearest in
        that frame, else in the frame of the estimate; in another frame than the last, the
        estimate stays as it is.
        """
        reference = self._reference(estimate.header.frame_id, camera)
        if reference is not None:
            estimate = self._nearest(estimate, reference)
        if not estimate.lost:
            self._last = _Published(estimate.pose, estimate.header.frame_id, camera)
        return estimate

    def _reference(self, frame_id: str, camera: NDArray[np.float64] | None
                   ) -> NDArray[np.float64] | None:
        """(4, 4) the last pose in the frame of this capture."""
        last = self._last
        if last is None or last.frame_id != frame_id:
            return None
        if last.camera is None or camera is None:
            return last.pose
        return inverse(camera) @ last.camera @ last.pose

    def _nearest(self, estimate: PoseEstimate, reference: NDArray[np.float64]) -> PoseEstimate:
        """The estimate by the equivalent of its pose nearest a reference (4, 4)."""
        symmetry = self._symmetry
        if symmetry.axis is None and len(symmetry.discrete) == 1:
            return estimate
        poses = symmetry.equivalents(estimate.pose)
        inside = self._region.contains(poses[:, :3, 3])
        pose = symmetry.nearest(poses[inside] if inside.any() else poses, reference)
        # The rotation about the camera's axes is the same; a symmetry may shift the origin.
        shift = pose[:3, 3] - estimate.pose[:3, 3]
        return replace(
            estimate, pose=pose, covariance=covariance_at(estimate.covariance, shift),
            particles=symmetry.nearest_equivalents(estimate.particles, pose),
            modes=tuple(replace(each, pose=symmetry.nearest(symmetry.equivalents(each.pose), pose))
                        for each in estimate.modes))
