"""Renderer and scores in an OpenGL context."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.pmcl.creases import Creases
from pmcl_ros.pmcl.render.gl_contour import GlContourScore
from pmcl_ros.pmcl.render.gl_likelihood import GlLikelihoodScore
from pmcl_ros.pmcl.render.gl_zbuffers import ZBuffers
from pmcl_ros.pmcl.render.scene import Scene
from pmcl_ros.runtime.gl import GlContext


class GlRenderer:
    """Draws and scores on the GPU, in the thread that made it.

    context: whoever made it closes it; left out: one of its own, closed with this.
    """

    def __init__(self, context: GlContext | None = None) -> None:
        self._own = context is None
        self.context = context or GlContext()
        self.name = self.context.renderer

    def depths(self, scene: Scene, poses: NDArray[np.floating]) -> NDArray[np.float32]:
        """See `Renderer`."""
        width, height = scene.window.size
        depths = np.zeros((len(poses), height, width), np.float32)
        with ZBuffers(self.context, scene, max(1, min(len(poses), 64))) as zbuffers:
            for first in range(0, len(poses), zbuffers.capacity):
                batch = poses[first:first + zbuffers.capacity]
                zbuffers.draw(batch)
                inverse = zbuffers.closeness(len(batch))
                np.divide(1, inverse, out=depths[first:first + len(batch)], where=inverse > 0)
        return depths

    def contour_score(self, scene: Scene, edges: EdgeVolume, profile: ContourProfile,
                      creases: Creases | None = None) -> GlContourScore:
        """See `Renderer`."""
        return GlContourScore(self.context, scene, edges, profile, creases=creases)

    def likelihood_score(self, scene: Scene, volume: DepthLikelihoodVolume) -> GlLikelihoodScore:
        """See `Renderer`."""
        return GlLikelihoodScore(self.context, scene, volume)

    def use(self) -> None:
        """See `GlContext.use`."""
        self.context.use()

    def close(self) -> None:
        """Release the context, if it is this renderer's own."""
        if self._own:
            self.context.close()
