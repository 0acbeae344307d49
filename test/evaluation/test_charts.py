"""Charts against where their lines must be, and the documentation's figures against the code."""

import cv2
import numpy as np
import pytest

from pmcl_ros.evaluation.charts import Line, beside, chart
from pmcl_ros.evaluation.figures import FIGURES

RANGES = {'x_range': (0, 1), 'y_range': (0, 2), 'size': (300, 200)}
BLUE = (0, 114, 178)


def drawn(lines, **other):
    """Mask of the pixels within the axes that have the first colour."""
    picture = chart('title', 'x', 'y', lines, **(RANGES | other))
    assert picture.dtype == np.uint8
    return (picture == BLUE).all(axis=2)[34:234, 56:356]


def test_a_line_is_drawn_where_its_values_are():
    x = np.linspace(0, 1, 50)
    row, column = np.nonzero(drawn([Line('square', x, 2 * x ** 2)]))
    assert column.min() <= 2
    assert column.max() >= 298
    assert np.abs((200 - row) / 200 - (column / 300) ** 2).max() < 0.02


def test_a_range_may_run_backwards():
    x = np.linspace(0, 1, 50)
    forwards = drawn([Line('square', x, 2 * x ** 2)])
    backwards = drawn([Line('square', 1 - x, 2 * x ** 2)], x_range=(1, 0))
    np.testing.assert_array_equal(backwards, forwards)


def test_charts_beside_each_other():
    one = chart('a', 'x', 'y', [Line('b', [0, 1], [0, 1])], **RANGES)
    np.testing.assert_array_equal(beside([one, one])[:, one.shape[1]:], one)


def test_unknown_values_break_a_line_and_dashes_leave_gaps():
    x = np.linspace(0, 1, 101)
    y = np.where((x > 0.4) & (x < 0.6), np.nan, 1)
    columns = drawn([Line('gap', x, y)]).any(axis=0)
    assert not columns[130:170].any()
    assert columns[5:110].all()
    dashes = drawn([Line('dashes', [0, 1], [1, 1], dashed=True)]).any(axis=0)
    assert 0.3 < dashes.mean() < 0.85


@pytest.mark.parametrize('x_range', [(0, 1), (-3, 4), (0, 0.003), (200, 1700)])
def test_numbers_along_an_axis_are_round_and_few(x_range):
    picture = chart('', '', '', [Line('', x_range, (0, 0))], x_range, (0, 1), size=(300, 200))
    grid = (picture[50] < 255).all(axis=1)[56:357]  # a row with nothing but vertical grid lines
    starts = np.flatnonzero(np.diff(grid.astype(int)) == 1)
    assert 3 <= len(starts) <= 12
    assert np.ptp(np.diff(starts)) <= 2


def test_a_figure_is_a_picture_that_png_can_hold():
    picture = FIGURES['lemma']()
    assert cv2.imencode('.png', picture)[0]
    assert (picture == BLUE).all(axis=2).any()
