"""Charts against where their lines must be, and the documentation's figures against the code."""

from itertools import combinations

import cv2
import numpy as np

from pmcl_ros.drawing.charts import Chart, Line, draw, figure, picture
from pmcl_ros.drawing.frames_picture import frames_figure
from pmcl_ros.evaluation.studies.figures import FIGURES

BLUE = (0, 114, 178)


def one(lines, x_range=(0, 1), y_range=(0, 2)):
    return Chart('title', 'x', 'y', lines, x_range, y_range)


def drawn(lines, **ranges):
    """(n,) x and y, as parts of the axes, of the pixels that have the first colour."""
    made = figure([[one(lines, **ranges)]])
    shown = picture(made)
    assert shown.dtype == np.uint8
    box = made.axes[0].get_window_extent()
    row, column = np.nonzero((shown == BLUE).all(axis=2))
    # without the legend's; a pixel's middle, from below
    x, y = (column + 0.5 - box.x0) / box.width, (len(shown) - row - 0.5 - box.y0) / box.height
    return x[x <= 1.01], y[x <= 1.01]


def test_a_line_is_drawn_where_its_values_are():
    values = np.linspace(0, 1, 50)
    x, y = drawn([Line('square', values, 1 + 0.9 * values ** 2)])  # clear of the axes' own lines
    assert x.min() < 0.02
    assert x.max() > 0.98
    assert np.abs(y - 0.5 - 0.45 * x ** 2).max() < 0.02


def test_a_range_may_run_backwards():
    values = np.linspace(0, 1, 50)
    x, y = drawn([Line('square', values, 2 * values ** 2)], x_range=(1, 0))
    assert np.abs(y - (1 - x) ** 2).max() < 0.02


def test_unknown_values_break_a_line_and_dashes_leave_gaps():
    values = np.linspace(0, 1, 101)
    x, _ = drawn([Line('gap', values, np.where((values > 0.4) & (values < 0.6), np.nan, 1))])
    assert not ((x > 0.43) & (x < 0.57)).any()
    whole = len(np.unique(drawn([Line('whole', [0, 1], [1, 1])])[0]))
    dashes = len(np.unique(drawn([Line('dashes', [0, 1], [1, 1], dashed=True)])[0]))
    assert 0.3 < dashes / whole < 0.85


def test_charts_stand_in_rows_and_share_a_legend_if_they_tell_the_same_lines():
    same, other = one([Line('a', [0, 1], [0, 1])]), one([Line('b', [0, 1], [0, 1])])
    made = figure([[same, same, other], [other]])
    top, bottom = made.axes[:3], made.axes[3:]
    assert len(bottom) == 1
    assert [each.get_legend() is not None for each in (*top, *bottom)] == [False, True, True, True]
    picture(made)
    boxes = [each.get_window_extent() for each in made.axes]
    assert boxes[0].x1 < boxes[1].x0
    assert boxes[1].x1 < boxes[2].x0
    assert boxes[3].y1 < boxes[0].y0


def test_a_figure_is_a_picture_that_png_can_hold():
    shown = FIGURES['lemma']()
    assert cv2.imencode('.png', shown)[0]
    assert (shown == BLUE).all(axis=2).any()


def test_draw_is_the_picture_of_the_figure():
    chart = one([Line('a', [0, 1], [0, 1])])
    np.testing.assert_array_equal(draw([[chart]]), picture(figure([[chart]])))


def test_names_in_the_figure_of_frames_can_be_read():
    made = frames_figure()
    picture(made)
    boxes = [each.get_window_extent() for each in made.axes[0].texts if each.get_text()]
    assert len(boxes) > 8
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
