"""LightField -> DepthLikelihoodVolume: the third arrow."""

import numpy as np

from pmcl_ros.dlv import cost, reference
from pmcl_ros.dlv.edges import edge_volume
from pmcl_ros.dlv.likelihood import log_likelihood, truncate
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.header import Header
from pmcl_ros.lightfield.geometry import Pinhole, ViewGrid, nominal_positions
from pmcl_ros.lightfield.light_field import LightField


def build_volume(light_field: LightField, settings: DlvSettings) -> DepthLikelihoodVolume:
    """The paper's depth likelihood volume of one capture (section V.A), with its edge volume.

    With `interpolation` 'phase' every view is shifted to every label by a Fourier transform, which
    takes many seconds. Raises VolumeError when fewer than two views have light, or the labels are
    too near.
    """
    depths = depth_labels(settings.near, settings.far, settings.labels)
    if settings.interpolation == 'phase':
        costs = reference.cost_volume(light_field, depths, settings).astype(np.float32)
    else:
        costs = cost.cost_volume(light_field, depths, settings)
    likelihood = log_likelihood(costs)
    if settings.truncate:
        likelihood = truncate(likelihood, settings.maxima, settings.neighbours)
    edge_depths = depth_labels(settings.near, settings.far, settings.edge_labels)
    return DepthLikelihoodVolume(light_field.header, likelihood, depths, light_field.grid.pinhole,
                                 edge_volume(light_field, edge_depths, settings.views))


def warm_up() -> None:
    """Compile this stage on a tiny light field, so that the first capture does not wait for it.

    It takes seconds once on a machine that lets numba keep its cache, else in every process.
    """
    side = 48
    pinhole = Pinhole(side, side, 100, 100, side / 2, side / 2)
    grid = ViewGrid(pinhole, 0.001, nominal_positions(3, 3), np.ones((3, 3), np.float32))
    views = np.random.default_rng(0).random((3, 3, side, side, 3), np.float32)
    build_volume(LightField(Header(), views, grid),
                 DlvSettings(labels=3, views=3, edge_labels=2, truncate=True))
