"""Which walls and boards of a scene are between an object and a camera."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.simulation.scenes.scene import Scene, Sheet


def hiding_sheets(scene: Scene, eyes: NDArray[np.float64]) -> list[bool]:
    """Of each sheet, whether it is opaque and between the middle of a target and one of the eyes.

    eyes: (n, 3) in the frame of the scene's camera [m].
    """
    middles = np.array([each.pose[:3, :3] @ each.vertices.mean(axis=0) + each.pose[:3, 3]
                        for each in scene.targets])
    return [each.opacity == 1 and _is_between(each, eyes, middles) for each in scene.sheets]


def _is_between(sheet: Sheet, eyes: NDArray[np.float64], middles: NDArray[np.float64]) -> bool:
    here, there = ((points - sheet.pose[:3, 3]) @ sheet.pose[:3, :3]
                   for points in (eyes[:, None], middles))
    ahead = there - here  # (eyes, targets, 3)
    with np.errstate(divide='ignore', invalid='ignore'):  # a ray along the sheet
        met = here[..., :2] - here[..., 2:] / ahead[..., 2:] * ahead[..., :2]
    apart = here[..., 2] * there[..., 2] < 0
    return bool((apart & (np.abs(met) < np.array(sheet.size) / 2).all(axis=-1)).any())
