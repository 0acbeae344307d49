"""What was seen: the centre view with the object drawn on it, and all the views."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.markup import figure, figures, image, key, section
from pmcl_ros.evaluation.report.outlines import outlines
from pmcl_ros.evaluation.report.plot import Plot
from pmcl_ros.lightfield.light_field import LightField

_THUMBNAIL, _GAP = 58, 2  # px: side of a view in the grid, and between two


def views_section(run: Localization) -> Element:
    """The centre view and the grid of views."""
    entries = [('on estimate', 'estimate'), ('axis-x', 'x'), ('axis-y', 'y'), ('axis-z', 'z')]
    if run.truth is not None and not run.truth.empty:
        entries.insert(1, ('on truth', 'truth'))
    rows, columns = run.light_field.grid.shape
    lit = int((run.light_field.grid.weights > 0).sum())
    return section('What was seen', 'views', figures(
        figure(centre_view(run), 'The centre view, with the outline and the axes of the object '
               'where it was estimated.', key(*entries)),
        figure(image(view_grid(run.light_field), 'all views'),
               f'{rows} x {columns} views through different parts of the lens, as seen from the '
               f'scene: {lit} of them got light.')))


def centre_view(run: Localization) -> Element:
    """The centre view with outlines and axes."""
    pinhole = run.light_field.grid.pinhole
    plot = over(run.light_field.picture())
    pose = run.estimate.pose
    plot.path(outlines(pinhole, run.model, pose), 'estimate', closed=True)
    if run.truth is not None and not run.truth.empty:  # dashed: the estimate shows between
        plot.path(outlines(pinhole, run.model, run.truth.pose), 'truth', closed=True)
    arms = np.concatenate([np.zeros((1, 3)), 0.4 * run.model.radius * np.eye(3)])
    origin, *tips = pinhole.project(arms @ pose[:3, :3].T + pose[:3, 3])
    for tip, kind in zip(tips, ('axis-x', 'axis-y', 'axis-z'), strict=True):
        plot.path([np.stack([origin, tip])], kind)
    return plot.svg


def over(picture: NDArray[np.uint8], window: Sequence[int] | None = None, title: str = 'picture'
         ) -> Plot:
    """A picture (height, width, 3) to draw upon, in its own pixels.

    window: left, top, width, height of the part that is shown [px].
    """
    left, top, width, height = window or (0, 0, picture.shape[1], picture.shape[0])
    return Plot((left - 0.5, left + width - 0.5), (top + height - 0.5, top - 0.5), frame=False,
                title=title, size=(340.0, 340.0 * height / width),
                picture=picture[top:top + height, left:left + width])


def view_grid(light_field: LightField) -> NDArray[np.uint8]:
    """All views, small, as they lie in the grid; one without light is a gap."""
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
