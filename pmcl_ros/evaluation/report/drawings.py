"""The drawings of a report."""

from itertools import combinations, groupby
from typing import NamedTuple

import cv2
import numpy as np
from markupsafe import Markup
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.drawing.pictures import depth_picture, displayed
from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.posterior import Coordinates, spread
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
from pmcl_ros.evaluation.report.svg import axes, colour, dots, lines, outline, over, svg
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.pmcl.history import Generation, Stage
from pmcl_ros.pmcl.render.contour_points import ContourPoints

LEVEL = 0.9  # of the credible regions
REACH = 4.0  # standard deviations that are shown on each side
ARC = 8.0  # px of the contour that one value of the chart is the mean of
_BINS = 24
_THUMBNAIL, _GAP = 58, 2  # px: side of a view in the grid, and between two
_MOST_TICKS = 8
_BRIGHTEST = 99.8  # percentile of the likelihoods that is shown as the brightest
_MARGIN = 0.25  # of the object's width that an epipolar slice shows on each side of it
# nat / px: where one class of colour ends and the next begins.
_BOUNDS = (-1.0, 0.0, 1.0)
_KINDS = ('against', 'rather-against', 'rather-for', 'for')
_THIN = 0.8  # px


class Figure(NamedTuple):
    """A drawing and its caption. wide: as wide as the page lets it be."""

    drawing: Markup
    caption: str
    wide: bool = False


def centre_view(run: Localization) -> Markup:
    """The centre view, or the picture, with outlines and axes."""
    return _view(run, run.source, run.estimate.pose, 'the centre view')


def all_views(run: Localization) -> list[Markup]:
    """Each of several views likewise."""
    # From the frame of the estimate into that of each camera.
    back = np.linalg.inv(run.estimate.pose)
    return [_view(run, view, pose, f'view {number}', pose @ back)
            for number, (view, pose) in enumerate(run.views)]


def _view(run: Localization, source: LightField | PosedView, pose: NDArray[np.float64],
          title: str, into: NDArray[np.float64] | None = None) -> Markup:
    """A picture with outlines at a pose (4, 4) and at the truth, which `into` (4, 4) transforms.
    """
    pinhole, made = source.pinhole, over(displayed(source))
    outline(made, outlines(pinhole, run.model, pose), 'on-estimate')
    if run.truth is not None and not run.truth.empty:  # dashed: the estimate shows between
        truth = run.truth.pose if into is None else into @ run.truth.pose
        outline(made, outlines(pinhole, run.model, truth), 'on-truth', (2, 4))
    arms = np.concatenate([np.zeros((1, 3)), 0.4 * run.model.radius * np.eye(3)])
    origin, *tips = pinhole.project(arms @ pose[:3, :3].T + pose[:3, 3])
    for tip, name in zip(tips, ('axis-x', 'axis-y', 'axis-z'), strict=True):
        lines(made, [np.stack([origin, tip])], name)
    return svg(made, title)


def view_grid(light_field: LightField) -> NDArray[np.uint8]:
    """(height, width, 3) all views, small, as they lie in the grid; one without light is a gap."""
    rows, columns, height, width = light_field.views.shape[:4]
    size = _THUMBNAIL, max(1, round(_THUMBNAIL * height / width))
    canvas = np.full((rows * (size[1] + _GAP), columns * (size[0] + _GAP), 3), 128, np.uint8)
    for row, column in np.ndindex(rows, columns):
        if light_field.grid.weights[row, column] > 0:
            small = cv2.resize(light_field.views[row, column], size, interpolation=cv2.INTER_AREA)
            y, x = row * (size[1] + _GAP), column * (size[0] + _GAP)
            canvas[y:y + size[1], x:x + size[0]] = light_field.colour.displayed(
                small, light_field.gamma)
    return canvas[:-_GAP, :-_GAP]


