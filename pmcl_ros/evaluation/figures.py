"""The drawings of docs/method.md, made from the code they explain."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.theory.lemma import counterexample, printed
from pmcl_ros.dlv.theory.two_layers import BACK, FRONT
from pmcl_ros.evaluation.charts import Line, chart
from pmcl_ros.evaluation.two_layers import rates


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
    return chart('depth likelihood of two layers', 'alpha: share of the light that comes from '
                 'the glass', 'L', lines, (0, 1), (0, 0.52))


def layers() -> NDArray[np.uint8]:
    """How often both of two layers are found, over their separation."""
    apart = np.array([0.1, 0.2, 0.3, 0.5, 0.75, 1, 1.25, 1.5, 2, 2.5])
    lines = [Line(f'alpha {alpha}, texture of {scale} px', apart,
                  [100 * rates(each, alpha, scale).both for each in apart], colour, alpha != 0.5)
             for colour, scale in enumerate((0.7, 1, 1.5)) for alpha in (0.5, 0.35)]
    return chart('rays with both layers found', 'separation of the layers [px per view step]', '%',
                 lines, (0, 2.5), (0, 100))


FIGURES = {'lemma': lemma, 'layers': layers}
