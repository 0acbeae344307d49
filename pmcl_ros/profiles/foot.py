"""A stem on its foot: from above, foot and cone have the same outline."""

from dataclasses import replace

import numpy as np

from pmcl_ros.profiles.revolution import WIDEST_EDGE, Revolution

# In radii of the foot: height at which a stem is, its radius at most; height and radius of a foot.
_STEM, _SLIM = 0.8, 0.4
_USUAL_FOOT = (0.0, 1.0), (0.1, 1.0), (0.22, 0.4), (0.45, 0.0)  # 0: the stem's own radius
_SHARPEST = 1e-4  # m: of the edges


def standing_on_foot(surface: Revolution, spacing: float) -> Revolution | None:
    """The same surface with a usual foot below its stem; None: it has no stem.

    spacing: of the knots [m].
    """
    radii, heights = surface.without_edges
    wall = surface.wall
    foot = float(wall[wall[:, 1] < surface.low + WIDEST_EDGE, 0].max())
    above = heights > surface.low + _STEM * foot
    stem = float(np.interp(surface.low + _STEM * foot, heights, radii))
    if stem > _SLIM * foot or not above.any():
        return None
    parts = np.array((*_USUAL_FOOT, (_STEM, 0.0))) * foot
    parts[3:, 1] = stem
    found = Revolution.from_curve(
        surface.frame, np.append(surface.low + parts[:, 0], heights[above]),
        np.append(parts[:, 1], radii[above]), spacing)
    edges = np.array([parts[1, 0] / 3, surface.edges[1]])
    return replace(found.with_edges(edges, _SHARPEST), on_foot=True)
