"""Pictures of a report: views with outlines, and the grid of a light field."""

import cv2
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from pmcl_ros.drawing.pictures import displayed
from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.slices import outlines
from pmcl_ros.evaluation.report.svg import lines, outline, over, svg
from pmcl_ros.geometry.interface import Interface
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.pmcl.render.sunken import as_it_appears

_THUMBNAIL, _GAP = 58, 2  # px: side of a view in the grid, and between two


def centre_view(run: Localization) -> Markup:
    """The centre view, or the picture, with outlines and axes."""
    return _view(run, run.source, run.estimate.pose, 'the centre view', np.eye(4),
                 run.settings.interface)


def all_views(run: Localization) -> list[Markup]:
    """Each of several views likewise."""
    # From the frame of the estimate into that of each camera.
    back = np.linalg.inv(run.estimate.pose)
    liquid = run.settings.interface
    return [_view(run, view, pose, f'view {number}', pose @ back,
                  liquid and liquid.seen_from(view.camera_to_reference))
            for number, (view, pose) in enumerate(run.views)]


def _view(run: Localization, source: LightField | PosedView, pose: NDArray[np.float64],
          title: str, into: NDArray[np.float64], liquid: Interface | None) -> Markup:
    """A picture with outlines at a pose (4, 4) and at the truth, which `into` (4, 4) transforms.

    liquid: in the frame of the camera.
    """
    pinhole, made = source.pinhole, over(displayed(source))
    outline(made, outlines(pinhole, as_it_appears(run.model, pose, liquid), pose), 'on-estimate')
    if run.truth is not None and not run.truth.empty:  # dashed: the estimate shows between
        truth = into @ run.truth.pose
        seen = as_it_appears(run.model, truth, liquid)
        outline(made, outlines(pinhole, seen, truth), 'on-truth', (2, 4))
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
