"""Draws random vessels: bottles, glasses, jars, bowls, with walls, floors and rims."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d, grey_erosion

from pmcl_ros.simulation.scenes.shapes.revolution import Frusta

_STEP = 0.0012  # m between points of a profile
_FINE = 1500  # heights at which radii are computed
_SECTIONS = 64  # of the mesh, around the axis

Profile = NDArray[np.float64]
Knots = tuple[list[float], list[float]]


@dataclass(frozen=True)
class Vessel:
    """A surface of revolution about z, its origin at mid-height.

    outer: (n, 2) of (r, z) [m], from the axis at the bottom to the crest of the rim. inner: (m, 2)
    from there to the axis at the floor of the cavity. A sealed one has no rim: outer ends and
    inner begins on the axis.
    """

    kind: str
    outer: Profile
    inner: Profile

    @property
    def closed(self) -> Profile:
        """The outer surface with a lid at the rim's height, as in the meshes of objects."""
        return np.concatenate([self.outer, [[0, self.outer[-1, 1]]]])

    @property
    def is_sealed(self) -> bool:
        """Whether the cavity has no mouth."""
        return bool(self.inner[0, 0] == 0)

    def surface(self, level: float | None = None, within: int = 0) -> Frusta:
        """Its interfaces: it is medium 1, and holds a liquid, medium 2, up to a height z [m].

        within: the medium of the cavity above the liquid, where it is sealed.
        """
        above, below = (self.inner, None) if level is None else self.inside(level)
        if self.is_sealed:
            dry = Frusta.from_profile(self.outer, 0, 1) + Frusta.from_profile(above, within, 1)
        else:
            dry = Frusta.from_profile(np.concatenate([self.outer, above[1:]]), 0, 1)
        if below is None:
            return dry
        top = np.array([above[-1], [0, above[-1, 1]]])
        return (dry + Frusta.from_profile(below, 2, 1)
                + Frusta.from_profile(top, within if self.is_sealed else 0, 2))

    def inside(self, level: float) -> tuple[Profile, Profile]:
        """The inner profile above and below a height z [m], each from the top down."""
        first = int(np.argmax(self.inner[:, 1] < level))
        (r0, z0), (r1, z1) = self.inner[first], self.inner[first - 1]
        wet = np.array([[np.interp(level, [z0, z1], [r0, r1]), level]])
        return (np.concatenate([self.inner[:first], wet]),
                np.concatenate([wet, self.inner[first:]]))


