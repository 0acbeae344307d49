"""Templates, pictures and figures as HTML that loads nothing from outside."""

import base64
from typing import Any, NamedTuple

import cv2
import jinja2
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

_HERE = 'pmcl_ros.evaluation.report'
_EFFORT = 6  # of zlib's 9, which takes ten times as long for photographs that are 5 % smaller


class Figure(NamedTuple):
    """A drawing and its caption. wide: as wide as the page lets it be."""

    drawing: Markup
    caption: str
    wide: bool = False


def rendered(template: str, package: str = _HERE, /, **values: Any) -> str:
    """A template of a package with these values. It may include those of the report."""
    loaders = [jinja2.PackageLoader(each, '') for each in dict.fromkeys([package, _HERE])]
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader(loaders), autoescape=True, trim_blocks=True,
        lstrip_blocks=True, undefined=jinja2.StrictUndefined)
    return environment.get_template(template).render(**values)


def image(picture: NDArray[np.uint8], alternative: str, kind: str = 'pixels') -> Markup:
    """A picture (height, width, 3) RGB as an element. alternative: what it shows, in words.

    kind: 'pixels' or 'chart'; the latter is smooth at any size.
    """
    _, data = cv2.imencode('.png', picture[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, _EFFORT])
    return Markup('<img src="data:image/png;base64,{}" alt="{}" class="{}" width="{}" '
                  'height="{}">').format(
        base64.b64encode(data.tobytes()).decode('ascii'), alternative, kind,
        *picture.shape[1::-1])