def posterior_figures(run: Localization, found: Coordinates) -> list[Figure]:
    """Positions, then turns: each two by two, then one by one."""
    figures = []
    for chosen in (range(3), range(3, len(found.names))):
        figures += [Figure(_pair(found, *each), f'{found.names[each[0]]} and '
                           f'{found.names[each[1]]}.') for each in combinations(chosen, 2)]
        figures += [Figure(_marginal(found, k, run), f'{found.names[k]}: standard deviation '
                           f'{found.sigma[k]:.2f} {found.units[k]}.') for k in chosen]
    return figures


def _pair(found: Coordinates, first: int, second: int) -> Markup:
    k = [first, second]
    reach = REACH * found.sigma[k]
    if found.truth is not None:
        reach = np.maximum(reach, 1.1 * np.abs(found.truth[k]))
    # Depth goes up, away from the camera; y goes down, as in the image.
    up = -1 if second == 1 else 1
    made = axes((-reach[0], reach[0]), (-up * reach[1], up * reach[1]), _name(found, first),
                _name(found, second), size=(340.0, 330.0))
    dots(made, found.particles[:, k], 'particle')
    covariance = found.covariance[np.ix_(k, k)]
    lines(made, [ellipse(covariance, radius) for radius in (
        1.0, float(np.sqrt(chi2.ppf(LEVEL, 2))))], 'blue')
    dots(made, np.zeros(2), 'estimate', 3.5)
    if found.truth is not None:
        dots(made, found.truth[k], 'truth', 3.5)
    return svg(made, f'{found.names[first]} and {found.names[second]} of the pose')


def _marginal(found: Coordinates, k: int, run: Localization) -> Markup:
    sigma = float(found.sigma[k])
    truth = None if found.truth is None else float(found.truth[k])
    reach = max(REACH * sigma, 1.1 * abs(truth or 0))
    edges = np.linspace(-reach, reach, _BINS + 1)
    weights = np.exp(run.estimate.log_weights)
    heights = np.histogram(found.particles[:, k], edges, weights=weights)[0] / np.diff(edges)
    top = 1.15 * max(float(heights.max()), float(norm.pdf(0, scale=sigma)))
    made = axes((-reach, reach), (0, top), _name(found, k), 'density', size=(340.0, 170.0))
    made.set_yticks([])
    made.stairs(heights, edges, fill=True, color=colour('sky'), alpha=0.35)
    fine = np.linspace(-reach, reach, 121)
    lines(made, [np.stack([fine, norm.pdf(fine, scale=sigma)], axis=1)], 'blue')
    lines(made, [np.array([[0, 0], [0, top]])], 'estimate', 2.0)
    if truth is not None:
        lines(made, [np.array([[truth, 0], [truth, top]])], 'truth', dash=(2, 4))
    return svg(made, f'{found.names[k]} of the pose')


def _name(found: Coordinates, k: int) -> str:
    return f'{found.names[k]} [{found.units[k]}]'


