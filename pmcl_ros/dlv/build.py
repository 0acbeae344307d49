"""LightField -> DepthLikelihoodVolume: the third arrow."""

import logging
from dataclasses import replace
from functools import lru_cache

import numpy as np

from pmcl_ros.dlv.back_end import make_likelihood
from pmcl_ros.dlv.gl_cost import GlCost
from pmcl_ros.dlv.gl_volume import GlVolume
from pmcl_ros.dlv.likelihood import truncate
from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.settings import BackEnd, DlvSettings, LayersFrom
from pmcl_ros.dlv.superposition import fit_superposition
from pmcl_ros.dlv.volume import DepthLikelihoodVolume, EdgeVolume, depth_labels
from pmcl_ros.evidence.edges import edge_volume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.runtime.errors import VolumeError

_LOG = logging.getLogger(__name__)
_MOST_BYTES = 2 ** 31  # of a volume with its edges; making them takes about thrice that


def build_volume(light_field: LightField, settings: DlvSettings) -> DepthLikelihoodVolume:
    """The paper's depth likelihood volume of one capture (section V.A), with its edge volume.

    Both are made for the pixels of `PixelGrid.of` the settings, and carry their camera. With
    `interpolation` 'phase' every view is shifted to every label by a Fourier transform, which
    takes many seconds. Raises VolumeError when fewer than two views have light, the labels are too
    near, or the volume would be too large; RenderError when `back_end` is 'gl' and GL cannot.
    """
    lattice = _checked(light_field, settings)
    depths = depth_labels(settings.near, settings.far, settings.labels)
    likelihood = make_likelihood(light_field, depths, settings)
    if settings.truncate:
        likelihood = truncate(likelihood, settings.maxima, settings.neighbours)
    superposition = (fit_superposition(light_field, settings) if settings.layers == 'joint'
                     else None)
    return DepthLikelihoodVolume(light_field.header, likelihood, depths, lattice.pinhole,
                                 _edges(light_field, settings, lattice), superposition)


def build_gl_volume(gl_cost: GlCost, light_field: LightField, settings: DlvSettings) -> GlVolume:
    """The same, in the context of `gl_cost`, on its thread; its edges in memory, its rays unsplit.

    The caller releases it. Raises as `build_volume`, and as `GlVolume.of`.
    """
    lattice = _checked(light_field, settings)
    edges = _edges(light_field, settings, lattice)
    return replace(GlVolume.of(gl_cost, light_field, settings), edges=edges)


def _checked(light_field: LightField, settings: DlvSettings) -> PixelGrid:
    """The pixels that a volume is made for, which is not too large."""
    lattice = PixelGrid.of(light_field.grid.pinhole, settings.crop, settings.stride)
    _check_size(lattice.pinhole, light_field.grid.pinhole, settings)
    needed = StereoPairs.of(light_field.grid, settings.views).labels_needed(settings.near,
                                                                            settings.far)
    _warn_of_few_labels(settings, needed)
    return lattice


def _edges(light_field: LightField, settings: DlvSettings, lattice: PixelGrid) -> EdgeVolume:
    depths = depth_labels(settings.near, settings.far, settings.edge_labels)
    return edge_volume(light_field, depths, settings.views).on(lattice)


def _check_size(volume: Pinhole, edges: Pinhole, settings: DlvSettings) -> None:
    """edges: they are made for all pixels, whatever is kept of them."""
    size = 4 * (volume.height * volume.width * settings.labels
                + 3 * edges.height * edges.width * settings.edge_labels)
    if size > _MOST_BYTES:
        raise VolumeError(
            f'{settings.labels} labels of {volume.width}x{volume.height} px and '
            f'{settings.edge_labels} edge labels of {edges.width}x{edges.height} px take '
            f'{size / 2 ** 30:.1f} GiB, more than {_MOST_BYTES / 2 ** 30:.0f}: choose fewer '
            'labels, or shrink the views')


@lru_cache(maxsize=16)  # told once, not at every capture
def _warn_of_few_labels(settings: DlvSettings, needed: int) -> None:
    for name in ('labels', 'edge_labels'):
        count = getattr(settings, name)
        if count < needed:
            _LOG.warning('views move by up to %.1f px from label to label, more than one: set %s '
                         'to %d (it is %d), or near and far closer together',
                         (needed - 1) / (count - 1), name, needed, count)


def warm_up(back_end: BackEnd = 'auto', layers: LayersFrom = 'volume') -> None:
    """Compile this stage on a tiny light field, so that the first capture does not wait for it.

    back_end, layers: those of the settings to come. Raises RenderError when back_end is 'gl' and
    GL cannot.
    It takes seconds once on a machine that lets numba keep its cache, else in every process.
    """
    side = 48
    pinhole = Pinhole(side, side, 100, 100, side / 2, side / 2)
    grid = ViewGrid(pinhole, 0.001, nominal_positions(3, 3), np.ones((3, 3), np.float32))
    views = np.random.default_rng(0).random((3, 3, side, side, 3), np.float32)
    build_volume(LightField(Header(), views, grid),
                 DlvSettings(labels=3, views=3, edge_labels=2, truncate=True, back_end=back_end,
                             layers=layers))
