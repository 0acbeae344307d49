"""Which machine draws and scores poses, and what any of them offers."""

from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.render.contour_score import ContourScore
from pmcl_ros.pmcl.render.creases import Creases
from pmcl_ros.pmcl.render.gl_renderer import GlRenderer
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene
from pmcl_ros.runtime.gl import choose_back_end

BackEnd = Literal['auto', 'gl', 'numba']


class LikelihoodScore(Protocol):
    """The paper's score: the mean likelihood under the rendered pixels (section V)."""

    @property
    def evaluations(self) -> int:
        """How many poses were drawn so far."""
        ...

    def __call__(self, poses: NDArray[np.floating]) -> NDArray[np.float64]:
        """(n,) of poses (n, 4, 4), object to camera; 0 for one that covers nothing."""
        ...

    def __enter__(self) -> 'LikelihoodScore': ...

    def __exit__(self, *_: object) -> None: ...


class Renderer(Protocol):
    """Draws poses of a scene, and makes what scores them.

    A pose that is not finite shows nothing. Everything raises RenderError in a thread that it is
    not for, after `close`, and for what is too large to draw.
    """

    @property
    def name(self) -> str:
        """What draws, for logs."""
        ...

    def depths(self, scene: Scene, poses: NDArray[np.floating]) -> NDArray[np.float32]:
        """(n, height, width) depths [m] of poses (n, 4, 4); 0 where nothing is."""
        ...

    def contour_score(self, scene: Scene, volume: EvidenceVolume, profile: ContourProfile,
                      creases: Creases | None = None) -> ContourScore:
        """Of an edge volume; the scene's scale is the step of the contour [image px].

        creases: count too.
        """
        ...

    def likelihood_score(self, scene: Scene, volume: DepthLikelihoodVolume) -> LikelihoodScore:
        """Of a volume; each pixel is read at its centre in the image, or just above and left."""
        ...

    def use(self) -> None:
        """Be the one that this thread draws with."""
        ...

    def close(self) -> None:
        """Release everything."""
        ...


def make_renderer(wanted: BackEnd, likelihoods: bool = True) -> Renderer:
    """A renderer, for the calling thread; what numba has to compile for it is compiled.

    likelihoods: will be scored too, not contours alone.
    Raises RenderError when 'gl' is wanted and there is none. With 'numba' OpenGL is not touched.
    """
    if choose_back_end(wanted, 'poses are scored') == 'gl':
        return GlRenderer()
    renderer = NumbaRenderer()
    renderer.warm_up(likelihoods)
    return renderer
