"""Lines that repeat are logged at once, then seldom, and counted."""

import pytest

from pmcl_ros.nodes.runtime.repeated_lines import RepeatedLines

now = [0.0]


@pytest.fixture
def lines():
    now[0] = 0.0
    return RepeatedLines(lambda: now[0])


def test_a_line_that_comes_thirty_times_a_second_is_logged_every_ten_and_counted(lines):
    logged = []
    for frame in range(30 * 25):
        now[0] = frame / 30
        logged.append(lines('in: the picture is empty'))
    assert [each for each in logged if each] == [
        'in: the picture is empty',
        *['in: the picture is empty (299 times more since the last such line)'] * 2]


def test_lines_of_other_texts_are_logged_at_once(lines):
    assert [lines(each) for each in ('a', 'b', 'a', 'c', 'b')] == ['a', 'b', '', 'c', '']


def test_stamps_do_not_make_another_line(lines):
    text = 'a capture at {} cannot follow one at {}'
    assert lines(text.format(1795861061381889582, 1795861061381889583))
    now[0] = 9.0
    assert lines(text.format(1795861062381889582, 1795861062381889583)) == ''
    now[0] = 10.0
    last = text.format(1795861063381889582, 1795861063381889583)
    assert lines(last) == f'{last} (1 times more since the last such line)'


@pytest.mark.parametrize(('text', 'first', 'next_one'), [
    ('dropped {}: too late', 12_000_000_000, 12_033_000_000),  # a simulated clock begins with 0
    ('the corners are {} px off', 5.1, 4.87),
    ('frame {} is given up', 9, 10)])
def test_what_is_measured_or_counted_does_not_make_another_line(lines, text, first, next_one):
    assert lines(text.format(first))
    assert lines(text.format(next_one)) == ''


def test_what_comes_seldom_is_never_held_back(lines):
    for _ in range(3):
        assert lines('a') == 'a'
        now[0] += 10


def test_lines_that_never_repeat_do_not_fill_the_memory(lines):
    for number in range(100_000):
        assert lines(f'capture {number}')
    assert lines('capture 99999') == ''
    assert lines('capture 0') == 'capture 0'
