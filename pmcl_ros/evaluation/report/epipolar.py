"""Epipolar slices: one row of pixels through a row of views, in which depth is a slope."""

from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.markup import figure, figures, key, section
from pmcl_ros.evaluation.report.outlines import Along, cut, depths_at, middle
from pmcl_ros.evaluation.report.plot import Plot
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.view_grid import ViewGrid

_MARGIN = 0.25  # of the object's width that is shown on each side of it
_SIZE = 460.0, 160.0  # of the drawing


class EpipolarSlice(NamedTuple):
    """pixels: (views, length, 3) uint8, as shown. positions: (views,) of the views [view steps].

    along: the axis of the image and of the aperture.
    """

    pixels: NDArray[np.uint8]
    positions: NDArray[np.float64]
    along: Along


def epipolar_slice(light_field: LightField, along: Along, pixel: int) -> EpipolarSlice:
    """The row of pixels `pixel` through the centre's row of views; of 'y': columns of both.

    Views without light are left out.
    """
    row, column = light_field.grid.centre
    if along == 'x':
        views, positions, weights = (light_field.views[row, :, pixel],
                                     light_field.grid.positions[row, :, 0],
                                     light_field.grid.weights[row])
    else:
        views, positions, weights = (light_field.views[:, column, :, pixel],
                                     light_field.grid.positions[:, column, 1],
                                     light_field.grid.weights[:, column])
    lit = weights > 0
    shown = light_field.colour.displayed(views[lit], light_field.gamma)
    return EpipolarSlice(shown, positions[lit], along)


def track(grid: ViewGrid, along: Along, pixel: float, depth: float,
          positions: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n,) where views at `positions` (n,) see what the centre view sees at `pixel`, [px].

    depth: of it [m]. A view step moves it by focal length x baseline / depth (`ViewGrid`).
    """
    focal = grid.pinhole.fx if along == 'x' else grid.pinhole.fy
    return pixel - focal * grid.baseline / depth * np.asarray(positions, float)


def epipolar_section(run: Localization) -> Element:
    """Slices along x and y through the middle of the object."""
    point = run.light_field.grid.pinhole.project(middle(run.model, run.estimate.pose))
    if not np.isfinite(point).all():
        return section('Epipolar slices', 'epipolar', 'The estimate is behind the camera.')
    x, y = point.tolist()
    return section(
        'Epipolar slices', 'epipolar',
        'One line of pixels in each view of a line of views, stacked. What is near moves faster '
        'from view to view: it leans more. The lines lean as what lies at their depths should.',
        key(('rim', "at the object's edges, at their depth"), ('front', 'its front'),
            ('on estimate', 'its middle'), ('back', 'its back')),
        figures(_figure(run, 'x', y, x), _figure(run, 'y', x, y)))


def _figure(run: Localization, along: Along, line: float, centre: float) -> Element:
    grid = run.light_field.grid
    width, height = grid.pinhole.width, grid.pinhole.height
    length, other = (width, height) if along == 'x' else (height, width)
    pixel = int(np.clip(round(line), 0, other - 1))
    pieces = cut(grid.pinhole, run.model, run.estimate.pose, along, pixel)
    ends = pieces[..., 0] if len(pieces) else np.array([centre - 20, centre + 20])
    spread = _MARGIN * float(np.ptp(ends)) + 8
    low = int(np.clip(ends.min() - spread, 0, length - 2))
    high = int(np.clip(ends.max() + spread, low + 2, length))
    epi = epipolar_slice(run.light_field, along, pixel)
    first, last = float(epi.positions[0]), float(epi.positions[-1])
    half = (last - first) / max(len(epi.positions) - 1, 1) / 2
    plot = Plot((low - 0.5, high - 0.5), (last + half, first - half), f'{along} [px]',
                'view', size=_SIZE, picture=epi.pixels[:, low:high],
                title=f'epipolar slice along {along}')
    depths = depths_at(pieces, centre)
    shown = [(run.estimate.pose[2, 3], 'estimate')]
    if len(depths) > 1:
        shown = [((depths[0] + depths[-1]) / 2, 'estimate'), (depths[0], 'front'),
                 (depths[-1], 'back')]
    for depth, kind in shown:
        plot.line(track(grid, along, centre, float(depth), epi.positions), epi.positions, kind)
    for end in (ends.argmin(), ends.argmax()) if len(pieces) else ():
        at, depth = pieces.reshape(-1, 2)[end]
        plot.line(track(grid, along, float(at), float(depth), epi.positions), epi.positions, 'rim')
    told = ', '.join(f'{name} {1e3 * depth:.0f} mm' for depth, name in
                     ((shown[1][0], 'front'), (shown[2][0], 'back'))) if len(shown) > 1 else ''
    step = getattr(grid.pinhole, f'f{along}') * grid.baseline / shown[0][0]
    return figure(plot.svg, f'{"Row" if along == "x" else "Column"} {pixel}. At '
                  f'{1e3 * shown[0][0]:.0f} mm a view step is {step:.2f} px'
                  f'{"; " + told if told else ""}.', wide=True)