def ellipse(covariance: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """(n, 2) where a Gaussian of covariance (2, 2) is `radius` standard deviations away."""
    angle = np.linspace(0, 2 * np.pi, 73)
    values, vectors = np.linalg.eigh(covariance)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return (vectors * np.sqrt(np.maximum(values, 0)) @ circle * radius).T


def evidence_classes(points: ContourPoints) -> list[str]:
    """The class of colour of each point: 'for', 'rather-for', 'rather-against' or 'against'."""
    return [_KINDS[k] for k in np.searchsorted(_BOUNDS, points.evidence, side='right')]


def evidence_figures(run: Localization, points: ContourPoints) -> list[Figure]:
    """The contour in the picture, coloured by its evidence, and unrolled."""
    window = run.region.window(run.source.pinhole, run.model.radius)
    coloured = over(displayed(run.source), (window.left, window.top, *window.size))
    classes = np.array(evidence_classes(points))
    for name in _KINDS:
        dots(coloured, points.pixels[classes == name], name)
    arcs = np.stack([points.piece, (points.along / ARC).astype(np.int64)], axis=1)
    first, number = np.unique(arcs, axis=0, return_index=True, return_inverse=True)[1:]
    number = number.ravel()
    lengths = np.bincount(number, points.lengths)
    means = np.bincount(number, points.lengths * points.evidence) / lengths
    place = np.cumsum(lengths) - lengths / 2
    new_pieces = np.flatnonzero(np.diff(points.piece[first])) + 1
    least, length = run.estimate.least_support, float(lengths.sum())
    unrolled = axes((0, length), (min(float(means.min()), least, -0.5) - 0.2,
                                  max(float(means.max()), 0.5) + 0.2),
                    'along the contour [px]', 'evidence [nat/px]')
    lines(unrolled, [np.array([[0, 0], [length, 0]])], 'soft', _THIN)
    lines(unrolled, [np.array([[0, least], [length, least]])], 'soft', _THIN, (4, 3))
    lines(unrolled, np.split(np.stack([place, means], axis=1), new_pieces), 'blue')
    return [
        Figure(svg(coloured, 'evidence along the contour'), 'The contour where its evidence is '
               'measured' + (': at its own depth, in the views refocused there.'
                             if isinstance(run.source, LightField) else '.')),
        Figure(svg(unrolled, 'evidence, unrolled'), 'The same unrolled, piece by piece: means '
               f'over {ARC:.0f} px. Dashed: the value that the weakest fifth has to reach.')]


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


def stage_map(run: Localization, stage: Stage, name: str) -> Figure | None:
    """Where the particles of a stage's end have the object's origin; None without the stage."""
    generations = [each for each in run.history if each.stage == stage]
    if not generations:
        return None
    poses = generations[-1].poses
    pinhole = run.source.pinhole
    window = run.region.window(pinhole, run.model.radius)
    grey = cv2.cvtColor(displayed(run.source), cv2.COLOR_RGB2GRAY)
    made = over(np.asarray(grey, np.uint8), (window.left, window.top, *window.size))
    dots(made, pinhole.project(poses[:, :3, 3]), 'on-particle', 1.8)
    return Figure(svg(made, f'particles: {stage}'), f'{name.capitalize()}: where {len(poses)} '
                  "particles have the object's origin.")


def spreads(history: tuple[Generation, ...]) -> Markup:
    """The particles' spread across (blue) and along (orange) the line of sight."""
    found = 1e3 * np.maximum([spread(each.poses) for each in history], 1e-7)
    made = _generations(history, (float(found.min()) / 1.5, float(found.max()) * 1.5),
                        'spread [mm]')
    made.set_yscale('log')
    made.yaxis.set_major_formatter('{x:g}')
    made.minorticks_off()
    for values, name in zip(found.T, ('blue', 'orange'), strict=True):
        _series(made, np.arange(1, len(history) + 1), values, name)
    return svg(made, 'spread of the particles')


def scores(history: tuple[Generation, ...]) -> Markup:
    """The best (blue) and the median (orange) score; units differ: each stage in its own range."""
    made = _generations(history, (-0.05, 1.05), 'score, relative')
    start = 1
    for _, group in groupby(history, lambda each: each.stage):
        finite = [each.scores[np.isfinite(each.scores)] for each in group]
        best, median = (np.array([function(each) if len(each) else np.nan for each in finite])
                        for function in (np.max, np.median))
        low, high = np.nanmin([best, median]), np.nanmax([best, median])
        for values, name in ((best, 'blue'), (median, 'orange')):
            _series(made, np.arange(start, start + len(finite)),
                    (values - low) / max(float(high - low), 1e-12), name)
        start += len(finite)
    return svg(made, 'scores of the particles')


def _generations(history: tuple[Generation, ...], reach: tuple[float, float], name: str) -> Axes:
    """Axes over generations, with lines between the stages."""
    made = axes((0.5, len(history) + 0.5), reach, 'generation', name)
    for k in range(1, len(history)):
        if history[k].stage != history[k - 1].stage:
            made.axvline(k + 0.5, color=colour('soft'), linewidth=_THIN)
    return made


def _series(made: Axes, numbers: NDArray[np.int64], values: NDArray[np.float64], name: str
            ) -> None:
    points = np.stack([numbers, values], axis=1)
    lines(made, [points], name)
    dots(made, points, name)
