"""Vessels of revolution from a mesh of their outside: its outline, less a cavity.

Outlines are (n, 2) of (r, z) [m], from the axis at the bottom to the axis at the top.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import ObjectModelError
from pmcl_ros.simulation.described.geometry_kernel import manifold
from pmcl_ros.simulation.scenes.shapes.vessels import Profile, Vessel

_SAME = 1e-6  # m: heights that differ by less are one
_ASIDE = 1e-7  # m: beside a height at which the radius may jump
_MOST = 500  # heights at which an outline is taken
_MM = 1000.0  # the kernel's coordinates are rounded to 1e-8
_FAR = 1e5  # mm
_FILLET = 2.0  # mm: radius in which wall and floor of a cavity meet, at most
_ROUND, _ROUNDEST = 0.45, 1.5  # radius of the rim over the wall, and at most [mm]
_LOST = 1.5  # mm: by which rounding makes a vessel lower or narrower, at most
_SHARP = 0.01  # mm: smaller radii are left out
_ABOVE = 0.005  # m: by which an inner surface may reach beyond the rim
_CREST = 0.7  # of the wall: at most so far out of the crest of a rim does the wall begin
_SEGMENTS = 48  # of a full turn of these
_EPSILON = 1e-4  # mm: points nearer than that to a line are left out
_MITRE = 4.0  # widths of an offset: what a sharp corner may stick out
_THIN = 0.01  # mm: of the slice in which a rim is measured
_AXIS = 1e-6  # mm


def outline(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Profile:
    """The outline of a mesh of revolution about z, exact at its vertices.

    Radii are the largest at each height, so a cavity in the mesh does not count; the bottom may be
    concave.
    """
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    r, z = np.linalg.norm(vertices[:, :2], axis=1)[edges], vertices[:, 2][edges]
    heights = _levels(z)
    beside = np.stack([heights[:-1] + _ASIDE, heights[1:] - _ASIDE], axis=1).ravel()
    radii = _largest(z, r, beside)
    side = np.stack([radii, np.stack([heights[:-1], heights[1:]], axis=1).ravel()], axis=1)
    side = side[np.isfinite(radii)]
    inward = _levels(r[r.max(axis=1) < side[0, 0] + _SAME])
    lowest = -_largest(r, -z, inward + _ASIDE)
    known = np.isfinite(lowest) & (inward < side[0, 0] - _SAME)
    bottom = np.stack([inward, lowest], axis=1)[known]
    if not len(bottom):
        bottom = side[:1]
    profile = np.concatenate([[[0, bottom[0, 1]]], bottom, side, [[0, side[-1, 1]]]])
    return profile[np.append(True, np.linalg.norm(np.diff(profile, axis=0), axis=1) > _SAME)]


def _levels(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Different values, ascending; evenly spaced ones where they are too many."""
    known = np.unique(values)
    known = known[np.append(True, np.diff(known) > _SAME)] if len(known) else known
    return known if len(known) <= _MOST else np.linspace(known[0], known[-1], _MOST)


def _largest(along: NDArray[np.float64], across: NDArray[np.float64], levels: NDArray[np.float64]
             ) -> NDArray[np.float64]:
    """The largest coordinate across that edges (n, 2) have at levels along them; -inf: none."""
    low, high = along.min(axis=1), along.max(axis=1)
    found = np.full(len(levels), -np.inf)
    for number, level in enumerate(levels):
        at = (low <= level) & (level <= high) & (low < high)
        part = (level - along[at, 0]) / (along[at, 1] - along[at, 0])
        found[number] = (across[at, 0] + part * (across[at, 1] - across[at, 0])).max(
            initial=-np.inf)
    return found


