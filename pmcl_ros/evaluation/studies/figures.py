"""The drawings of the documents, made from the code they explain."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.settings import LayersFrom
from pmcl_ros.drawing.charts import Chart, Line, draw, picture
from pmcl_ros.drawing.frames_picture import frames_figure
from pmcl_ros.evaluation.studies.lemma import BACK, FRONT, counterexample, printed
from pmcl_ros.evaluation.studies.two_layers import rates

_SOURCES: tuple[LayersFrom, ...] = ('joint', 'volume')


def lemma() -> NDArray[np.uint8]:
    """Likelihood of the glass and of what is behind it, as the glass' share of the light grows.

    Under the assumptions of Lemma 1, and in its counterexample.
    """
    alpha = np.linspace(0, 1, 201)
    assumed, free = printed(alpha) / 2, counterexample(alpha).likelihood()
    lines = [Line('glass, as the lemma assumes', alpha, assumed[:, FRONT], 0),
             Line('behind it', alpha, assumed[:, BACK], 1),
             Line('patterned glass', alpha, free[:, FRONT], 0, dashed=True),
             Line('smooth wall behind it', alpha, free[:, BACK], 1, dashed=True)]
    return draw([[Chart('depth likelihood of two layers', 'alpha: share of the light that comes '
                        'from the glass', 'L', lines, (0, 1), (0, 0.52))]])


def layers() -> NDArray[np.uint8]:
    """How often both of two layers are found, over their separation."""
    apart = np.array([0.05, 0.1, 0.2, 0.3, 0.5, 0.75, 1, 1.25, 1.5, 2, 2.5])
    lines = [Line(f'{source}, texture of {scale} px', apart,
                  [100 * rates(each, 0.35, scale, layers=source).both for each in apart], colour,
                  source == 'volume')
             for colour, scale in enumerate((0.7, 1, 1.5)) for source in _SOURCES]
    return draw([[Chart('rays with both layers found, alpha 0.35',
                        'separation of the layers [px per view step]', '%', lines, (0, 2.5))]])


def layers_table() -> str:
    """The same in numbers, for more shares, textures and noise, as Markdown: joint fit / volume.

    In the first column of rates there is a single layer: rays along which two are told.
    """
    apart = (0, 0.05, 0.1, 0.2, 0.3, 0.5, 1, 2)
    rows = [(0.5, 1, 0.01), (0.35, 1, 0.01), (0.2, 1, 0.01), (0.35, 0.7, 0.01),
            (0.35, 2, 0.01), (0.35, 1, 0.03)]
    lines = ['| alpha | texture | noise | one layer | ' + ' | '.join(map(str, apart[1:])) + ' |',
             '|---' * (3 + len(apart)) + '|']
    for alpha, scale, noise in rows:
        cells = [f'{alpha}', f'{scale} px', f'{noise}']
        for each in apart:
            found = [rates(each, alpha, scale, noise=noise, layers=source)
                     for source in _SOURCES]
            cells.append(' / '.join(f'{100 * (one.both if each else one.several):.0f}'
                                    for one in found))
        lines.append('| ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines)


def frames() -> NDArray[np.uint8]:
    """Camera, region of interest and object."""
    return picture(frames_figure())


FIGURES = {'frames': frames, 'lemma': lemma, 'layers': layers}
TABLES = {'layers': layers_table}
