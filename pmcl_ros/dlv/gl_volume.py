"""A volume that stays on the GPU, for a scorer in the same GL context."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.gl_cost import GlArray, GlCost
from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume, EdgeVolume, depth_labels
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.errors import VolumeError


@dataclass(frozen=True)
class GlVolume:
    """What `DepthLikelihoodVolume` is, its likelihood in a buffer of a GL context.

    A context is one thread's, and no two share buffers: the volume belongs in the scorer's
    context and is made in its thread, `GlVolume.of(GlCost(scorer's context), ...)`. A shader reads
    it where it is: `likelihood.bind(n)`. Whoever made it releases it; a scorer only reads.

    likelihood: (height, width, labels), row-major. depths, pinhole: as of `DepthLikelihoodVolume`.
    edges: in memory, where they were made.
    """

    header: Header
    likelihood: GlArray
    depths: NDArray[np.float64]
    pinhole: Pinhole
    edges: EdgeVolume | None = None

    @classmethod
    def of(cls, gl_cost: GlCost, light_field: LightField, settings: DlvSettings) -> 'GlVolume':
        """The volume of one capture, without edges, on `gl_cost`'s thread.

        `settings.back_end` plays no part.

        Raises VolumeError as `Matching.of` does, and when the settings ask for what has no form on
        the GPU, phase shift or truncation; RenderError as `GlCost` does.
        """
        if settings.interpolation == 'phase' or settings.truncate:
            raise VolumeError(f'interpolation {settings.interpolation}, truncate '
                              f'{settings.truncate}: a volume on the GPU is neither phase-shifted '
                              'nor truncated; use build_volume, or other settings')
        depths = depth_labels(settings.near, settings.far, settings.labels)
        pinhole = PixelGrid.of(light_field.grid.pinhole, settings.crop, settings.stride).pinhole
        likelihood = gl_cost.log_likelihood(light_field, depths, settings)
        return cls(light_field.header, likelihood, depths, pinhole)

    def read(self) -> DepthLikelihoodVolume:
        """A copy in memory. Raises RenderError in another thread than the context's."""
        return DepthLikelihoodVolume(self.header, self.likelihood.read(), self.depths,
                                     self.pinhole, self.edges)

    def __enter__(self) -> 'GlVolume':
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Free the buffer."""
        self.likelihood.release()
