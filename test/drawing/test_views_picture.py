"""Figures about several views against the numbers that they are of."""

import numpy as np
import pytest
from matplotlib import colormaps
from scipy.spatial.transform import Rotation

from pmcl_ros.drawing.charts import picture
from pmcl_ros.drawing.views_picture import next_views_figure, sigmas_figure
from pmcl_ros.pmcl.multi_view.next_view import NextView

BLUE = (0, 114, 178)
POSE = np.eye(4)
POSE[2, 3] = 0.5


def camera(right, up):
    """Turned about the object at `POSE` from the frame of the pose, to the right and up [deg]."""
    made = np.eye(4)
    turn = -np.deg2rad([up, right, 0])  # y is down
    made[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    made[:3, 3] = POSE[:3, 3] - 0.5 * made[:3, 2]
    return made


def pixel(made, shown, x, y):
    """The row and column of a point of the first axes."""
    across, up = made.axes[0].transData.transform((x, y))
    return len(shown) - 1 - int(up), int(across)


def test_standard_deviations_are_marked_where_they_are():
    sigmas = np.array([np.nan, 6e-3, 1.1e-3, 0.4e-3])
    made = sigmas_figure(sigmas)
    shown = picture(made)
    assert shown.dtype == np.uint8
    blue = (shown == BLUE).all(axis=2)
    for number, sigma in enumerate(sigmas[1:], 2):
        row, column = pixel(made, shown, number, 1e3 * sigma)
        assert blue[row - 1:row + 2, column - 1:column + 2].all()
    _, first = pixel(made, shown, 1.5, 1)
    assert not blue[:, :first].any()
    assert [each.get_text() for each in made.axes[0].texts] == ['6', '1.1', '0.4']
    picture(sigmas_figure(np.full(3, np.nan)))  # none sees the region


def test_candidates_are_drawn_where_they_stand_in_the_colours_of_what_they_bring():
    places = [(30, 0), (0, 20), (-25, -25), (-40, 10)]
    sigmas = np.array([0.5e-3, 0.8e-3, 1.5e-3, 2e-3])
    found = [NextView(camera(*place), sigma, 2e-3)
             for place, sigma in zip(places, sigmas, strict=True)]
    made = next_views_figure(found, POSE, [camera(-5, 0), camera(5, 0)])
    shown = picture(made)
    colours = colormaps['viridis'](np.log(sigmas / 0.5e-3) / np.log(4), bytes=True)[:, :3]
    for place, colour in zip(places[:3], colours[:3], strict=True):
        row, column = pixel(made, shown, *place)
        np.testing.assert_allclose(shown[row, column].astype(int), colour, atol=2)
    blind = pixel(made, shown, *places[3])
    assert (shown[blind] == 255).all()
    assert made.axes[0].get_title() == '2 mm now, 0.5 mm with a view from here'
    ring = np.argwhere((shown == (213, 94, 0)).all(axis=2))
    best = pixel(made, shown, *places[0])
    near = ring[np.linalg.norm(ring - best, axis=1) < 15]
    np.testing.assert_allclose(near.mean(axis=0), best, atol=1)


def test_where_no_view_helps_none_is_named():
    made = next_views_figure([NextView(camera(20, 0), 1e-3, 1e-3)], POSE, [camera(0, 0)])
    assert 'no view' in made.axes[0].get_title()
    assert not (picture(made) == (213, 94, 0)).all(axis=2).any()
    assert made.axes[0].get_xlim()[1] == pytest.approx(26)
