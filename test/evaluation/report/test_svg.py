"""Drawings put things where their axes say."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.evaluation.report.posterior_drawings import ellipse
from pmcl_ros.evaluation.report.svg import axes, dots, lines, outline, over, svg

LEFT, TOP, WIDTH, HEIGHT = 46.0, 8.0, 284.0, 196.0  # px of the axes in a drawing of 340 x 240
NUMBER = r'-?\d+\.?\d*'


class Parser(HTMLParser):
    """The elements of a drawing: (tag, attributes, text)."""

    def __init__(self, text):
        super().__init__()
        self.elements = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes), []))

    def handle_data(self, data):
        if self.elements:
            self.elements[-1][2].append(data)

    def texts(self):
        """(text, x, y) of all texts that are not turned."""
        return [(''.join(data).strip().replace('\u2212', '-'), float(found['x']),
                 float(found['y'])) for tag, found, data in self.elements
                if tag == 'text' and 'x' in found]


def strokes(drawing, name):
    """The steps of the paths in a colour: ('M' or 'L', x, y)."""
    paths = [found['d'] for tag, found, _ in Parser(drawing).elements
             if tag == 'path' and f'stroke: var(--{name})' in found.get('style', '')]
    return [(step, float(x), float(y)) for path in paths
            for step, x, y in re.findall(f'([ML]) ({NUMBER}) ({NUMBER})', path)]


@pytest.mark.parametrize(('x', 'y'), [((-3, 5), (2, 40)), ((5, -3), (40, 2)), ((0, 1), (9, -9))])
def test_the_ranges_ends_are_the_axes_corners(x, y):
    made = axes(x, y)
    lines(made, [np.array([[x[0], y[0]], [x[1], y[1]], [sum(x) / 2, sum(y) / 2]])], 'blue')
    steps = strokes(svg(made, 'corners'), 'blue')
    assert [each[0] for each in steps] == ['M', 'L', 'L']
    np.testing.assert_allclose(
        [each[1:] for each in steps],
        [[LEFT, TOP + HEIGHT], [LEFT + WIDTH, TOP], [LEFT + WIDTH / 2, TOP + HEIGHT / 2]],
        atol=0.02)


def test_ticks_stand_where_their_values_are():
    texts = Parser(svg(axes((10, -5), (0, 100)), 'ticks')).texts()
    across = [each for each in texts if each[2] > TOP + HEIGHT + 8]
    up = [each for each in texts if each[2] <= TOP + HEIGHT + 8]
    assert len(across) > 2
    assert {each[0] for each in up} == {'0', '20', '40', '60', '80', '100'}
    for text, x, _ in across:
        assert x == pytest.approx(LEFT + (10 - float(text)) / 15 * WIDTH, abs=0.1)
    for text, _, y in up:  # texts stand on their base line
        assert y - 4 == pytest.approx(TOP + (100 - float(text)) / 100 * HEIGHT, abs=1)


def test_a_pictures_pixels_lie_under_their_coordinates():
    made = over(np.zeros((12, 20, 3), np.uint8), (2, 1, 10, 5))
    dots(made, [[2, 1], [11, 5]], 'estimate')
    drawing = svg(made, 'picture')
    steps = [each[1:] for each in strokes(drawing, 'estimate')]
    first, last = [17, 17], [340 - 17, 170 - 17]  # the middles of pixels of 34 px
    np.testing.assert_allclose(steps, [first, first, last, last], atol=0.02)
    assert 'viewBox="0 0 340 170"' in drawing
    (image,) = [found for tag, found, _ in Parser(drawing).elements if tag == 'image']
    assert image['xlink:href'].startswith('data:image/png;base64,')
    assert 'pixelated' in image['style']


def test_each_polyline_is_one_stroke_and_an_outline_is_closed():
    made = axes((0, 4), (0, 1))
    lines(made, [np.array([[0, 0], [1, 1]]), np.zeros((0, 2)), np.array([[3, 1], [4, 0]])], 'blue')
    outline(made, [np.array([[0, 0], [2, 0], [2, 1]])], 'truth')
    drawing = svg(made, 'strokes')
    assert ''.join(each[0] for each in strokes(drawing, 'blue')) == 'MLML'
    steps = strokes(drawing, 'truth')
    assert steps[0][1:] == steps[-1][1:]
    assert len(steps) == 4


def test_many_dots_are_all_drawn():
    made = axes((0, 1), (0, 1))
    dots(made, np.random.default_rng(0).random((500, 2)), 'particle')
    assert len(strokes(svg(made, 'dots'), 'particle')) == 1000


def test_an_ellipse_is_where_the_mahalanobis_distance_is_the_radius():
    covariance = np.array([[4, 1.5], [1.5, 1]])
    line = ellipse(covariance, 2.5)
    distance = np.einsum('ni,ij,nj->n', line, np.linalg.inv(covariance), line)
    np.testing.assert_allclose(distance, 2.5 ** 2)


@given(st.text(st.characters(codec='utf-8', exclude_categories=['Cc', 'Cs']), min_size=1))
def test_a_title_is_only_text_whatever_it_says(words):
    elements = Parser(svg(over(np.zeros((2, 2, 3), np.uint8)), words)).elements
    assert [each[0] for each in elements[:2]] == ['svg', 'title']
    assert ''.join(elements[1][2]) == words
    assert 'script' not in [each[0] for each in elements]
