"""A card before the object in a picture: what a hand, a cable or the gripper does to a view."""

import cv2
import numpy as np
from numpy.typing import NDArray

_HALF = 1.1  # half its side, in radii of the circle around the object
_OFFSET = 0.3  # the most that its middle is from that of the circle, in radii
_BLURRED = 3.0  # px, standard deviation: it is nearer than what is in focus
_SPOTS = 6  # of its texture, along a side


def with_card(picture: NDArray[np.uint8], outline: NDArray[np.float64],
              rng: np.random.Generator) -> NDArray[np.uint8]:
    """A picture (height, width, 3) with a card over the points (n, 2) of an object [px].

    The card is a square of random turn, place and texture. It hides most of the object or all.
    Points that are NaN are behind the camera; where all are, the picture stays as it is.
    """
    outline = outline[np.isfinite(outline).all(axis=1)]
    if not len(outline):
        return picture
    (x, y), radius = cv2.minEnclosingCircle(outline.astype(np.float32))
    offset = radius * _OFFSET * rng.uniform(-1, 1, 2)
    side = 2 * _HALF * radius
    corners = cv2.boxPoints(((x + offset[0], y + offset[1]), (side, side),
                             float(rng.uniform(0, 90))))
    height, width = picture.shape[:2]
    mask = np.zeros((height, width), np.float32)
    cv2.fillConvexPoly(mask, np.round(corners).astype(np.int32), 1.0)
    share = cv2.GaussianBlur(mask, (0, 0), _BLURRED)[..., None]
    spots = np.clip(rng.uniform(20, 200, 3) + rng.normal(0, 25, (_SPOTS, _SPOTS, 3)), 0, 255)
    texture = cv2.resize(spots.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    covered = share * np.clip(texture, 0, 255) + (1 - share) * picture
    return np.asarray(np.round(covered), np.uint8)
