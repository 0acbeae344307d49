"""The window is driven by events of matplotlib's canvas, as a screen's back ends make them."""

import subprocess
import sys

import pytest
from command_line import Runner
from matplotlib import pyplot
from matplotlib.backend_bases import KeyEvent, MouseEvent
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pmcl_ros.cli import box_window, main
from pmcl_ros.cli.box_window import BoxWindow, boxes_in_window, has_screen, options_of
from pmcl_ros.profiles.outline import resized
from pmcl_ros.runtime.errors import ProfileError


class Hand:
    """Of a user, before the figure of a canvas."""

    def __init__(self, canvas):
        self.canvas = canvas
        canvas.draw()

    def mouse(self, name, place):
        x, y = self.canvas.figure.axes[0].transData.transform(place)
        button = {} if name == 'motion_notify_event' else {'button': 1}
        self.canvas.callbacks.process(name, MouseEvent(name, self.canvas, x, y, **button))

    def drag(self, start, end):
        self.mouse('button_press_event', start)
        self.mouse('motion_notify_event', end)
        self.mouse('button_release_event', end)

    def click(self, *places):
        for each in places:
            self.drag(each, each)

    def press(self, *keys):
        for each in keys:
            self.canvas.callbacks.process('key_press_event',
                                          KeyEvent('key_press_event', self.canvas, each))
            self.canvas.draw()

    @property
    def title(self):
        return self.canvas.figure.axes[0].get_title()


@pytest.fixture
def open_window(views):
    """A function needed -> a window, the hand before it, a list that grows when it ends."""
    def open_window(needed):
        canvas, ended = FigureCanvasAgg(Figure((8, 7))), []
        window = BoxWindow(canvas.figure, views, needed, lambda: ended.append(True))
        return window, Hand(canvas), ended
    return open_window


def test_boxes_are_dragged_in_two_views(open_window):
    window, hand, ended = open_window(2)
    assert hand.title.startswith('View 0, 0 of 2 marked')
    hand.drag((150, 100), (250.25, 240))
    hand.press('enter')
    assert hand.title.startswith('View 1, 1 of 2 marked')  # the one in the middle
    hand.drag((300, 300), (160, 90.5))  # from any corner
    assert not ended
    hand.press('enter')
    assert ended == [True]
    assert window.boxes == {0: (150, 100, pytest.approx(100.2, abs=0.06), 140),
                            1: (160, 90.5, 140, 209.5)}
    hand.press('enter', 'escape')  # nothing any more
    assert ended == [True]


def test_points_of_the_outline_are_clicked(open_window):
    window, hand, _ = open_window(1)
    hand.drag((0, 0), (399, 300))  # the points are in its place
    hand.click((20, 5), (10, 60), (110, 70), (50, 205.5))
    hand.press('enter')
    assert window.boxes == {0: (10, 5, 100, 200.5)}


def test_views_are_passed_by_and_come_again_and_small_boxes_are_refused(open_window):
    window, hand, _ = open_window(1)
    seen = []
    for _ in range(4):
        seen.append(window.shown)
        hand.press('enter')
    assert seen == [0, 1, 2, 0]
    hand.drag((150, 100), (154, 240))
    hand.press('enter')
    assert 'less than 8 px' in hand.title
    hand.drag((150, 100), (250, 240))
    hand.press('backspace', 'enter')  # nothing is marked
    assert window.shown == 2
    hand.drag((100, 100), (250, 240))
    hand.press('enter')
    assert window.boxes == {2: (100, 100, 150, 140)}


@pytest.fixture
def acting(monkeypatch):
    """A function deed -> a user who does it, with the figure, as soon as a window is shown."""
    pyplot.switch_backend('agg')
    monkeypatch.setattr('pmcl_ros.cli.box_window.has_screen', lambda: True)

    def act(deed):
        monkeypatch.setattr(pyplot, 'show', lambda block: block and deed(pyplot.gcf()))

    yield act
    pyplot.close('all')


def test_the_window_closes_and_the_options_are_told(views, acting, capsys):
    def mark(figure):
        hand = Hand(figure.canvas)
        for _ in range(2):
            hand.drag((150, 100), (250, 240))
            hand.press('enter')

    acting(mark)
    assert boxes_in_window(views, 2) == dict.fromkeys((0, 1), (150, 100, 100, 140))
    assert not pyplot.get_fignums()
    assert capsys.readouterr().err == ('to repeat it without a window: --box 0 150 100 100 140 '
                                       '--box 1 150 100 100 140\n')


@pytest.mark.parametrize('deed', [pyplot.close,
                                  lambda figure: Hand(figure.canvas).press('escape')])
def test_giving_up_is_one_clear_error(folder, acting, tmp_path, deed):
    acting(deed)
    found = Runner().invoke(main, ['profile', str(folder), '-o', str(tmp_path / 'glass.yaml')])
    assert (found.exit_code, found.output) == (1, 'Error: given up: the object is not marked\n')
    assert not pyplot.get_fignums()
    assert not list(tmp_path.iterdir())


def test_too_few_views_are_told(views):
    with pytest.raises(ProfileError, match='in 2 views'):
        boxes_in_window(views[:1], 2)


def test_the_options_say_the_same():
    assert (options_of({2: (317, 129, 80.5, 296), 0: (302.1, 107, 72, 1290.3)})
            == '--box 0 302.1 107 72 1290.3 --box 2 317 129 80.5 296')


def test_without_a_screen_the_options_are_asked_for(monkeypatch, tmp_path):
    for each in ('DISPLAY', 'WAYLAND_DISPLAY'):
        monkeypatch.delenv(each, raising=False)
    assert not has_screen()
    found = Runner().invoke(main, ['profile', str(tmp_path), '-o', str(tmp_path / 'glass.yaml')])
    assert found.exit_code == 2
    assert '--box or --points; there is no screen' in found.output.replace('\n', ' ')
    told = ' '.join(Runner().invoke(main, ['profile', '--help']).output.split())
    assert '--box or --points, or else in a window: without a screen one of the two' in told


def test_a_back_end_without_windows_is_no_screen(monkeypatch):
    monkeypatch.setenv('DISPLAY', ':0')
    monkeypatch.setenv('MPLBACKEND', 'agg')
    found = subprocess.run(
        [sys.executable, '-c', f'import {box_window.__name__} as w; print(w.has_screen())'],
        capture_output=True, text=True, check=True)
    assert found.stdout == 'False\n'


def test_boxes_of_shrunk_pictures_are_printed_as_they_are_given():
    box = (100.0, 80.0, 40.0, 60.0)
    assert resized(resized(box, 4), 1 / 4) == pytest.approx(box)
    # of the first four pixels one is made, about (1.5, 1.5)
    assert resized((0.0, 0.0, 1.0, 1.0), 4)[:2] == (1.5, 1.5)
