"""RingSheet: a printed ring of markers that lies on a table, around the object of a scene."""

from dataclasses import dataclass, replace
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.runtime.errors import SimulationError
from pmcl_ros.simulation.scenes.objects import SceneObject
from pmcl_ros.simulation.scenes.poses import Pose
from pmcl_ros.simulation.scenes.scene import Scene, Sheet
from pmcl_ros.simulation.scenes.textures import SIZE

_PAPER, _INK = 0.8, 0.05  # reflectances
_APART = 2e-4  # m: of surfaces that lie on each other; what is nearer, path tracing steps over


@dataclass(frozen=True)
class RingSheet:
    """options: of commands that name the ring. size: (width, height) of its page [m].

    grey: (SIZE, SIZE) float32 reflectances, a period as long as the longer side of the page; texel
    (0, 0) is in the middle of the ring, rows go up the page. region: as of `CharucoRing`.
    """

    options: str
    size: tuple[float, float]
    grey: NDArray[np.float32]
    region: tuple[float, float, float, float, float, float]

    @classmethod
    def from_ring(cls, ring: CharucoRing) -> 'RingSheet':
        """What a printer makes of its SVG, without the writing."""
        drawn = ElementTree.fromstring(ring.svg)
        width, height = (1e-3 * float((drawn.get(name) or '').removesuffix('mm'))
                         for name in ('width', 'height'))
        texel = max(width, height) / SIZE
        grey = np.full((SIZE, SIZE), _PAPER)
        for each in drawn:
            if not each.tag.endswith('rect'):
                continue
            x, y, wide, high = (1e-3 * float(each.get(name) or 0)
                                for name in ('x', 'y', 'width', 'height'))
            left, top = x - width / 2, height / 2 - y
            share = (_covered(top - high, top, texel)[:, None]
                     * _covered(left, left + wide, texel))
            grey += share * ((_PAPER if each.get('fill') == 'white' else _INK) - grey)
        return cls(ring.options, (width, height),
                   np.fft.ifftshift(grey).astype(np.float32), ring.region)

    @property
    def reach(self) -> float:
        """Radius of a circle about it [m]."""
        return float(np.hypot(*self.size)) / 2

    def check_holds(self, item: SceneObject, attitude: str) -> None:
        """Raise SimulationError where an object at rest may reach out of its middle.

        attitude: `upright`, or another word. The origin of what lies may be out of `region` then.
        """
        middle = min(self.region[3:5])
        upright = _across(item.vertices - np.outer(item.vertices @ item.up, item.up))
        lies = 'upright' not in (attitude, item.way)
        across = _across(item.vertices) if lies else upright
        if across <= middle:
            return
        choose = f'--attitude upright ({1e3 * upright:.0f} mm), or ' * (lies and upright <= middle)
        raise SimulationError(
            f'{self.options}: its middle is {1e3 * self.region[3]:.0f} x '
            f'{1e3 * self.region[4]:.0f} mm, {item.name} is {1e3 * across:.0f} mm across'
            f'{" where it lies" * lies}: choose {choose}a ring with a larger middle, which is '
            'four squares less than the ring each way')

    def around(self, rng: np.random.Generator, radius: float) -> Pose:
        """Draw where it lies (4, 4), ring to world: what stands above the world's origin, with a
        footprint of a radius [m], stands anywhere in its middle.
        """
        free = np.maximum(np.array(self.region[3:5]) / 2 - radius, 0)
        return pose_of(Rotation.identity(), np.append(rng.uniform(-free, free), _APART))

    @staticmethod
    def lifted(world: Pose) -> Pose:
        """A pose (4, 4), object to world, of what stands on a table, with the ring below it."""
        return pose_of(Rotation.identity(), [0, 0, 2 * _APART]) @ world

    def laid(self, scene: Scene, pose: Pose) -> Scene:
        """The scene with it at a pose (4, 4), ring to camera, its axes those of the room.

        Truth is in its frame. Targets are looked for where `pmcl board-poses` says.
        """
        texture = np.repeat(self.grey[..., None], 3, axis=2)
        sheet = Sheet(pose, self.size, texture, max(self.size))
        x, y, z = (pose[:3, :3] @ self.region[:3] + pose[:3, 3]).tolist()
        targets = tuple(replace(each, roi_center=(x, y, z), roi_size=self.region[3:])
                        for each in scene.targets)
        return replace(scene, sheets=(*scene.sheets, sheet), targets=targets,
                       origin=pose[:3, 3])


def _across(vertices: NDArray[np.float64]) -> float:
    """Diameter of a sphere about vertices (n, 3) [m]."""
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return 2 * float(np.linalg.norm(vertices - middle, axis=1).max())


def _covered(start: float, end: float, texel: float) -> NDArray[np.float64]:
    """(SIZE,) the share of each texel about the middle that lies from start to end [m]."""
    middle = np.arange(SIZE) - SIZE // 2
    return np.asarray((np.minimum(end / texel, middle + 0.5)
                       - np.maximum(start / texel, middle - 0.5)).clip(0, 1))
