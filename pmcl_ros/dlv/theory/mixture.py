"""Rays as mixtures of Gaussians over red, green, blue (paper, section IV.A)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import VolumeError


@dataclass(frozen=True)
class Mixture:
    """Light along rays: surfaces' colours, each by its share of the light.

    shares: (..., surfaces), the paper's alpha; they sum to 1 along each ray.
    means: (..., surfaces, channels), the colour of each surface.
    sigma: (channels,), the spread of a channel, the same for every surface in the scene.
    Raises VolumeError when shapes do not match, shares do not sum to 1, or sigma is not positive.
    """

    shares: NDArray[np.float64]
    means: NDArray[np.float64]
    sigma: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.means.shape[-2:] != (self.shares.shape[-1], *self.sigma.shape):
            raise VolumeError(f'means {self.means.shape} do not match shares {self.shares.shape} '
                              f'and sigma {self.sigma.shape}; expected (..., surfaces, channels), '
                              '(..., surfaces) and (channels,)')
        if not np.allclose(self.shares.sum(axis=-1), 1) or (self.shares < 0).any():
            raise VolumeError(f'shares {self.shares.tolist()} must be positive or 0 and sum to 1')
        if not (np.isfinite(self.sigma).all() and (self.sigma > 0).all()):
            raise VolumeError(f'sigma {self.sigma.tolist()} must be positive')


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
    # cancel where the rays are nearly alike.
    products = np.expm1(-apart ** 2 / 4) / np.sqrt(4 * np.pi * one.sigma ** 2)
    return np.einsum('...i,...j,...ijc->...', shares, shares, products)
