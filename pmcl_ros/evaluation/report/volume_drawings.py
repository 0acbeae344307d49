"""Drawings of slices: epipolar ones of a light field, and of a volume."""

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.drawing.pictures import depth_picture
from pmcl_ros.evaluation.report.html import Figure
from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.slices import (
    Along,
    cut,
    depths_at,
    epipolar_slice,
    label_at,
    middle,
    outlines,
    track,
    volume_slice,
)
from pmcl_ros.evaluation.report.svg import axes, lines, outline, over, svg
from pmcl_ros.lightfield.light_field import LightField

_MOST_TICKS = 8  # of an axis of depths
_BRIGHTEST = 99.8  # percentile of the likelihoods that is shown as the brightest
_MARGIN = 0.25  # of the object's width that an epipolar slice shows on each side of it


def epipolar_figures(run: Localization, light_field: LightField) -> list[Figure]:
    """Slices along x and y through the middle of the object; none where it is not in front."""
    point = run.source.pinhole.project(middle(run.model, run.estimate.pose))
    if not np.isfinite(point).all():
        return []
    x, y = point.tolist()
    return [_epipolar(run, light_field, 'x', y, x), _epipolar(run, light_field, 'y', x, y)]


def _epipolar(run: Localization, light_field: LightField, along: Along, line: float,
              centre: float) -> Figure:
    grid = light_field.grid
    width, height = grid.pinhole.width, grid.pinhole.height
    length, other = (width, height) if along == 'x' else (height, width)
    pixel = int(np.clip(round(line), 0, other - 1))
    pieces = cut(grid.pinhole, run.model, run.estimate.pose, along, pixel)
    ends = pieces[..., 0] if len(pieces) else np.array([centre - 20, centre + 20])
    beside = _MARGIN * float(np.ptp(ends)) + 8
    low = int(np.clip(ends.min() - beside, 0, length - 2))
    high = int(np.clip(ends.max() + beside, low + 2, length))
    epi = epipolar_slice(light_field, along, pixel)
    first, last = float(epi.positions[0]), float(epi.positions[-1])
    half = (last - first) / max(len(epi.positions) - 1, 1) / 2
    made = axes((low - 0.5, high - 0.5), (last + half, first - half), f'{along} [px]', 'view',
                size=(460.0, 160.0), picture=epi.pixels[:, low:high])

    def lean(at: float, depth: float, name: str, thickness: float) -> None:
        places = track(grid, along, at, depth, epi.positions)
        lines(made, [np.stack([places, epi.positions], axis=1)], name, thickness)

    depths = depths_at(pieces, centre)
    two = len(depths) > 1
    depth = float((depths[0] + depths[-1]) / 2 if two else run.estimate.pose[2, 3])
    lean(centre, depth, 'on-estimate', 2.0)
    if two:
        lean(centre, float(depths[0]), 'front', 1.1)
        lean(centre, float(depths[-1]), 'back', 1.1)
    for end in (ends.argmin(), ends.argmax()) if len(pieces) else ():
        at, at_depth = pieces.reshape(-1, 2)[end].tolist()
        lean(at, at_depth, 'rim', 1.1)
    step = getattr(grid.pinhole, f'f{along}') * grid.baseline / depth
    caption = (f'{"Row" if along == "x" else "Column"} {pixel}. At {1e3 * depth:.0f} mm a view '
               f'step is {step:.2f} px')
    if two:
        caption += f'; front {1e3 * depths[0]:.0f} mm, back {1e3 * depths[-1]:.0f} mm'
    return Figure(svg(made, f'epipolar slice along {along}'), f'{caption}.', wide=True)


def volume_figures(run: Localization, volume: DepthLikelihoodVolume) -> list[Figure]:
    """Two slices through the middle of the object, and the depth picture."""
    depth = over(depth_picture(volume.depth_map(), run.volume_settings.near,
                               run.volume_settings.far))
    pose, _ = run.before(volume)
    outline(depth, outlines(volume.pinhole, run.model, pose), 'on-estimate')
    return [Figure(svg(volume_axes(run, volume, 'x'), 'likelihood from above'),
                   'From above, the camera below: across and depth.'),
            Figure(svg(volume_axes(run, volume, 'y'), 'likelihood from the side'),
                   'From the side, the camera at the left: depth and down.'),
            Figure(svg(depth, 'most likely depth'), 'The most likely depth of each pixel; chance '
                   'where no view shows a difference.')]


def volume_axes(run: Localization, volume: DepthLikelihoodVolume, along: Along) -> Axes:
    """A slice through the middle of the object, with the object's own cut."""
    pinhole = volume.pinhole
    pose, region = run.before(volume)
    window = region.window(pinhole, run.model.radius)
    point = np.nan_to_num(pinhole.project(middle(run.model, pose)))
    line, sides = (1, pinhole.height) if along == 'x' else (0, pinhole.width)
    pixel = int(np.clip(round(float(point[line])), 0, sides - 1))
    low, length = ((window.left, window.size[0]) if along == 'x'
                   else (window.top, window.size[1]))
    part = np.s_[:, low:low + length] if along == 'x' else np.s_[low:low + length]
    brightest = max(float(np.percentile(volume.likelihood, _BRIGHTEST)), 1e-9)
    values = volume_slice(volume, along, pixel)[part] / brightest
    picture = colormaps['viridis'](values, bytes=True)[..., :3]
    # A label is one unit wide: the first is from -1/2 to 1/2.
    labels, pixels = (len(volume.depths) - 0.5, -0.5), (low - 0.5, low + length - 0.5)
    if along == 'x':
        made = axes(pixels, labels, 'x [px]', 'depth [m]', size=(340.0, 300.0), picture=picture)
    else:
        made = axes(labels, pixels[::-1], 'depth [m]', 'y [px]', size=(340.0, 300.0),
                    picture=picture)
    (made.yaxis if along == 'x' else made.xaxis).set_ticks(*_depth_ticks(volume.depths))
    pieces = cut(pinhole, run.model, pose, along, pixel)
    ends = np.stack([pieces[..., 0], label_at(volume.depths, pieces[..., 1])], axis=-1)
    lines(made, ends if along == 'x' else ends[..., ::-1], 'on-estimate', 2.0)
    return made


def _depth_ticks(depths: NDArray[np.float64]) -> tuple[list[float], list[str]]:
    """Labels of round depths, and their texts."""
    far, near = float(depths[0]), float(depths[-1])
    found: dict[float, str] = {}
    last = np.inf
    for each in MaxNLocator(6, steps=[1, 2, 5, 10]).tick_values(near, far):
        label = float(label_at(depths, each))
        # Far away they crowd.
        if near <= each <= far and last - label > len(depths) / _MOST_TICKS:
            found[label], last = f'{each:g}', label
    return list(found), list(found.values())