def outer_mesh(profile: Profile) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (n, 3) [m] and faces (m, 3) of a profile that begins and ends on the axis."""
    mesh = trimesh.creation.revolve(profile, sections=_SECTIONS)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.remove_unreferenced_vertices()
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


def random_vessel(rng: np.random.Generator, kinds: tuple[str, ...] = (),
                  walls: tuple[float, float] = (0.0012, 0.005)) -> Vessel:
    """Draw a vessel of one of `kinds` (default: any of `KINDS`), its wall within limits [m]."""
    names = kinds or tuple(KINDS)
    kind = names[int(rng.integers(len(names)))]
    (heights, radii), cavity = KINDS[kind](rng)
    wall = float(np.exp(rng.uniform(np.log(walls[0]), np.log(walls[1]))))
    z = np.linspace(0, heights[-1], _FINE)
    outer = np.asarray(PchipInterpolator(heights, radii)(z))
    corner = min(float(rng.uniform(0.0005, 0.008)), 0.3 * radii[0], 0.3 * heights[1])
    dip = np.clip(corner - z, 0, None)
    outer -= corner - np.sqrt(np.maximum(corner ** 2 - dip ** 2, 0))
    inner = _cavity(z, outer, wall, cavity, rng)
    return _joined(kind, z, outer, inner, rng)


def _cavity(z: Profile, outer: Profile, wall: float, start: float, rng: np.random.Generator
            ) -> Profile:
    """Radii of the cavity at heights z, NaN below its floor. start: least height of the floor."""
    step = z[1] - z[0]
    reach = int(wall / step)
    ball = np.sqrt(np.maximum(wall ** 2 - (step * np.arange(-reach, reach + 1)) ** 2, 0))
    # The cavity keeps a distance of the wall's thickness from the outer surface.
    inner = grey_erosion(outer, structure=ball, mode='nearest')
    inner = gaussian_filter1d(inner, 0.0005 / step, mode='nearest')
    low = z < start + wall * rng.uniform(1, 2.5)
    narrow = np.flatnonzero(low | (inner < 0.0015))
    floor = z[min(narrow[-1] + 1, len(z) - 40)]
    depth = rng.uniform(0.002, max(0.003, min(0.5 * outer.max(), 0.4 * (z[-1] - floor))))
    power = rng.uniform(2, 4)
    up = np.clip((floor + depth - z) / depth, 0, 1)
    wide = inner[np.searchsorted(z, floor + depth).clip(0, len(z) - 1)]
    rounded = wide * (1 - up ** power) ** (1 / power)
    inner = np.where(z < floor + depth, np.minimum(inner, rounded), inner)
    return np.where(z >= floor, np.maximum(inner, 0), np.nan)


def _joined(kind: str, z: Profile, outer: Profile, inner: Profile, rng: np.random.Generator
            ) -> Vessel:
    """Close bottom and rim, put the origin at mid-height."""
    half = 0.5 * (outer[-1] - inner[-1])
    below = z < z[-1] - half - 0.3 * _STEP
    turn = np.linspace(0, np.pi / 2, 6)
    middle, base = outer[-1] - half, z[-1] - half
    outside = np.stack([outer[below], z[below]], axis=1)
    crest = np.stack([middle + half * np.cos(turn), base + half * np.sin(turn)], axis=1)
    foot = outside[0, 0]
    r = np.linspace(0, 0.85 * foot, 12)
    floor = float(z[np.isfinite(inner)][0])
    thick = z[np.argmax(outer < 0.8 * outer.max())] if kind == 'stemmed' else floor
    kick = rng.uniform(0, 0.5) * max(thick - 0.002, 0) * (1 - (r / r[-1]) ** 2) ** 2
    bottom = np.stack([r, kick], axis=1)
    hollow = np.isfinite(inner) & below
    down = np.stack([inner[hollow], z[hollow]], axis=1)[::-1]
    fall = np.stack([middle - half * np.sin(turn), base + half * np.cos(turn)], axis=1)
    inside = np.concatenate([fall, resampled(down), [[0, floor]]])
    lift = np.array([0, z[-1] / 2])
    return Vessel(kind, np.concatenate([bottom, resampled(outside), crest]) - lift, inside - lift)


def resampled(profile: Profile, step: float = _STEP, least: int = 4) -> Profile:
    """The same curve of points about a step apart [m], and of so many at least.

    It may be empty, as of a wall that leaves no cavity.
    """
    if not len(profile):
        return profile
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    at = np.linspace(0, way[-1], max(least, int(way[-1] / step)))
    return np.stack([np.interp(at, way, profile[:, 0]), np.interp(at, way, profile[:, 1])], axis=1)


def _tumbler(rng: np.random.Generator) -> tuple[Knots, float]:
    height, top = rng.uniform(0.07, 0.16), rng.uniform(0.026, 0.045)
    foot = top * rng.uniform(0.65, 1.02)
    waist = 0.5 * (top + foot) * rng.uniform(0.92, 1.12)
    return ([0, 0.5 * height, height], [foot, waist, top]), 0.002


def _stemmed(rng: np.random.Generator) -> tuple[Knots, float]:
    height, bowl = rng.uniform(0.11, 0.2), rng.uniform(0.024, 0.045)
    foot, stem = rng.uniform(0.025, 0.04), rng.uniform(0.003, 0.006)
    start = height * rng.uniform(0.3, 0.55)
    top = bowl * rng.uniform(0.7, 1.15)
    thick = rng.uniform(0.002, 0.004)
    return ([0, thick, thick + 0.004, thick + 0.012, start, start + 0.3 * (height - start),
             start + 0.6 * (height - start), height],
            [foot, 0.98 * foot, 0.4 * foot, stem, stem * 1.1, 0.85 * bowl, bowl, top]), start


def _bottle(rng: np.random.Generator) -> tuple[Knots, float]:
    height, body = rng.uniform(0.12, 0.22), rng.uniform(0.022, 0.04)
    neck = body * rng.uniform(0.3, 0.55)
    shoulder = height * rng.uniform(0.45, 0.72)
    collar = shoulder + (height - shoulder) * rng.uniform(0.3, 0.7)
    bead = neck * rng.uniform(1, 1.25)
    lip = height - rng.uniform(0.006, 0.014)
    return ([0, 0.02, shoulder, collar, max(lip, collar + 0.003), height - 0.003, height],
            [body * rng.uniform(0.88, 1), body, body * rng.uniform(0.92, 1.0), neck * 1.05, neck,
             bead, bead]), 0.003


def _jar(rng: np.random.Generator) -> tuple[Knots, float]:
    height, body = rng.uniform(0.07, 0.14), rng.uniform(0.03, 0.05)
    mouth = body * rng.uniform(0.65, 0.92)
    shoulder = height * rng.uniform(0.7, 0.82)
    neck = shoulder + rng.uniform(0.15, 0.4) * (height - shoulder)
    return ([0, 0.15 * height, shoulder, neck, 0.97 * height, height],
            [body * rng.uniform(0.85, 1), body, body * rng.uniform(0.95, 1), mouth, mouth,
             mouth * rng.uniform(1, 1.05)]), 0.003


def _bowl(rng: np.random.Generator) -> tuple[Knots, float]:
    height, top = rng.uniform(0.035, 0.08), rng.uniform(0.04, 0.07)
    foot = top * rng.uniform(0.35, 0.7)
    return ([0, 0.12 * height, 0.5 * height, height],
            [foot, foot * rng.uniform(1, 1.2), top * rng.uniform(0.75, 0.95), top]), 0.003


def _free(rng: np.random.Generator) -> tuple[Knots, float]:
    """A free form of four to seven radii, each close to the one before."""
    height, count = rng.uniform(0.07, 0.19), int(rng.integers(4, 8))
    steps = np.cumsum(rng.normal(0, 0.28, count))
    radii = rng.uniform(0.022, 0.04) * np.exp(steps - steps.mean())
    heights = np.concatenate([[0], np.sort(rng.uniform(0.12, 0.9, count - 2)), [1]]) * height
    heights = np.maximum.accumulate(heights + 0.003 * np.arange(count))
    return (heights.tolist(), np.clip(radii, 0.008, 0.055).tolist()), 0.003


KINDS: dict[str, Callable[[np.random.Generator], tuple[Knots, float]]] = {
    'tumbler': _tumbler, 'stemmed': _stemmed, 'bottle': _bottle, 'jar': _jar, 'bowl': _bowl,
    'free': _free}
