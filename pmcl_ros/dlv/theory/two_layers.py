"""A scene of two layers, one seen through the other, and its depth likelihood (section IV.B)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.theory.likelihood import depth_likelihood
from pmcl_ros.dlv.theory.mixture import Mixture, squared_distance

FRONT, BACK, NEITHER = range(3)  # the depths at which the second view is looked at


@dataclass(frozen=True)
class TwoLayers:
    """A ray of the centre view, and what another view shows of its two surfaces.

    alpha: (...) the share of light from the front surface (the glass), in [0, 1].
    front, back: (2, channels) colours of two points of each surface: the first is on the ray (the
        paper's G_1, P_1); the second is what the other view shows of that surface at the depth of
        neither or of the other surface (G_2, P_2).
    sigma: (channels,) spread of the colours.
    """

    alpha: NDArray[np.float64]
    front: NDArray[np.float64]
    back: NDArray[np.float64]
    sigma: NDArray[np.float64]

    def ray(self, front: int, back: int) -> Mixture:
        """The light of a front and a back point, counted from 0, seen along one ray."""
        shares = np.stack([self.alpha, 1 - self.alpha], axis=-1)
        return Mixture(shares, np.stack([self.front[front], self.back[back]]), self.sigma)

    def distances(self) -> NDArray[np.float64]:
        """(..., 3) of the centre view's ray to those found at FRONT, BACK, NEITHER depth.

        They are the paper's rho_2, rho_3, rho_4: at the front's depth the other view shows the
        same front point, but another back point.
        """
        seen = (0, 1), (1, 0), (1, 1)
        return np.stack([squared_distance(self.ray(0, 0), self.ray(*each)) for each in seen], -1)

    def likelihood(self) -> NDArray[np.float64]:
        """(..., 3) the depth likelihood at FRONT, BACK and NEITHER depth, of one stereo pair."""
        return depth_likelihood(self.distances()[..., None, :])
