"""Motions of cameras whose poses are uncertain, eliminated from a local model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.view_terms import ViewTerms


@dataclass(frozen=True)
class Nuisance:
    """Motions of uncertain cameras that fit best, as a function of the pose.

    For a tangent vector x (d,) of the pose they change by offset (k,) - follow (k, d) x. evidence:
    of the present motions, by their prior [nat]. scale: as of `UncertainCameras`.
    """

    offset: NDArray[np.float64]
    follow: NDArray[np.float64]
    evidence: float
    scale: float


@dataclass(frozen=True)
class UncertainCameras:
    """Errors of the cameras' poses as motions z (k,) of unit prior variance.

    root: (views, 6, k) tangent vector of the object, in its frame, by which view v sees it off.
    motions: (k,) those with which the views' cameras are drawn now. scale: that turns evidence
    into a log likelihood.
    """

    root: NDArray[np.float64]
    motions: NDArray[np.float64]
    scale: float

    def eliminated(self, basis: NDArray[np.float64], terms: Sequence[ViewTerms]
                   ) -> tuple[Nuisance, list[ViewTerms]]:
        """The best motions, and the terms of the views without them, by the Schur complement.

        With the pose's x and z the evidence is a sum over views of g'y - y'H y / 2, y = x + L z,
        less z'z / (2 scale).
        """
        root = basis.T @ self.root
        curved = np.array([each.information for each in terms]) @ root  # (v, d, k) H L
        prior = np.eye(root.shape[2]) / self.scale
        inverse = np.linalg.inv(np.einsum('vdk,vdl->kl', root, curved) + prior)
        pull = np.einsum('vdk,vd->k', root, [each.gradient for each in terms])
        pull -= self.motions / self.scale
        whole = curved.sum(axis=0)
        offset, follow = inverse @ pull, inverse @ whole.T
        # Of a view's gradient and curvature so much is left to the pose.
        left = np.eye(basis.shape[1]) - whole @ inverse @ root.transpose(0, 2, 1)
        made = [each.transformed(one) for each, one in zip(terms, left, strict=True)]
        # The prior pulls the motions back, and with them the pose.
        back = whole @ inverse @ self.motions / self.scale / len(made)
        made = [replace(each, gradient=each.gradient + back) for each in made]
        evidence = -float(self.motions @ self.motions) / (2 * self.scale)
        return Nuisance(offset, follow, evidence, self.scale), made
