"""EvidenceVolume and poses -> scores, refined poses, posterior: the contour in one picture."""

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.geometry.interface import Interface
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.contour_approximations import LinearizedContour
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.posterior import ContourPosterior, Feasible, Score
from pmcl_ros.pmcl.prior.orientation import Orientation
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.back_end import Renderer
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.contour_score import ContourScore
from pmcl_ros.pmcl.render.creases import Creases
from pmcl_ros.pmcl.render.gauss_newton import ContourExpansion, GaussNewton
from pmcl_ros.pmcl.render.level_of_detail import simplified, subdivided
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.raster import LARGEST
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.view_terms import ViewContour

_LOG = logging.getLogger(__name__)
STAGES = 0, 1, 2  # of the search: coarse contours, fine ones, those of the image
_COARSE, _FINE = 4, 2  # image px per pixel of the z-buffers of refinements
_DETAIL = 0.3  # image px: tolerance of the simplified mesh in them
_STEPS_OF_DETAIL = 2  # of that tolerance, in an octave
# image px: step of the finite differences of refinements on coarse, fine and finest contours
_STEPS = 1.5, 1.0, 1.0
# px: how uncertain the place of a contour is taken to be on each (`EvidenceVolume.blurred`).
_BLURS = 2.0, 1.0, 0.5

Shown = Callable[[ContourPoints], ContourPoints]


