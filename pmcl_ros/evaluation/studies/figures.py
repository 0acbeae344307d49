"""Draws the figures of the documentation: Lemma 1, two superimposed layers, the frames."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.cost import cost_volume
from pmcl_ros.dlv.layers import read_layers
from pmcl_ros.dlv.likelihood import log_likelihood
from pmcl_ros.dlv.settings import DlvSettings, LayersFrom
from pmcl_ros.dlv.superposition import fit_superposition
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.drawing.charts import Chart, Line, draw, picture
from pmcl_ros.drawing.frames_picture import frames_figure
from pmcl_ros.evaluation.results import table
from pmcl_ros.evaluation.studies.lemma import BACK, FRONT, counterexample, printed
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions

_WIDTH, _HEIGHT, _VIEWS = 84, 76, 7  # px; views of a row and of a column
_BORDER = 18  # px: left out, since some views do not see it
_NEAR, _FAR = 1 / 3.2, 1 / 0.2  # m: with a baseline and a focal length of 1, 0.2 to 3.2 px a step
_LABELS = 90  # a thirtieth of a px apart
_MIDDLE = 1.7  # px per view step, half-way between the layers
_NOISE = 0.01  # of the encoded intensity, as in a well lit frame
_WAVES = 24  # of a texture: so many that its values are nearly Gaussian
_SOURCES: tuple[LayersFrom, ...] = ('joint', 'volume')


@dataclass(frozen=True)
class Rates:
    """Shares of rays, 0 to 1.

    both: rays with both layers found. ordered: of these, rays whose likelihoods have the order of
    Lemma 1; NaN if there are none, or the layers' shares are equal. several: rays with two
    surfaces found; in a scene of one layer all of them are wrong.
    """

    both: float
    ordered: float
    several: float


@lru_cache(maxsize=1)  # both sources of layers are asked about a scene, one after the other
def two_layers(separation: float, alpha: float, scale: float, seed: int = 0,
               noise: float = _NOISE) -> LightField:
    """A textured plane seen through another: 7x7 views, a focal length and a baseline of 1.

    separation: of the layers [px per view step]. alpha: the front one's share of the light. scale:
    the correlation length of both textures [px]. noise: of the encoded intensity.
    """
    rng = np.random.default_rng(seed)
    pinhole = Pinhole(_WIDTH, _HEIGHT, 1, 1, (_WIDTH - 1) / 2, (_HEIGHT - 1) / 2)
    grid = ViewGrid(pinhole, 1, nominal_positions(_VIEWS, _VIEWS),
                    np.ones((_VIEWS, _VIEWS), np.float32))
    waves = rng.normal(0, 1 / scale, (2, _WAVES, 2))  # rad/px: then the correlation is Gaussian
    phases = rng.uniform(0, 2 * np.pi, (2, 3, _WAVES))
    y, x = np.mgrid[:_HEIGHT, :_WIDTH].astype(float)
    views = np.empty((_VIEWS, _VIEWS, _HEIGHT, _WIDTH, 3), np.float32)
    for place in np.ndindex(_VIEWS, _VIEWS):
        a, b = grid.positions[place]
        light = rng.normal(0.5, noise, (_HEIGHT, _WIDTH, 3))
        for layer, (share, side) in enumerate(((alpha, 0.5), (1 - alpha, -0.5))):
            step = _MIDDLE + side * separation
            angle = np.stack([x + a * step, y + b * step], axis=-1) @ waves[layer].T
            light += share * 0.2 * np.sqrt(2 / _WAVES) * (
                np.cos(angle) @ np.cos(phases[layer]).T - np.sin(angle) @ np.sin(phases[layer]).T)
        views[place] = np.clip(light, 0, 1) ** 2.4
    return LightField(Header(), views, grid)


def rates(separation: float, alpha: float, scale: float, noise: float = _NOISE,
          layers: LayersFrom = 'volume') -> Rates:
    """How often the volume of `two_layers`, or a joint fit with it, shows both layers.

    A layer is found if one of a ray's two most likely surfaces displaces the outermost views by
    the same, up to a correlation length or half the separation.
    """
    depths = depth_labels(_NEAR, _FAR, _LABELS)
    settings = DlvSettings(near=_NEAR, far=_FAR, labels=_LABELS, crop=(
        _BORDER, _BORDER, _WIDTH - 2 * _BORDER, _HEIGHT - 2 * _BORDER))
    scene = two_layers(separation, alpha, scale, noise=noise)
    found = read_layers(log_likelihood(cost_volume(scene, depths, settings)), depths, 2)
    if layers == 'joint':
        found = fit_superposition(scene, settings).split(found)
    step = 1 / found.depths
    tolerance = min(scale / (_VIEWS // 2), separation / 2)
    front, back = (np.abs(step - _MIDDLE - side * separation) < tolerance for side in (0.5, -0.5))
    both = front.any(axis=-1) & back.any(axis=-1)
    likelier: NDArray[np.bool_] = front[..., 0]  # the first is the more likely one
    right = likelier[both] == (alpha > 0.5)
    known = both.any() and alpha != 0.5
    return Rates(float(both.mean()), float(right.mean()) if known else float('nan'),
                 float(np.isfinite(found.behind).mean()))


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

    The first column of rates is of a single layer: rays with two layers found.
    """
    apart = (0, 0.05, 0.1, 0.2, 0.3, 0.5, 1, 2)
    rows = [(0.5, 1, 0.01), (0.35, 1, 0.01), (0.2, 1, 0.01), (0.35, 0.7, 0.01),
            (0.35, 2, 0.01), (0.35, 1, 0.03)]
    lines = []
    for alpha, scale, noise in rows:
        cells = [f'{alpha}', f'{scale} px', f'{noise}']
        for each in apart:
            found = [rates(each, alpha, scale, noise=noise, layers=source)
                     for source in _SOURCES]
            cells.append(' / '.join(f'{100 * (one.both if each else one.several):.0f}'
                                    for one in found))
        lines.append(cells)
    return table(['alpha', 'texture', 'noise', 'one layer', *map(str, apart[1:])], lines)


def frames() -> NDArray[np.uint8]:
    """Camera, region of interest and object."""
    return picture(frames_figure())


FIGURES = {'frames': frames, 'lemma': lemma, 'layers': layers}
TABLES = {'layers': layers_table}
