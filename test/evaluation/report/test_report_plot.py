"""Drawings put things where their axes say."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.evaluation.report.markup import element, html
from pmcl_ros.evaluation.report.plot import Plot, ellipse

ENDS = st.floats(-1e3, 1e3)


def frame_of(plot):
    """Left, top, width, height of the axes."""
    return [float(plot.svg[-1].get(name)) for name in ('x', 'y', 'width', 'height')]


@given(ENDS, ENDS, ENDS, ENDS)
def test_the_ranges_ends_are_the_axes_corners(a, b, c, d):
    if abs(a - b) < 1 or abs(c - d) < 1:
        return
    plot = Plot((a, b), (c, d))
    _, _, width, height = frame_of(plot)
    np.testing.assert_allclose(plot.place([a, b, (a + b) / 2], [c, d, (c + d) / 2]),
                               [[0, height], [width, 0], [width / 2, height / 2]], atol=0.01)


def test_ticks_stand_where_their_values_are():
    plot = Plot((10, -5), (0.01, 100), log=True)
    left, top, _width, _height = frame_of(plot)
    ticks = [each for each in plot.svg if each.get('class') == 'tick']
    across = [each for each in ticks if each.get('text-anchor') == 'middle']
    up = [each for each in ticks if each.get('text-anchor') == 'end']
    assert len(across) > 2
    assert {each.text for each in up} == {'0.01', '0.1', '1', '10', '100'}
    for each in across:
        assert float(each.get('x')) == pytest.approx(left + plot.place(float(each.text), 1)[0],
                                                     abs=0.02)
    for each in up:
        assert float(each.get('y')) - 4 == pytest.approx(top + plot.place(0, float(each.text))[1],
                                                         abs=0.02)


def test_a_pictures_pixels_lie_under_their_coordinates():
    picture = np.zeros((8, 20, 3), np.uint8)
    plot = Plot((-0.5, 19.5), (7.5, -0.5), picture=picture)
    _, _, width, height = frame_of(plot)
    np.testing.assert_allclose(plot.place([0, 19], [0, 7]),
                               [[width / 40, height / 16],
                                [width * 39 / 40, height * 15 / 16]], atol=0.01)


def test_nan_breaks_a_line():
    plot = Plot((0, 4), (0, 1))
    plot.line([0, 1, 2, 3, 4], [0, 1, np.nan, 1, 0], 'blue')
    (path,) = plot.svg[-1]
    assert re.sub(r'[^ML]', '', path.get('d')) == 'MLML'
    assert path.get('class') == 'blue'


def test_an_ellipse_is_where_the_mahalanobis_distance_is_the_radius():
    covariance = np.array([[4, 1.5], [1.5, 1]])
    line = ellipse(covariance, 2.5)
    distance = np.einsum('ni,ij,nj->n', line, np.linalg.inv(covariance), line)
    np.testing.assert_allclose(distance, 2.5 ** 2)


@given(st.text(st.characters(codec='utf-8', exclude_categories=['Cc', 'Cs'])))
def test_words_are_words_whatever_they_say(words):
    from html.parser import HTMLParser
    found = []

    class Parser(HTMLParser):
        def handle_data(self, data):
            found.append(data)

        def handle_starttag(self, tag, attributes):
            assert tag == 'p'
            assert attributes == [('title', words)]

    parser = Parser()
    parser.feed(html(element('p', words, title=words)))
    parser.close()
    assert ''.join(found) == words
