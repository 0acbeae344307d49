"""HTML and SVG as trees: text is escaped where it is written, tags close themselves."""

import base64
from collections.abc import Iterable, Sequence
from xml.etree.ElementTree import Element, tostring

import cv2
import numpy as np
from numpy.typing import NDArray

Node = Element | str


def element(tag: str, *children: Node | None, **attributes: object) -> Element:
    """An element; None among the children is left out.

    Attributes: `class_` is class, `stroke_width` is stroke-width; numbers have two decimals.
    """
    made = Element(tag, {name.strip('_').replace('_', '-'): _text(value)
                         for name, value in attributes.items()})
    return extended(made, children)


def extended(parent: Element, children: Iterable[Node | None]) -> Element:
    """The parent, with more children."""
    for each in children:
        if isinstance(each, str):
            if len(parent):
                parent[-1].tail = (parent[-1].tail or '') + each
            else:
                parent.text = (parent.text or '') + each
        elif each is not None:
            parent.append(each)
    return parent


def html(node: Element) -> str:
    """What to write into the page."""
    return tostring(node, encoding='unicode', method='html')


def data_uri(picture: NDArray[np.uint8]) -> str:
    """A picture (height, width, 3) RGB or (height, width) grey, as a PNG within the page."""
    pixels = picture[..., ::-1] if picture.ndim == 3 else picture
    _, data = cv2.imencode('.png', np.ascontiguousarray(pixels),
                           [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return 'data:image/png;base64,' + base64.b64encode(data.tobytes()).decode('ascii')


def image(picture: NDArray[np.uint8], alternative: str) -> Element:
    """A picture; alternative: what it shows, for who cannot see it."""
    return element('img', src=data_uri(picture), alt=alternative, width=picture.shape[1],
                   height=picture.shape[0])


def figure(drawing: Element, *caption: Node, wide: bool = False) -> Element:
    """A drawing with what it shows."""
    return element('figure', drawing, element('figcaption', *caption),
                   class_='wide' if wide else 'narrow')


def table(head: Sequence[Node], rows: Iterable[Sequence[Node]], numbers: bool = True) -> Element:
    """A table. numbers: all columns but the first are right-aligned."""
    body = [element('tr', *(element('td', cell) for cell in row)) for row in rows]
    return element('div', element(
        'table', element('thead', element('tr', *(element('th', each) for each in head))),
        element('tbody', *body), class_='numbers' if numbers else 'words'), class_='scroll')


def section(title: str, name: str, *children: Node | None) -> Element:
    """A part of the page; name: what links to it. Words among the children are paragraphs."""
    return element('section', element('h2', title), *(
        element('p', each) if isinstance(each, str) else each for each in children), id=name)


def figures(*children: Element) -> Element:
    """Figures beside each other, as many as there is room for."""
    return element('div', *children, class_='figures')


def key(*entries: tuple[str, str]) -> Element:
    """A legend: (class of the stroke, what it is)."""
    return element('p', *(element('span', element('i', class_=f'swatch {kind}'), text)
                          for kind, text in entries), class_='key')


def _text(value: object) -> str:
    return f'{value:.2f}' if isinstance(value, float | np.floating) else str(value)
