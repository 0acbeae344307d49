"""The kernels of the chain from picture to pose, and of other modes and sources."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv import build
from pmcl_ros.dlv.plane_sweep import build_volume_of_views
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume, build_edges
from pmcl_ros.evidence.energies import evidence_across
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.particle_filter import ParticleFilterLocalizer
from pmcl_ros.pmcl.render.gauss_newton import GaussNewton
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer, tiny_scene
from pmcl_ros.pmcl.settings import Mode, PmclSettings
from pmcl_ros.runtime.resources import resolve
from pmcl_ros.warm_up.raw import DECODE
from pmcl_ros.warm_up.stage import Stage, Stages

_CAMERA, _DEPTHS = Pinhole(64, 64, 100.0, 100.0, 31.5, 31.5), depth_labels(0.4, 0.8, 8)


def _volume() -> None:
    build.warm_up('numba')
    settings = DlvSettings(labels=9, views=3, back_end='numba')
    build.build_volume(build.tiny_light_field(), settings).layers()


def _layers() -> None:
    build.warm_up('numba', 'joint')


def _plane_sweep() -> None:
    beside = np.eye(4)
    beside[0, 3] = 0.01
    views = tuple(PosedView(Header(), _noise(3)[:, :, 0], _CAMERA, each)
                  for each in (np.eye(4), beside))
    build_volume_of_views(PosedViews(views), DlvSettings(labels=4)).layers()


def _edges() -> None:
    build_edges(build.tiny_light_field(), DlvSettings(views=3, edge_labels=2))


def _search() -> None:
    """Look for an object in noise."""
    model, settings = _object('default')
    edges = EdgeVolume(Header(), _noise(3), _DEPTHS, _CAMERA)
    with Localizer(model, settings) as localizer:
        localizer.contour(edges, localizer.localize(edges, np.random.default_rng(0)).pose)


def _draw() -> None:
    scene, _ = tiny_scene()
    NumbaRenderer().depths(scene, np.eye(4)[None])


def _energies() -> None:
    _, edges = tiny_scene()
    evidence_across(edges, np.zeros((1, 2)), np.array([[1.0, 0.0]]), np.ones(1),
                    ContourProfile.contrast(), np.zeros(1))


def _filter() -> None:
    """Look for an object in noise by the paper's filter."""
    model, settings = _object('faithful')
    volume = DepthLikelihoodVolume(Header(), _noise(1)[..., 0].copy(), _DEPTHS, _CAMERA)
    with ParticleFilterLocalizer(model, settings) as localizer:
        localizer.localize(volume, np.random.default_rng(0))


def _noise(components: int) -> NDArray[np.float32]:
    return np.random.default_rng(0).random((64, 64, 8, components), np.float32)


def _object(mode: Mode) -> tuple[ObjectModel, PmclSettings]:
    return (ObjectModel.load(resolve('package://pmcl_ros/models/shaker.obj', 'object')),
            PmclSettings(mode=mode, renderer='numba', proposals=20, particles=8, moves=1,
                         faithful_particles=8, faithful_iterations=2))


_PLANES = 'lightfield.light_field', 'dlv.planes', 'dlv.sampling'
_LIKELIHOODS = *_PLANES, 'dlv.cost', 'dlv.row_costs', 'dlv.window_sums', 'dlv.likelihood'
# Of a pose by the contour; of edges of a light field.
SEARCH: Stages = (Stage(_search, ('geometry.faces', 'evidence.energies', 'pmcl.')),
                  Stage(GaussNewton.warm_up, ('pmcl.render.',)))
EDGES: Stages = Stage(_edges, (*_PLANES, 'evidence.')),
# Of the depth likelihood volume of a light field, of posed views; of the paper's filter in it.
VOLUME: Stages = Stage(_volume, (*_LIKELIHOODS, 'dlv.layers')),
PLANE_SWEEP: Stages = Stage(_plane_sweep, (*_PLANES, 'dlv.plane_sweep', 'dlv.window_sums',
                                           'dlv.likelihood', 'dlv.layers')),
FILTER: Stages = Stage(_filter, ('geometry.faces', 'dlv.sampling', 'pmcl.render.')),
# Of the joint fit of two layers; of drawing an object; of the evidence across given contours.
LAYERS: Stages = Stage(_layers, (*_LIKELIHOODS, 'dlv.layer_fit', 'dlv.view_moments')),
DRAW: Stages = Stage(_draw, tuple(f'pmcl.render.{each}' for each in (
    'clipping', 'numba_renderer._draw_all', 'raster', 'refraction'))),
ENERGIES: Stages = Stage(_energies, ('evidence.energies',)),
# The longest first.
CHAIN: Stages = *SEARCH[:1], *VOLUME, *DECODE, *SEARCH[1:], *EDGES
OTHER_MODES: Stages = *FILTER, *LAYERS, *PLANE_SWEEP
