"""A grasp: where the open gripper is, in the object's frame, before it closes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Grasp:
    """One way to take an object.

    name: tells it apart. kind: 'rim' (one finger inside a vessel), 'side', 'top' (over an end), or
        'other'.
    pose: (4, 4) the grasp frame (see GripperSettings) in the object's frame.
    width: of the object between the fingers [m]. opening: gap between them on approach [m].
    """

    name: str
    kind: str
    pose: NDArray[np.float64]
    width: float
    opening: float

    @classmethod
    def of(cls, name: str, kind: str, position: NDArray[np.float64], approach: NDArray[np.float64],
           closing: NDArray[np.float64], width: float, opening: float) -> 'Grasp':
        """From the grasp frame's origin and its x and y axes, unit vectors at a right angle."""
        pose = np.eye(4)
        pose[:3, 0], pose[:3, 1], pose[:3, 2] = approach, closing, np.cross(approach, closing)
        pose[:3, 3] = position
        return cls(name, kind, pose, width, opening)

    @property
    def approach(self) -> NDArray[np.float64]:
        """(3,) unit vector from the wrist to the fingertips."""
        return self.pose[:3, 0]

    @property
    def closing(self) -> NDArray[np.float64]:
        """(3,) unit vector along which the fingers close."""
        return self.pose[:3, 1]
