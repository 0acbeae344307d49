"""A surface of revolution in the reference frame, and its contour in a camera, in closed form."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse

AXIS = 4  # parameters of the axis: shifts along x and y, turns about x and y, of its frame
ENDS = 4  # heights of bottom and top, radii of their edges
_FEWEST, _MOST = 13, 69  # pieces of the wall
_FINER = 4  # points of the wall between two knots
_EDGE = np.deg2rad(np.linspace(88, 0, 30))  # of an edge: how far the normal leans from the wall's
_NARROW = 0.8  # of the radius of the bottom
WIDEST_EDGE = 0.008  # m
_TURNED, _MOST_FILLED = np.deg2rad(5.0), 16  # about the axis, between two points of the wall
_ARC = 72  # points of half a circle, of bottom or top
_LEAST = 1e-4  # m: of the radii of a curve
_INSIDE = 0.0004  # m: a line of sight that enters the surface by less touches it
_SOLVED = 6  # steps in which the normals of edges are found
_LEVEL = 1e-4  # m: a camera is not nearer to the height of an edge
_STEEPEST = 200.0  # tangent of an edge's tilt
_LONGEST = 10.0  # px of contour that a point stands for
NEAREST = 0.02  # m: nothing is nearer to a camera


class RevolutionContour(NamedTuple):
    """The visible contour of a surface of revolution in one view, as n points.

    pixels: (n, 2), normals: (n, 2) outwards, in the image. depths: (n,) [m]. lengths: (n,) of the
    contour that each stands for [px]. motion: (n, p) along the normals, per unit of each parameter
    [px / m, px / rad]: radii, heights of bottom and top, the axis.
    """

    pixels: NDArray[np.float64]
    normals: NDArray[np.float64]
    depths: NDArray[np.float64]
    lengths: NDArray[np.float64]
    motion: NDArray[np.float64]


@dataclass(frozen=True)
class Revolution:
    """A closed surface of revolution: a wall, a flat bottom and a flat top, with round edges.

    frame: (4, 4) pose in the reference frame; its z is the axis, upwards. low, high: heights of
    bottom and top on it [m]. radii: (n,) coefficients of the cubic B-spline r(t) [m], where the
    height is low + t (high - low). breaks: its n - 2 knots in t, from 0 to 1. edges: radii of the
    edges of bottom and top [m]. on_foot: it is a stem on a foot, whose contours before the foot
    count too; of other surfaces the outline alone.
    """

    frame: NDArray[np.float64]
    low: float
    high: float
    radii: NDArray[np.float64]
    breaks: tuple[float, ...]
    edges: tuple[float, float] = (0.002, 0.001)
    on_foot: bool = False

    @classmethod
    def from_curve(cls, frame: NDArray[np.float64], heights: NDArray[np.float64],
                   radii: NDArray[np.float64], spacing: float) -> 'Revolution':
        """Of radii (m,) at heights (m,), ascending [m], with knots about `spacing` apart along it.

        So that a shallow bowl and the foot of a stemmed glass have as many as a steep wall.
        """
        low, high = float(heights[0]), float(heights[-1])
        way = np.concatenate([[0], np.cumsum(np.hypot(np.diff(heights), np.diff(radii)))])
        pieces = int(np.clip(way[-1] / spacing, _FEWEST, _MOST))
        at = np.interp(np.linspace(0, way[-1], pieces + 1), way, heights)
        breaks = tuple(((at - low) / (high - low)).tolist())
        t = _between(breaks)
        wanted = np.interp(low + t * (high - low), heights, radii)
        coefficients = np.linalg.lstsq(_spline(breaks)(t), wanted, rcond=None)[0]
        surface = cls(frame, low, high, np.maximum(coefficients, _LEAST), breaks)
        return surface.with_edges(np.array(cls.edges), _LEAST)

    @property
    def centred(self) -> NDArray[np.float64]:
        """(4, 4) `frame`, its origin moved to mid-height."""
        centred = self.frame.copy()
        centred[:3, 3] += (self.low + self.high) / 2 * centred[:3, 2]
        return centred

    @property
    def wall(self) -> NDArray[np.float64]:
        """(m, 2) the wall with its edges, from the bottom up: radius and height [m]."""
        return self._curve().points

    @property
    def motion(self) -> NDArray[np.float64]:
        """(m, n + ENDS) of the points of `wall` along their normals, per unit of a parameter."""
        curve = self._curve()
        return (np.concatenate([curve.basis, curve.by_ends], axis=1)
                / np.hypot(1, curve.lean)[:, None])

    @property
    def without_edges(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(m,) radii and heights of the wall, as if its edges were sharp."""
        t = _between(self.breaks)
        return _spline(self.breaks)(t) @ self.radii, self.low + t * (self.high - self.low)

    @property
    def foot(self) -> float:
        """Height above the bottom at which the wall is clearly narrower than there [m]."""
        radii, heights = self.without_edges
        narrow = radii < _NARROW * radii[0]
        return float(heights[narrow.argmax() if narrow.any() else -1] - self.low)

    @property
    def turns(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n - 2,) angles by which the wall turns at a coefficient, and (n - 2, n) change by each.

        Of its control polygon [rad, rad / m]. That they change with the height too is neglected.
        """
        steps = np.diff(_greville(self.breaks)) * (self.high - self.low)
        per_radius = np.diff(np.eye(len(self.radii)), axis=0) / steps[:, None]
        slopes = per_radius @ self.radii
        return (np.diff(np.arctan(slopes)),
                np.diff(per_radius / (1 + slopes ** 2)[:, None], axis=0))

    def _curve(self, with_edges: bool = True) -> '_Curve':
        """The wall, from the bottom up."""
        rise = self.high - self.low
        bottom, top = (edge * (1 - np.sin(_EDGE)) / rise for edge in self.edges)
        t = self._heights_on_wall()
        tilt = np.zeros(len(t))
        if with_edges:
            t = np.concatenate([bottom[:-1], t, 1 - top[-2::-1]])
            tilt = np.concatenate([_EDGE[:-1], tilt, -_EDGE[-2::-1]])
        return self._at(t, tilt)

    def _heights_on_wall(self) -> NDArray[np.float64]:
        """(m,) heights t between the edges, about even along the wall."""
        bottom, top = np.array(self.edges) / (self.high - self.low)
        t = _between(self.breaks)
        return np.concatenate([[bottom], t[(t > bottom) & (t < 1 - top)], [1 - top]])

    def _at(self, t: NDArray[np.float64], tilt: NDArray[np.float64]) -> '_Curve':
        """Points at heights t (m,).

        tilt: (m,) angle by which an edge turns the normal: down (positive) at the bottom, up at
        the top; 0: on the wall [rad].
        """
        rise = self.high - self.low
        spline = _spline(self.breaks)
        basis, slopes = spline(t), spline.derivative()(t)
        radii, slope = basis @ self.radii, slopes @ self.radii / rise
        by_ends = np.zeros((len(t), ENDS))
        by_ends[:, 0], by_ends[:, 1] = -slope * (1 - t), -slope * t  # as nz = -slope nr
        for end, on in ((0, tilt > 0), (1, tilt < 0)):
            sine, cosine = abs(np.sin(tilt[on])), np.cos(tilt[on])
            radii[on] -= self.edges[end] * (1 - cosine)
            # Its height stays where its end moves, and its depth changes with its radius.
            by_ends[on, end] -= np.tan(tilt[on])
            by_ends[on, 2 + end] = (1 - sine) / cosine - 1
        slope = slope + np.tan(tilt)
        return _Curve(np.stack([radii, self.low + t * rise], axis=1), -slope, basis, by_ends)

    def _edge(self, end: int, angles: NDArray[np.float64], aside: float, height: float
              ) -> '_Strip':
        """The edge of bottom (0) or top (1), where it is seen at angles (m,) about the axis."""
        rise, sign = self.high - self.low, 1 - 2 * end
        tilt = np.full(len(angles), sign * 0.5)
        for _ in range(_SOLVED):
            t = self.edges[end] * (1 - abs(np.sin(tilt))) / rise
            curve = self._at(end + sign * t, tilt)
            radii, heights = curve.points.T
            off = heights - height
            off = np.where(abs(off) > _LEVEL, off, np.copysign(_LEVEL, off))
            need = (radii - aside * np.cos(angles)) / off  # slope at a right angle to the sight
            tangent = need + curve.lean + np.tan(tilt)
            valid = (sign * tangent > 0) & (abs(tangent) < _STEEPEST)
            tilt = sign * np.arctan(np.clip(sign * tangent, 1e-6, _STEEPEST))
        return _Strip(valid, angles, curve)

    def moved(self, step: NDArray[np.float64], least: float) -> 'Revolution':
        """With parameters changed by a step (p,). least: of the radii [m]."""
        n = len(self.radii)
        dx, dy, about_x, about_y = step[n + ENDS:]
        frame = self.frame @ _small(dx, dy, about_x, about_y)
        low, high = self.low + step[n], self.high + step[n + 1]
        if high - low < 2 * least:
            low, high = self.low, self.high
        radii = np.maximum(self.radii + step[:n], least)
        edges = np.array(self.edges) + step[n + 2:n + ENDS]
        return replace(self, frame=frame, low=low, high=high, radii=radii).with_edges(edges, least)

    def with_edges(self, edges: NDArray[np.float64], least: float) -> 'Revolution':
        """With other radii (2,) of the edges, or the nearest possible ones [m].

        least: of the radii of the wall [m].
        """
        largest = np.minimum(min(WIDEST_EDGE, (self.high - self.low) / 4),
                             self.radii[[0, -1]] - least / 2)
        bottom, top = np.clip(edges, least / 2, largest).tolist()
        return replace(self, edges=(bottom, top))

    def contour(self, pinhole: Pinhole, camera: NDArray[np.float64]) -> RevolutionContour:
        """The contour in a camera at a pose (4, 4) in the reference frame.

        A point of the surface is on it where the normal is at a right angle to the line of sight:
        nr (r - a cos f) + nz (z - h) = 0 with the camera at the distance a from the axis and at
        the height h, and f the angle about the axis from the camera to the point. Edges are solved
        for even angles, as they are seen over a few of their normals.
        """
        into = inverse(self.frame) @ camera
        aside, height = float(np.hypot(*into[:2, 3])), float(into[2, 3])
        azimuth = float(np.arctan2(into[1, 3], into[0, 3]))
        t = self._heights_on_wall()
        angles, _ = _seen_at(self._at(t, np.zeros(len(t))), aside, height)
        t = _filled(t, angles)
        curve = self._at(t, np.zeros(len(t)))
        angles, cosine = _seen_at(curve, aside, height)
        strips = [_Strip(np.abs(cosine) < 1, sign * angles, curve) for sign in (-1, 1)]
        turn = (np.arange(2 * _ARC) + 0.5) * np.pi / _ARC
        strips += [self._edge(end, turn, aside, height) for end in (0, 1)]
        wall = self.wall
        seen = [each.seen(pinhole, inverse(into), azimuth) for each in strips]
        parts = [_unhidden(*each, wall, into[:3, 3], self.on_foot) for each in seen]
        return RevolutionContour(*map(np.concatenate, zip(*parts, strict=True)))


@dataclass(frozen=True)
class _Curve:
    """Points (m, 2) of a wall: radius and height [m]; lean: (m,) nz / nr of the normals.

    basis: (m, n) change of the radius with the coefficients. by_ends: (m, ENDS) motion along the
    normals with the ends' parameters, over nr.
    """

    points: NDArray[np.float64]
    lean: NDArray[np.float64]
    basis: NDArray[np.float64]
    by_ends: NDArray[np.float64]


@dataclass(frozen=True)
class _Strip:
    """Points of a curve at angles (m,) about the axis; on the contour where `valid`."""

    valid: NDArray[np.bool_]
    angles: NDArray[np.float64]
    curve: _Curve

    def seen(self, pinhole: Pinhole, camera: NDArray[np.float64], azimuth: float
             ) -> tuple[RevolutionContour, NDArray[np.float64]]:
        """The valid points as contour, and their places (n, 3). camera: (4, 4) from the frame."""
        cosine, sine = np.cos(self.angles + azimuth), np.sin(self.angles + azimuth)
        (radii, heights), lean = self.curve.points.T, self.curve.lean
        places = np.stack([radii * cosine, radii * sine, heights], axis=1)
        flat = 1 / np.hypot(1, lean)
        normals = np.stack([flat * cosine, flat * sine, flat * lean], axis=1)
        x, y, z = (places @ camera[:3, :3].T + camera[:3, 3]).T
        nx, ny, nz = (normals @ camera[:3, :3].T).T
        z = np.maximum(z, NEAREST)
        pixels = np.stack([pinhole.fx * x / z + pinhole.cx, pinhole.fy * y / z + pinhole.cy], -1)
        across = np.stack([nx / pinhole.fx, ny / pinhole.fy], axis=1)
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
        scale = (across[:, 0] * pinhole.fx * (nx - x / z * nz)
                 + across[:, 1] * pinhole.fy * (ny - y / z * nz)) / z
        steps = np.linalg.norm(np.diff(pixels, axis=0), axis=1)
        steps = np.minimum(steps, _LONGEST) * (self.valid[1:] & self.valid[:-1])
        lengths = (np.append(steps, 0) + np.append(0, steps)) / 2
        motion = np.concatenate([
            flat[:, None] * self.curve.basis, flat[:, None] * self.curve.by_ends,
            normals[:, :2], np.cross(places, normals)[:, :2]], axis=1) * scale[:, None]
        kept = self.valid & (lengths > 0) & (z > NEAREST)
        whole = pixels, across, z, lengths, motion
        return RevolutionContour(*(each[kept] for each in whole)), places[kept]


def _seen_at(curve: _Curve, aside: float, height: float
             ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(m,) angles about the axis at which points are on the contour, and their cosines.

    Not between -1 and 1: nowhere.
    """
    radii, heights = curve.points.T
    cosine = (radii + curve.lean * (heights - height)) / max(aside, 1e-9)
    return np.arccos(np.clip(cosine, -1, 1)), cosine