def eased(profile: Profile) -> Profile:
    """The same curve; long straight pieces beside short ones get points near their ends.

    Normals change smoothly along a piece: they would change along the whole wall otherwise.
    """
    step = np.diff(profile, axis=0)
    length = np.linalg.norm(step, axis=1)
    near = 2 * np.append(length[0], length[:-1]) / length
    far = 1 - 2 * np.append(length[1:], length[-1]) / length
    parts = np.stack([np.zeros_like(length), near, far], axis=1)
    kept = np.stack([np.ones_like(near, bool), near < 0.5, far > 0.5], axis=1)
    points = profile[:-1, None] + parts[..., None] * step[:, None]
    return np.concatenate([points[kept], profile[-1:]])


def volume(profile: Profile) -> float:
    """Of the body that an outline turns about the axis [m^3]."""
    (r0, z0), (r1, z1) = profile[:-1].T, profile[1:].T
    return float((np.pi / 3 * (z1 - z0) * (r0 * r0 + r0 * r1 + r1 * r1)).sum())


def hollowed(outer: Profile, wall: float, is_open: bool, floor: float | None) -> Vessel:
    """A vessel whose cavity keeps a distance `wall` [m] from an outline.

    is_open: the cavity has its mouth at the top, with a round rim. floor: height below which the
    vessel is massive [m]. The cavity's floor meets its wall in a fillet. Raises ObjectModelError
    where no cavity is left.
    """
    body = _section(outer)
    if wall >= np.ptp(outer[:, 1]):
        raise ObjectModelError(f'a wall of {wall:g} m leaves no cavity: the object is '
                               f'{np.ptp(outer[:, 1]):.3g} m high')
    cavity = _section(_beyond(outer, wall) if is_open else outer).offset(
        -_MM * wall, manifold().JoinType.Miter, _MITRE)
    if floor is not None:
        cavity ^= _band(_MM * floor, _FAR)
    cavity = _chosen(cavity, is_open, _MM * outer[-1, 1], f'a wall of {wall:g} m')
    low = cavity.bounds()[1]
    fillet = min(_FILLET, _MM * wall)
    cavity -= (cavity - _opened(cavity, fillet)) ^ _band(low - 1, low + 2 * fillet)
    return _vessel(body - cavity, is_open)


def fitted(outer: Profile, inner: Profile, is_open: bool, floor: float | None) -> Vessel:
    """As `hollowed`, from the outline of its cavity."""
    if inner[:, 1].max() > outer[:, 1].max() + _ABOVE:
        raise _apart()
    cavity = _section(_beyond(inner, 0.001) if is_open else inner)
    if floor is not None:
        cavity ^= _band(_MM * floor, _FAR)
    top = _MM * outer[-1, 1]
    cavity = _chosen(cavity, is_open, top, 'the inner surface')
    body = _section(outer)
    if (cavity - body - _band(top - 1, _FAR)).area() > 1e-3 * cavity.area():
        raise _apart()
    return _vessel(body - cavity, is_open)


def _apart() -> ObjectModelError:
    return ObjectModelError('the inner surface lies partly outside of the outer one: are both '
                            'meshes in the same frame and scale?')


def _beyond(profile: Profile, wall: float) -> Profile:
    """An outline whose wall goes straight on beyond the mouth, without the rim's rounding.

    A cavity in it leaves the crest of a round rim, where the outline is highest, in place.
    """
    z = profile[:, 1]
    top = float(z.max())
    foot = int(np.flatnonzero(z < z.min() + _SAME)[-1])  # where the side begins
    start = max(int(np.argmax(z > top - wall)), foot)
    lower, upper = np.interp([top - 2 * wall, top - wall], z[foot:start + 1],
                             profile[foot:start + 1, 0])
    on = upper + float(np.clip(upper - lower, -wall, wall))
    crest = profile[z > top - _SAME, 0].max()
    mouth = min(on, crest + _CREST * wall)
    return np.concatenate([profile[:start], [[upper, top - wall], [mouth, top],
                                             [mouth, top + 2 * wall], [0, top + 2 * wall]]])


