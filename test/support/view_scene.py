"""Pictures of a made-up scene from cameras side by side, by casting a ray for each pixel."""

from dataclasses import dataclass

import numpy as np

from pmcl_ros.geometry.pinhole import Pinhole


@dataclass(frozen=True)
class Scene:
    """A patterned wall and a disc before it; wall, disc, radius in metres."""

    wall: float = 2.0
    disc: float = 1.0
    radius: float = 0.14

    def picture(self, pinhole: Pinhole, x, y, focus=np.inf):
        """(height, width, 3) linear light seen by a camera at (x, y, 0) [m].

        Its sensor is shifted so that what is at depth `focus` on the axis through 0 is seen in
        the picture's principal point.
        """
        v, u = np.mgrid[:pinhole.height, :pinhole.width].astype(float)
        across = (u - pinhole.cx) / pinhole.fx - x / focus
        down = (v - pinhole.cy) / pinhole.fy - y / focus
        on_disc = x + across * self.disc, y + down * self.disc
        # Its edge is soft, a few pixels wide, as a lens leaves it.
        hit = 0.5 + 0.5 * np.tanh((self.radius - np.hypot(*on_disc)) / (0.01 * self.disc))
        wall = _pattern((x + across * self.wall) / self.wall, (y + down * self.wall) / self.wall,
                        0)
        disc = _pattern(on_disc[0] / self.disc, on_disc[1] / self.disc, 2)
        return wall + hit[..., None] * (disc - wall)

    def depth(self, pinhole: Pinhole):
        """(height, width) as seen from 0."""
        v, u = np.mgrid[:pinhole.height, :pinhole.width].astype(float)
        distance = np.hypot((u - pinhole.cx) / pinhole.fx, (v - pinhole.cy) / pinhole.fy)
        return np.where(distance * self.disc < self.radius, self.disc, self.wall)


def _pattern(a, b, kind):
    """RGB in [0.1, 0.9] of directions a, b; up to 0.1 cycles per px at 150 px per unit."""
    phases = [80 * a + 23 * b + kind, 85 * b - 31 * a + 2 * kind, 47 * (a + b) - kind]
    return 0.5 + 0.4 * np.sin(np.stack(phases, axis=-1))
