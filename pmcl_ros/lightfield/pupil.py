"""The light that each view gets through the main lens' pupil: its amount and its centre."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.lenslets import DARKEST, Lenslets
from pmcl_ros.lightfield.light_field import nominal_positions
from pmcl_ros.runtime.errors import LightFieldError
from pmcl_ros.runtime.kernels import compiled, rounds

_BRIGHTEST = 1.1  # times the centre's light: more shows that the lattice is another camera's
_EVERY = 2  # only every second lenslet is measured: they cover all sub-pixel phases


@dataclass(frozen=True)
class Pupil:
    """The light of each view of a camera, means over its lenslets and the three colours.

    positions: (rows, columns, 2) x and y of the centre of all light that a sample sums, relative
        to the centre view's, in view steps (raw px). It lies nearer to the axis than its nominal
        step where the pupil's edge cuts the view.
    weights: (rows, columns) float32, the light relative to the centre view's; 0: outside.
    """

    positions: NDArray[np.float64]
    weights: NDArray[np.float32]

    @classmethod
    def measure(cls, light: NDArray[np.float32], lenslets: Lenslets, views: int) -> 'Pupil':
        """The pupil of `views` x `views` views one raw px apart.

        light: (height, width) relative to the lenslets' centres. A view is outside the pupil
        if half of its samples or more lie beyond the lenslet's disc, where a neighbour's begins,
        or if it gets less than a twentieth of the centre's light. Raises LightFieldError when
        other views get more light than the centre's: the lattice does not fit the light.
        """
        offsets = nominal_positions(views, views)
        height, width = light.shape
        reach = views // 2 + 2
        x, y = np.moveaxis(lenslets.centres[::_EVERY, ::_EVERY], -1, 0)
        whole = (x >= reach) & (y >= reach) & (x < width - 1 - reach) & (y < height - 1 - reach)
        if not whole.any():
            raise LightFieldError(f'no lenslet lies wholly on a sensor of {width}x{height}; the '
                                  'lattice of the calibration belongs to another camera')
        centres = np.stack([x[whole], y[whole]], axis=-1)
        sums = np.zeros((offsets.size // 2, 4))
        _look(light, centres, offsets.reshape(-1, 2), lenslets.radius, sums)
        covered, lit, across, along = sums.T.reshape(4, views, views)
        middle = views // 2
        centre = lit[middle, middle]
        if not lit.max() < _BRIGHTEST * centre:
            raise LightFieldError(
                f'the white image is {centre:.2f} bright under the centres of the lenslets, up to '
                f'{lit.max():.2f} beside them; the lattice of the calibration belongs to '
                'another camera, zoom or focus')
        inside = (covered > 0.5) & (lit > DARKEST * centre)
        found = np.stack([across, along], axis=-1)
        positions = np.where(inside[..., None], found - found[middle, middle], offsets)
        return cls(positions, np.where(inside, lit / centre, 0).astype(np.float32))


@compiled(parallel=True)
def _look(light, centres, offsets, radius, out, portion):  # type: ignore[no-untyped-def]
    """Fill out (offsets, 4): share of a sample in its lenslet's disc, its light, where that is."""
    for n in rounds(len(offsets), portion):
        covered = lit = across = along = 0.0
        seen = 0
        for k in range(len(centres)):
            cx, cy = centres[k, 0], centres[k, 1]
            x, y = cx + offsets[n, 0], cy + offsets[n, 1]
            x0, y0 = int(np.floor(x)) - 1, int(np.floor(y)) - 1
            got = np.zeros((3, 3))  # a row for each colour: light, its moments
            for v in range(y0, y0 + 4):
                for u in range(x0, x0 + 4):
                    weight = (2 - abs(v - y)) * (2 - abs(u - x))
                    square = (u - cx) ** 2 + (v - cy) ** 2
                    part = min(max(0.5 + (radius ** 2 - square) / (2 * radius), 0.0), 1.0)
                    covered += weight * part
                    red_blue = (u + v) % 2 == 0
                    colour = 2 * (u % 2) if red_blue else 1
                    share = weight * part * light[v, u] / (4 if red_blue else 8)
                    got[colour, 0] += share
                    got[colour, 1] += share * (u - cx)
                    got[colour, 2] += share * (v - cy)
            for colour in range(3):
                lit += got[colour, 0]
                if got[colour, 0] > 0.001:
                    across += got[colour, 1] / got[colour, 0]
                    along += got[colour, 2] / got[colour, 0]
                    seen += 1
        out[n, 0], out[n, 1] = covered / (16 * len(centres)), lit / (3 * len(centres))
        out[n, 2], out[n, 3] = across / max(seen, 1), along / max(seen, 1)
