"""Cuts through the depth likelihood volume, and the depths that it says."""

from xml.etree.ElementTree import Element

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.drawing.pictures import depth_picture, layers_picture
from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.markup import figure, figures, image, key, section
from pmcl_ros.evaluation.report.outlines import Along, cut, label_at, middle, outlines
from pmcl_ros.evaluation.report.plot import Plot, Ticks, round_numbers
from pmcl_ros.evaluation.report.views import over

_MOST_TICKS = 8
_BRIGHTEST = 99.8  # percentile of the likelihoods that is shown as the brightest


def volume_slice(volume: DepthLikelihoodVolume, along: Along, pixel: int) -> NDArray[np.float32]:
    """The likelihood along a row of pixels, or a column, over depth.

    (labels, width) seen from above, far above near; of 'y' (height, labels) seen from the side,
    near left of far.
    """
    if along == 'x':
        return volume.likelihood[pixel].T
    return volume.likelihood[:, pixel, ::-1]


def slices_section(run: Localization) -> Element:
    """Two slices through the middle of the object, the depth picture and the two layers."""
    near, far = run.volume_settings.near, run.volume_settings.far
    layers = layers_picture(run.volume.layers(), near, far)
    return section(
        'Depth likelihood', 'volume',
        'How likely the light on a line of pixels came from each depth: bright is likely. Glass '
        'shows faintly, and what is behind it too.',
        key(('on estimate', 'the estimate: its surface under the same rays, or its outline')),
        figures(
            figure(slice_plot(run, 'x').svg, 'From above, the camera below: across and depth.'),
            figure(slice_plot(run, 'y').svg, 'From the side, the camera at the left: depth and '
                   'down.'),
            figure(_depths(run), 'The most likely depth of each pixel; chance where '
                   'nothing tells.'),
            figure(image(layers, 'two layers'), 'The front surface of each ray, and what lies '
                   'behind it.', wide=True)))


def _depths(run: Localization) -> Element:
    picture = depth_picture(run.volume.depth_map(), run.volume_settings.near,
                            run.volume_settings.far)
    plot = over(picture, title='most likely depth')
    plot.path(outlines(run.volume.pinhole, run.model, run.estimate.pose), 'estimate', closed=True)
    return plot.svg


def slice_plot(run: Localization, along: Along) -> Plot:
    """A slice through the middle of the object, with the object's own cut."""
    volume, pinhole = run.volume, run.volume.pinhole
    window = run.region.window(pinhole, run.model.radius)
    point = np.nan_to_num(pinhole.project(middle(run.model, run.estimate.pose)))
    line, sides = (1, pinhole.height) if along == 'x' else (0, pinhole.width)
    pixel = int(np.clip(round(float(point[line])), 0, sides - 1))
    last = len(volume.depths) - 1
    low, length = ((window.left, window.size[0]) if along == 'x'
                   else (window.top, window.size[1]))
    reach = low - 0.5, low + length - 0.5
    values = volume_slice(volume, along, pixel)
    part = np.s_[:, low:low + length] if along == 'x' else np.s_[low:low + length]
    brightest = max(float(np.percentile(volume.likelihood, _BRIGHTEST)), 1e-9)
    picture = _shown(values[part] / brightest)
    # A label is as wide as one: the first is from -1/2 to 1/2.
    if along == 'x':
        plot = Plot(reach, (last + 0.5, -0.5), 'x [px]', 'depth [m]', size=(340.0, 300.0),
                    picture=picture, y_ticks=_ticks(volume), title='likelihood from above')
    else:
        plot = Plot((last + 0.5, -0.5), reach[::-1], 'depth [m]', 'y [px]', size=(340.0, 300.0),
                    picture=picture, x_ticks=_ticks(volume), title='likelihood from the side')
    pieces = cut(pinhole, run.model, run.estimate.pose, along, pixel)
    labels = label_at(volume.depths, pieces[..., 1])
    ends = (pieces[..., 0], labels) if along == 'x' else (labels, pieces[..., 0])
    plot.path(list(np.stack(ends, axis=-1)), 'estimate')
    return plot


def _ticks(volume: DepthLikelihoodVolume) -> Ticks:
    far, near = float(volume.depths[0]), float(volume.depths[-1])
    found: list[tuple[float, str]] = []
    for each in round_numbers(near, far):
        label = float(label_at(volume.depths, each))
        # Far away they crowd.
        if not found or found[-1][0] - label > len(volume.depths) / _MOST_TICKS:
            found.append((label, f'{each:g}'))
    return found


def _shown(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    levels = np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS)[..., ::-1], np.uint8)
