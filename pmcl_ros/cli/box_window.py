"""A window in which the user marks an object in views, by a box or by points of its outline."""

import os
import sys
from collections.abc import Callable, Sequence

import click
from matplotlib import pyplot
from matplotlib.backend_bases import Event, KeyEvent, MouseButton, MouseEvent
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.widgets import RectangleSelector

from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.profiles.outline import LEAST_SIDE, Box, resized
from pmcl_ros.runtime.errors import ProfileError

_CLICK = 4.0  # px of the screen: a shorter drag is a click
_COLOUR = '#00c000'
_HELP = ('Drag a box around the object, or click on its outline: topmost, lowest, left, right.\n'
         'Enter: go on, to another view if nothing is marked. Backspace: anew. Escape: give up.')


class BoxWindow:
    """Shows views in a figure until the object is marked in `needed` of them, or given up.

    figure: of a canvas that tells of mouse and keys. ended: called then. The first view is shown
    first, then the one in the middle, which sees the object from another side; a view is passed
    by where nothing is marked, and comes again after the others.
    """

    def __init__(self, figure: Figure, views: Sequence[PosedView], needed: int,
                 ended: Callable[[], None]) -> None:
        self._figure, self._views, self._needed = figure, views, needed
        self._ended = ended
        self.boxes: dict[int, Box] = {}  # by number of the view, tenths of a pixel
        middle = len(views) // 2
        self._order = sorted(range(len(views)), key=lambda k: (k not in (0, middle), k))
        self._selector: RectangleSelector | None = None
        canvas = figure.canvas
        self._connected = [canvas.mpl_connect('key_press_event', self._on_key),
                           canvas.mpl_connect('button_press_event', self._on_press),
                           canvas.mpl_connect('button_release_event', self._on_release)]
        self._show()

    @property
    def shown(self) -> int:
        """Number of the view that is shown."""
        return self._order[0]

    def _show(self, problem: str = '') -> None:
        """Draw the view, nothing marked in it."""
        if self._selector is not None:
            self._selector.disconnect_events()
        self._figure.clear()
        self._points: list[tuple[float, float]] = []
        self._clicked = False
        self._pressed: tuple[float, float] | None = None
        axes = self._figure.add_subplot()
        axes.imshow(self._views[self.shown].displayed())
        axes.set_axis_off()
        axes.set_title(f'View {self.shown}, {len(self.boxes)} of {self._needed} marked. '
                       f'{problem}\n{_HELP}', fontsize='medium')
        self._frame = Rectangle((0, 0), 0, 0, fill=False, ec=_COLOUR, lw=1.5)
        axes.add_patch(self._frame)
        self._dots, = axes.plot([], [], '+', color=_COLOUR)
        self._selector = RectangleSelector(
            axes, self._on_box, minspanx=_CLICK, minspany=_CLICK, spancoords='pixels',
            button=[MouseButton.LEFT], props={'fill': False, 'edgecolor': _COLOUR})
        self._figure.canvas.draw_idle()

    def _mark(self, points: list[tuple[float, float]], dots: bool) -> None:
        """Draw the box about points, and the points."""
        self._points, self._clicked = points, dots
        left, top, width, height = _box_about(points)
        self._frame.set_bounds(left, top, width, height)
        x, y = zip(*points, strict=True)
        self._dots.set_data((x, y) if dots else ([], []))
        self._figure.canvas.draw_idle()

    def _on_box(self, press: MouseEvent, release: MouseEvent) -> None:
        corners = [(each.xdata, each.ydata) for each in (press, release)]
        if not self._is_click(press.x, press.y, release):
            self._mark([(x, y) for x, y in corners if x is not None and y is not None], False)

    def _on_press(self, event: Event) -> None:
        assert isinstance(event, MouseEvent)
        self._pressed = event.x, event.y

    def _on_release(self, event: Event) -> None:
        assert isinstance(event, MouseEvent)
        if (event.button == MouseButton.LEFT and event.xdata is not None
                and event.ydata is not None and self._pressed is not None
                and self._is_click(*self._pressed, event)
                and not self._figure.canvas.widgetlock.locked()):  # by zooming or panning
            before = self._points if self._clicked else []
            self._mark([*before, (event.xdata, event.ydata)], True)

    @staticmethod
    def _is_click(x: float, y: float, release: MouseEvent) -> bool:
        return max(abs(release.x - x), abs(release.y - y)) <= _CLICK

    def _on_key(self, event: Event) -> None:
        assert isinstance(event, KeyEvent)
        if event.key == 'escape':
            self._end()
        elif event.key == 'backspace':
            self._show()
        elif event.key == 'enter':
            self._go_on()

    def _go_on(self) -> None:
        if not self._points:
            self._order.append(self._order.pop(0))
            self._show()
            return
        box = _box_about(self._points)
        if min(box[2:]) < LEAST_SIDE:
            self._show(f'The box had a side of less than {LEAST_SIDE:g} px.')
            return
        self.boxes[self._order.pop(0)] = box
        if len(self.boxes) == self._needed:
            self._end()
        else:
            self._show()

    def _end(self) -> None:
        for each in self._connected:
            self._figure.canvas.mpl_disconnect(each)
        self._ended()


def has_screen() -> bool:
    """Whether matplotlib can open a window."""
    if sys.platform == 'linux' and not (os.environ.get('DISPLAY')
                                        or os.environ.get('WAYLAND_DISPLAY')):
        return False
    try:
        figure = pyplot.figure()
    except ImportError:  # of a back end that was chosen by MPLBACKEND
        return False
    is_interactive = figure.canvas.required_interactive_framework is not None
    pyplot.close(figure)
    return is_interactive


def boxes_in_window(views: Sequence[PosedView], needed: int, shrink: int = 1) -> dict[int, Box]:
    """Boxes by number of the view, drawn by the user in `needed` of them.

    shrink: by how much the pictures have been shrunk, for the options that are printed.
    Raises ProfileError where there are fewer views, or the user gives up or closes the window.
    """
    if len(views) < needed:
        raise ProfileError(f'a profile needs boxes in {needed} views, or --height; there is '
                           f'{len(views)}')
    figure = pyplot.figure('pmcl profile', (10, 8))
    window = BoxWindow(figure, views, needed, lambda: pyplot.close(figure))
    pyplot.show(block=True)
    if len(window.boxes) < needed:
        raise ProfileError('given up: the object is not marked')
    click.echo(f'to repeat it without a window: '
               f'{options_of({view: resized(box, shrink) for view, box in window.boxes.items()})}',
               err=True)
    return window.boxes


def options_of(boxes: dict[int, Box]) -> str:
    """The options of `pmcl profile` that say the same."""
    return ' '.join(f'--box {view} ' + ' '.join(f'{each:g}' for each in box)
                    for view, box in sorted(boxes.items()))


def _box_about(points: list[tuple[float, float]]) -> Box:
    """In tenths of a pixel, as the options are printed."""
    (left, right), (top, bottom) = ((min(each), max(each)) for each in zip(*points, strict=True))
    return round(left, 1), round(top, 1), round(right - left, 1), round(bottom - top, 1)
