"""Camera errors, displacement of contours -> eliminated from the views' terms of a local model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.pmcl.view_terms import ViewTerms, sums_over_pairs


@dataclass(frozen=True)
class Eliminated:
    """Nuisances that fit best, as a function of the pose.

    For a tangent vector x (d,) of the pose they change by step (k + 1,) - follow (k + 1, d) x.
    evidence: of the present ones, by their prior [nat]. scale: as of `Nuisances`. inverse:
    (k + 1, k + 1) of their information, for a known pose. root: (views, d + 1, k + 1) how they
    move what a view sees. left: (views, d, d + 1) what of its gradient is left to the pose.
    scatter: (k + 1, k + 1) covariance with which nuisances that are 0 are found, by the noise of
    such captures and the model error; None where that was not asked for.
    """

    step: NDArray[np.float64]
    follow: NDArray[np.float64]
    evidence: float
    scale: float
    inverse: NDArray[np.float64]
    root: NDArray[np.float64]
    left: NDArray[np.float64]
    scatter: NDArray[np.float64] | None = None

    def after(self, step: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k + 1,) by which they change when the pose moves by a tangent vector (d,)."""
        return self.step - self.follow @ step

    def covariance(self, information: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k + 1, k + 1) of the nuisances, whatever the pose. information: (d, d) of the pose."""
        of_pose = self.follow @ np.linalg.solve(information, self.follow.T)
        return np.asarray((self.inverse + of_pose) / self.scale)

    def with_scatter(self, information: NDArray[np.float64], terms: Sequence[ViewTerms],
                     error: ModelError) -> 'Eliminated':
        """With `scatter`, whatever the pose.

        information: (d, d) of the pose. terms: of the views, from which these were eliminated.
        """
        by_pose = self.follow @ np.linalg.solve(information, self.left)
        by_views = self.inverse @ self.root.transpose(0, 2, 1) - by_pose
        stretches = [each.transformed(one).stretches() for each, one
                     in zip(terms, by_views, strict=True) if len(each.points.lengths)]
        return replace(self, scatter=np.add(*sums_over_pairs(stretches, error)))


@dataclass(frozen=True)
class Nuisances:
    """Errors of the cameras' poses, and where contours are found: values of unit prior variance.

    An object's contours are found outside or inside of where they are by about as much in all
    views. As views that lie close together tell distance by size, that would decide it.

    cameras: (views, 6, k) tangent vector of the object, in its frame, by which view v sees it off.
    displacement: standard deviation of where contours are found, outwards [px]. values: (k + 1,)
    with which the views are drawn now, the displacement's last. scale: that turns evidence into a
    log likelihood.
    """

    cameras: NDArray[np.float64]
    displacement: float
    values: NDArray[np.float64]
    scale: float

    def eliminated(self, basis: NDArray[np.float64], terms: Sequence[ViewTerms]
                   ) -> tuple[Eliminated, list[ViewTerms]]:
        """The best nuisances, and the terms of the views without them, by the Schur complement.

        terms: with a displacement (`ViewTerms.from_view`). With the pose's x and nuisances z the
        evidence is a sum over views of g'y - y'H y / 2, y = (x, 0) + L z, less z'z / (2 scale).
        """
        views, _, number = self.cameras.shape
        d = basis.shape[1]
        root = np.zeros((views, d + 1, number + 1))
        root[:, :d, :number] = basis.T @ self.cameras
        root[:, d, number] = self.displacement
        curved = np.array([each.information for each in terms]) @ root  # H L
        prior = np.eye(number + 1) / self.scale
        inverse = np.linalg.inv(np.einsum('vdk,vdl->kl', root, curved) + prior)
        pull = np.einsum('vdk,vd->k', root, [each.gradient for each in terms])
        pull -= self.values / self.scale
        whole = curved[:, :d].sum(axis=0)
        step, follow = inverse @ pull, inverse @ whole.T
        # Of a view's gradient and curvature so much is left to the pose.
        left = np.eye(d, d + 1) - whole @ inverse @ root.transpose(0, 2, 1)
        made = [each.transformed(one) for each, one in zip(terms, left, strict=True)]
        # The prior pulls the nuisances back, and with them the pose.
        back = whole @ inverse @ self.values / self.scale / len(made)
        made = [replace(each, gradient=each.gradient + back) for each in made]
        evidence = -float(self.values @ self.values) / (2 * self.scale)
        return Eliminated(step, follow, evidence, self.scale, inverse, root, left), made
