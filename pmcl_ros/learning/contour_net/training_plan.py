"""How the network of the contour map is trained. Needs no TensorFlow."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TrainingPlan:
    """How to train.

    size: crops of a batch; crop: px, a multiple of 16; every: steps between two states on disk.
    rate: Adam's learning rate after the first steps; it falls to 0 as a cosine.
    """

    steps: int = 20000
    seed: int = 0
    size: int = 8
    crop: int = 192
    every: int = 500
    dtype: str = 'float32'
    rate: float = 3e-3