@dataclass(frozen=True)
class ContourEvidence:
    """Evidence of an object's poses by its contours and creases in one picture.

    volume: the evidence of the picture. profile: log odds by its energies. error: of the model.
    creases: None to ignore them. constraint: (n,) which of poses (n, 4, 4) are feasible, besides
    being in the region. detail: tolerance of the simplified mesh at the resolution of the image
    [image px]. interface: of water, orientation: of the object, if it is not any, in the camera's
    frame.
    """

    renderer: Renderer
    model: ObjectModel
    settings: PmclSettings
    region: Region
    volume: EvidenceVolume
    profile: ContourProfile
    error: ModelError
    creases: Creases | None
    constraint: Feasible | None = None
    detail: float = 0.0
    interface: Interface | None = None
    orientation: Orientation | None = None

    @classmethod
    def from_volume(cls, volume: EvidenceVolume, renderer: Renderer, model: ObjectModel,
                    settings: PmclSettings, profile: ContourProfile | None,
                    error: ModelError | None,
                    creases: Creases | None, region: Region | None = None,
                    camera: NDArray[np.float64] | None = None) -> 'ContourEvidence':
        """The evidence in a volume of either kind.

        profile, error: None for those of `volume`. region: by default that of the settings.
        camera: (4, 4) to the frame of the settings' interface and direction up; by default it is
        that frame.
        Creases were learned on refocused edges: they are ignored where the evidence has none.
        """
        if profile is None or not volume.shows_creases:
            profile = volume.profile
        if not volume.shows_creases:
            creases = None
        if isinstance(volume, EdgeVolume) and volume.from_likelihood:
            _LOG.info('no edge volume was given: contours are looked for in the likelihood')
        if isinstance(volume, ContourMap) and renderer.name != 'numba':
            _LOG.info('contour maps are scored on the processor')
            renderer = NumbaRenderer()
        interface = settings.interface
        if interface is not None:
            interface = interface if camera is None else interface.seen_from(camera)
            creases = None  # they are drawn as if there were no water
            if renderer.name != 'numba':
                _LOG.info('what is seen through water is scored on the processor')
                renderer = NumbaRenderer()
        orientation = Orientation.from_settings(settings, model)
        if orientation is not None and camera is not None:
            orientation = orientation.seen_from(camera)
        region = region or Region(settings.roi_center, settings.roi_size)
        return cls(renderer, model, settings, region, volume, profile, error or volume.model_error,
                   creases, interface=interface, orientation=orientation)

    @property
    def window(self) -> Window:
        """The part of the image that the object can cover."""
        return self.region.window(self.volume.pinhole, self.model.radius)

    def score(self) -> ContourScore:
        """The evidence of poses at the resolution of the image; the caller closes it."""
        return self.renderer.contour_score(self._scene(self.window), self.volume, self.profile,
                                           self.creases)

    def optimizers(self, stages: Sequence[int] = STAGES) -> list[GaussNewton]:
        """Gauss-Newton at some stages of the search: on contours as of `expansion`."""
        return [GaussNewton([self.expansion(stage)], self.region) for stage in stages]

    def expansion(self, stage: int, uncertain: float = 0.0,
                  camera: NDArray[np.float64] | None = None) -> ContourExpansion:
        """Of coarse (0), fine (1) contours, those of the image (2).

        uncertain: standard deviation of the contour's place beside that of the stage [image px].
        camera: as of `ContourExpansion`.
        """
        window = self.window
        box = (window.left, window.top, window.left + window.size[0],
               window.top + window.size[1])
        least = -(-max(window.size) // LARGEST)  # they are drawn by the processor
        scale, step, blur = (_COARSE, _FINE, 1)[stage], _STEPS[stage], _BLURS[stage]
        return ContourExpansion(
            self._scene(window.coarser(max(scale, least))),
            self.volume.blurred(float(np.hypot(blur, uncertain)), box), self.profile, step, camera)

    def posterior(self, exact: ContourScore, shown: Shown | None = None) -> ContourPosterior:
        """The posterior by the evidence of poses at the resolution of the image (`score`).

        shown: of a contour's points those that count; default: all.
        """
        symmetry = self.model.symmetry

        def points_at(pose: NDArray[np.float64]) -> ContourPoints:
            points = exact.points(pose)
            return points if shown is None else shown(points)

        def seen(pose: NDArray[np.float64]) -> ViewContour:
            return ViewContour(points_at(pose), self.volume, self.profile, exact.creases(pose))

        def local_model_at(pose: NDArray[np.float64], sure: bool) -> LocalModel:
            return LocalModel.from_views(pose, symmetry, [seen(pose)],
                                         self.error if sure else None)

        return ContourPosterior(
            self.model, self.settings, where(self.feasible, exact, -np.inf), local_model_at,
            lambda pose: LinearizedContour.from_view(pose, seen(pose)), self.feasible, points_at,
            inside_at=self.inside)

    def inside(self, pose: NDArray[np.float64]) -> float:
        """Mean log odds that the pixels which a pose (4, 4) covers show a solid [nat / px].

        NaN in edges, which do not tell.
        """
        if not isinstance(self.volume, ContourMap):
            return math.nan
        window = self.window
        drawn = self.renderer.depths(self._scene(window), pose[None])[0]
        return self.volume.inside_of(drawn, window.left, window.top)

    def feasible(self, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,) which of poses (n, 4, 4) are feasible: the prior is uniform on them."""
        inside = self.region.contains(poses[:, :3, 3])
        if self.orientation is not None:
            inside &= self.orientation.allows(poses[:, :3, :3])
        return inside if self.constraint is None else inside & self.constraint(poses)

    def _scene(self, window: Window) -> Scene:
        return scene(self.model, self.region, self.volume.pinhole, window,
                     _DETAIL if window.scale > 1 else self.detail, self.interface)


def scene(model: ObjectModel, region: Region, camera: Pinhole, window: Window,
          detail: float = 0.0, interface: Interface | None = None) -> Scene:
    """An object anywhere in a region; detail: tolerance of its simplified mesh [image px]."""
    near, far = region.grown(model.radius)
    if detail > 0:
        # In steps, so that views from about the same distance share a mesh.
        octaves = np.log2(detail * near / max(camera.fx, camera.fy))
        model = simplified(model, float(2 ** (np.floor(_STEPS_OF_DETAIL * octaves)
                                              / _STEPS_OF_DETAIL)))
    if interface is not None:  # straight edges seem bent
        model = subdivided(model)
    return Scene(model, camera, window, near, far, interface)


def where(feasible: Feasible, score: Score, outside: float) -> Score:
    """A score that renders feasible poses only; the rest get `outside`."""
    def inside(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        known = feasible(poses)
        values = np.full(len(poses), outside)
        values[known] = score(poses[known])
        return values
    return inside
