"""The paper's Lemma 1: the surface that gives more of the light is the more likely one.

It holds if both surfaces' colours change equally much between the two points seen (`TwoLayers`),
and if the surfaces differ by so many sigma that the terms between them vanish. Nothing in a scene
guarantees either: `counterexample`.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmcl_ros.dlv.theory.two_layers import TwoLayers


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
