"""What scores poses by their contours, whatever draws them."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.render.contour import KernelVolume, check_profile
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.creases import CreasePoints, Creases, Lines
from pmcl_ros.pmcl.render.scene import Scene
from pmcl_ros.runtime.closing import Closing


class ContourScore(Closing, ABC):
    """How well a pose's contour lies on edges at its own depth (docs/concepts/evidence.md).

    evaluations: number of poses drawn so far.
    """

    def __init__(self, scene: Scene, volume: EvidenceVolume, profile: ContourProfile,
                 creases: Creases | None) -> None:
        check_profile(profile)
        self.evaluations = 0
        self._scene, self._profile, self._creases = scene, profile, creases
        self._volume = KernelVolume.from_volume(scene, volume, profile)
        self._lines = None if creases is None else Lines.from_creases(scene, volume, creases)

    def __call__(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        """(n,) sum of the evidence along contours, and creases, of poses (n, 4, 4) [nat]."""
        return self.evaluate(poses)[:, 0]

    @abstractmethod
    def evaluate(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        """(n, 2) that, and the length of the contour in the image [px]."""

    def points(self, pose: NDArray[np.floating]) -> ContourPoints:
        """The contour's points that are summed, of one pose (4, 4)."""
        self.evaluations += 1
        return ContourPoints.from_zbuffer(*self._drawn(pose), self._volume, self._profile)

    def creases(self, pose: NDArray[np.floating]) -> CreasePoints | None:
        """Likewise of the creases; None where there are none."""
        if self._creases is None or self._lines is None:
            return None
        return CreasePoints.from_zbuffer(np.ascontiguousarray(pose, np.float32),
                                         *self._drawn(pose), *self._lines, self._creases.profile)

    @abstractmethod
    def _drawn(self, pose: NDArray[np.floating]
               ) -> tuple[tuple[int, int, int, int], NDArray[np.float32]]:
        """A pose's z-buffer with a margin, and the box in it that is drawn."""