def _filled(t: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights t (m,) and more between them, where the contour turns far about the axis."""
    pieces = np.clip(np.ceil(abs(np.diff(angles)) / _TURNED), 1, _MOST_FILLED).astype(int)
    first = np.cumsum(pieces) - pieces
    part = (np.arange(pieces.sum()) - np.repeat(first, pieces)) / np.repeat(pieces, pieces)
    return np.append(np.repeat(t[:-1], pieces) + part * np.repeat(np.diff(t), pieces), t[-1])


def _unhidden(contour: RevolutionContour, places: NDArray[np.float64],
              wall: NDArray[np.float64], eye: NDArray[np.float64], before: bool
              ) -> RevolutionContour:
    """The points of the outline: their lines of sight meet nothing else of the stack of discs.

    places: (n, 3) of the points, eye: (3,) the camera, in the frame of the surface [m]. before:
    also those that meet some of it behind the point.
    """
    with np.errstate(divide='ignore', invalid='ignore'):
        part = (wall[:, 1] - eye[2]) / (places[:, 2:] - eye[2])
        met = eye[:2] + part[..., None] * (places[:, None, :2] - eye[:2])
        inside = np.hypot(met[..., 0], met[..., 1]) < wall[:, 0] - _INSIDE
    seen = ~(inside & (part > 0) & (part < (1 if before else np.inf))).any(axis=1)
    return RevolutionContour(*(each[seen] for each in contour))


def _small(dx: float, dy: float, about_x: float, about_y: float) -> NDArray[np.float64]:
    """(4, 4) a small motion in the frame of the axis."""
    angle = float(np.hypot(about_x, about_y))
    motion = np.eye(4)
    if angle > 0:
        x, y = about_x / angle, about_y / angle
        cross = np.array([[0, 0, y], [0, 0, -x], [-y, x, 0]])
        motion[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    motion[:2, 3] = dx, dy
    return motion


def _between(breaks: tuple[float, ...]) -> NDArray[np.float64]:
    """The knots and `_FINER` - 1 places between two of them."""
    pieces = len(breaks) - 1
    return np.interp(np.arange(_FINER * pieces + 1) / _FINER, np.arange(pieces + 1), breaks)


@lru_cache(maxsize=64)
def _spline(breaks: tuple[float, ...]) -> BSpline:
    """The cubic B-splines with these knots, clamped to 0 and 1."""
    knots = np.concatenate([np.zeros(3), breaks, np.ones(3)])
    return BSpline(knots, np.eye(len(breaks) + 2), 3)


@lru_cache(maxsize=64)
def _greville(breaks: tuple[float, ...]) -> NDArray[np.float64]:
    """(n,) where each coefficient of `_spline` counts most."""
    knots = np.concatenate([np.zeros(2), breaks, np.ones(2)])
    return np.convolve(knots, np.ones(3) / 3, mode='valid')
