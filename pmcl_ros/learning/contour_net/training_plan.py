"""How the network of the contour map is trained. Needs no TensorFlow."""

from dataclasses import dataclass

_CHANNELS = (32, 48, 64, 96)  # at 1/2, 1/4, 1/8, 1/16 of the resolution
_MULTIPLE = 8  # of channels: what processors compute at once


@dataclass(frozen=True)
class TrainingPlan:
    """How to train.

    size: crops of a batch; crop: px, a multiple of 16; every: steps between two states on disk.
    rate: Adam's learning rate after the first steps; it falls to 0 as a cosine. width: of the
    network's layers; 1: as the shipped one's.
    """

    steps: int = 20000
    seed: int = 0
    size: int = 8
    crop: int = 192
    every: int = 500
    dtype: str = 'float32'
    rate: float = 3e-3
    width: float = 1.0

    @property
    def channels(self) -> tuple[int, ...]:
        """Of the network's layers at 1/2, 1/4, 1/8, 1/16 of the resolution."""
        return tuple(_MULTIPLE * max(round(self.width * each / _MULTIPLE), 1)
                     for each in _CHANNELS)