def _section(profile: Profile) -> Any:
    """The cut of a body of revolution with a plane through its axis [mm]."""
    both = np.concatenate([profile, profile[-2:0:-1] * [-1, 1]])
    return manifold().CrossSection([_MM * both], manifold().FillRule.Positive)


def _band(low: float, high: float) -> Any:
    """All between two heights [mm]."""
    return manifold().CrossSection([np.array([[-_FAR, low], [_FAR, low], [_FAR, high],
                                              [-_FAR, high]])])


def _opened(section: Any, radius: float) -> Any:
    """A section whose outward corners are round [mm]."""
    joins = manifold().JoinType
    return section.offset(-radius, joins.Miter, _MITRE).offset(
        radius, joins.Round, _MITRE, _SEGMENTS)


def _chosen(cavity: Any, is_open: bool, top: float, of: str) -> Any:
    """The part of a cavity that has the mouth, or the largest one where it is closed."""
    parts = [each for each in cavity.decompose() if not each.is_empty()
             and (not is_open or each.bounds()[3] >= top)]
    if not parts:
        raise ObjectModelError(f'{of} leaves no cavity' + (' that reaches the mouth' if is_open
                                                           else ''))
    return max(parts, key=lambda each: each.area())


def _vessel(body: Any, is_open: bool) -> Vessel:
    """The vessel of a section, which still has a sharp rim. ObjectModelError for an empty one."""
    if body.is_empty():
        raise ObjectModelError('the cavity leaves no wall: is the inner surface the outer one?')
    if is_open:
        top = body.bounds()[3]
        rim = (body ^ _band(top - _THIN, top)).area() / (2 * _THIN)
        body = _rounded(body, min(_ROUND * rim, _ROUNDEST), _band(top - rim, top + 1))
    right = manifold().CrossSection([np.array([[0, -_FAR], [_FAR, -_FAR], [_FAR, _FAR],
                                               [0, _FAR]])])
    rings = (body ^ right).simplify(_EPSILON).to_polygons()
    if not rings:
        raise _no_vessel()
    chains = _chains(np.asarray(max(rings, key=np.ptp), float))
    if len(chains) != (1 if is_open else 2):
        raise _no_vessel()
    if is_open:
        crest = int(chains[0][:, 1].argmax())
        outer, inner = chains[0][:crest + 1], chains[0][crest:]
    else:
        outer, inner = sorted(chains, key=lambda each: -each[:, 0].max())
    return Vessel('described', outer / _MM, inner / _MM)


def _rounded(body: Any, radius: float, where: Any) -> Any:
    """A section whose corners in a band are round, by a radius [mm] or a smaller one.

    A wall that leans ends in a wedge, of which a large radius would take much away.
    """
    while radius > _SHARP:
        made = (body - ((body - _opened(body, radius)) ^ where)).simplify(_EPSILON)
        whole = max(made.decompose(), key=lambda each: each.area())  # without the wedge's tip
        if np.allclose(whole.bounds(), body.bounds(), 0, _LOST):
            return whole
        radius /= 2
    return body


def _no_vessel() -> ObjectModelError:
    return ObjectModelError('wall, floor and mouth make no vessel: its cavity must be one, and a '
                            'massive floor below it')


def _chains(ring: NDArray[np.float64]) -> list[Profile]:
    """The pieces of a closed polygon (n, 2) between its edges on the axis, each eased."""
    ring[ring[:, 0] < _AXIS, 0] = 0
    on_axis = (ring[:, 0] == 0) & (np.roll(ring[:, 0], -1) == 0)  # the edge that begins there
    first = int(on_axis.argmax()) + 1
    ring, on_axis = np.roll(ring, -first, axis=0), np.roll(on_axis, -first)
    if not on_axis.any():
        raise _no_vessel()
    starts = np.concatenate([[0], np.flatnonzero(on_axis)[:-1] + 1])
    ends = np.flatnonzero(on_axis) + 1
    return [eased(ring[start:end]) for start, end in zip(starts, ends, strict=True)]
