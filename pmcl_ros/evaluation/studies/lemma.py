"""The paper's section IV: the depth likelihood of rays from two surfaces, and its Lemma 1.

Lemma 1: the surface that gives more of the light is the more likely one. It holds if both
surfaces' colours change equally much between the two points seen (`TwoLayers`), and if the
surfaces differ by so many sigma that the terms between them vanish. Nothing in a scene guarantees
either: `counterexample`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FRONT, BACK, NEITHER = range(3)  # the depths at which the second view is looked at


@dataclass(frozen=True)
class Mixture:
    """Light along rays: surfaces' colours, each by its share of the light.

    shares: (..., surfaces), the paper's alpha; they sum to 1 along each ray.
    means: (..., surfaces, channels), the colour of each surface.
    sigma: (channels,), the spread of a channel, the same for every surface in the scene.
    """

    shares: NDArray[np.float64]
    means: NDArray[np.float64]
    sigma: NDArray[np.float64]


def squared_distance(one: Mixture, other: Mixture) -> NDArray[np.float64]:
    """(...) the integral of (one - other)^2 over intensity, summed over the channels.

    In closed form, because that of a product of two Gaussians is N(m; m', s^2 + s'^2). Both
    mixtures have the sigma of `one`: it is the scene's.
    """
    shape = np.broadcast_shapes(one.shares.shape[:-1], other.shares.shape[:-1],
                                one.means.shape[:-2], other.means.shape[:-2])
    shares = np.concatenate([np.broadcast_to(each, (*shape, each.shape[-1]))
                             for each in (one.shares, -other.shares)], axis=-1)
    means = np.concatenate([np.broadcast_to(each, (*shape, *each.shape[-2:]))
                            for each in (one.means, other.means)], axis=-2)
    apart = (means[..., :, None, :] - means[..., None, :, :]) / one.sigma
    # The signed shares sum to 0, so a constant may be taken off every product: nothing is left to
    # cancel where the rays are nearly equal.
    products = np.expm1(-apart ** 2 / 4) / np.sqrt(4 * np.pi * one.sigma ** 2)
    return np.einsum('...i,...j,...ijc->...', shares, shares, products)


def depth_likelihood(distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., depths) L(i, j, d): for each stereo pair how far the depth is from the worst one.

    distances: (..., pairs, depths), the squared distance of the ray to the one found at each depth
    in each pair's other view. Divided, as the equation says, by the sum over all the depths; the
    values printed in the paper's proof leave the invalid depth out of it and are twice as large
    (`printed`). A pair in which all rays are equal carries no information and adds 0.
    """
    worst = distances.max(axis=-1, keepdims=True)
    total = distances.sum(axis=-1, keepdims=True)
    share = np.divide(worst - distances, total, out=np.zeros_like(distances), where=total > 0)
    return np.asarray(share.sum(axis=-2))


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


def printed(alpha: ArrayLike) -> NDArray[np.float64]:
    """(..., 3) the paper's values at FRONT, BACK, NEITHER: alpha^2, (1 - alpha)^2, 0, normalised.

    The definition (`depth_likelihood`) gives half of them: its sum has the invalid depth as well.
    """
    front = np.asarray(alpha, float) ** 2
    back = (1 - np.asarray(alpha, float)) ** 2
    return np.stack([front, back, np.zeros_like(front)], axis=-1) / (front + back)[..., None]


def counterexample(alpha: ArrayLike = 0.3) -> TwoLayers:
    """Glass with a printed pattern before a smooth wall: the more transparent one is more likely.

    The colour of the glass changes by 0.2 between the points seen, that of the wall by 0.03: for
    alpha between about 0.23 and 0.5 the glass has the higher likelihood although it gives less of
    the light. The likelihood orders surfaces by the *change* they add, alpha^2 of the one against
    (1 - alpha)^2 of the other, not by their light.
    """
    glass = np.array([[0.2, 0.3, 0.2], [0.4, 0.5, 0.4]])
    wall = np.array([[0.8, 0.8, 0.9], [0.83, 0.83, 0.93]])
    return TwoLayers(np.asarray(alpha, float), glass, wall, np.full(3, 0.05))
