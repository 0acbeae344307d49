"""LightField -> DepthLikelihoodVolume, made where its poses will be scored."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from pmcl_ros.dlv.back_end import choose
from pmcl_ros.dlv.build import build_gl_volume, build_volume
from pmcl_ros.dlv.gl_cost import GlCost
from pmcl_ros.dlv.gl_volume import GlVolume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.pmcl.estimator import Volume
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.gl import GlContext

_LOG = logging.getLogger(__name__)


@contextmanager
def volume_for(localizer: Localizer, light_field: LightField, settings: DlvSettings
               ) -> Iterator[Volume]:
    """The volume of one capture for this localizer, in whose thread this is.

    Where both volume and poses are made by gl it stays on the GPU, in the localizer's context;
    unless the settings ask for what only `build_volume` has: phase shift, truncation, layers.
    Raises as `build_volume`; what GL cannot hold is made by it, unless the back end is 'gl'.
    """
    resident = None
    if localizer.context is not None and _can_stay(settings) and choose(
            settings.back_end) == 'gl':
        resident = _resident(localizer.context, light_field, settings)
    if resident is None:
        yield build_volume(light_field, settings)
        return
    with resident:
        yield resident


def _can_stay(settings: DlvSettings) -> bool:
    return not (settings.interpolation == 'phase' or settings.truncate
                or settings.layers == 'joint')


def _resident(context: GlContext, light_field: LightField, settings: DlvSettings
              ) -> GlVolume | None:
    gl_cost = GlCost(context)
    try:
        volume = build_gl_volume(gl_cost, light_field, settings)
    except RenderError as error:
        if settings.back_end == 'gl':
            raise
        _LOG.warning('the volume does not stay on the GPU: %s', error)
        return None
    finally:
        gl_cost.release()
    _LOG.info('the volume stays on the GPU, where poses are scored')
    return volume
