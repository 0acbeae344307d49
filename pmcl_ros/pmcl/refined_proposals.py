"""Proposals of objects without an axis, turned and shifted to where their contours fit.

Three angles leave their templates 10 degrees apart: the true pose is among the first few hundred,
but off by several pixels along a straight edge, where blurred edges tell little. A few steps of
Gauss-Newton, each a drawing of the object, bring a template into place; then sharp edges tell.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import EdgeVolume
from pmcl_ros.pmcl.ascent import ascent
from pmcl_ros.pmcl.contour_profile import ContourProfile
from pmcl_ros.pmcl.creases import Creases
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.moved_contour import shrunk
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene

_CELL = 4  # image px that are one in the first steps: as the templates' maps
_OFFSETS = 0.75  # cells: of the contrast's offsets, which are 1 px apart in the image
_FINE = 2  # image px per pixel of the z-buffers of the last steps
_COARSE_STEPS, _FINE_STEPS = 8, 5  # of a pixel of theirs at most
_COARSE_CONVERGED, _FINE_CONVERGED = 0.2, 0.3  # px of theirs


def refined_proposals(model: ObjectModel, region: Region, edges: EdgeVolume,
                      profile: ContourProfile, creases: Creases | None,
                      proposals: NDArray[np.float64], hopeful: int
                      ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """At most `hopeful` of poses (n, 4, 4) moved uphill, and their evidence [nat], best first.

    Uphill in the contrast of coarse edges, all of them; then those that the profile (and creases)
    favour, in sharp ones. None leaves the region.
    """
    def inside(pose: NDArray[np.float64]) -> bool:
        return bool(region.contains(pose[None, :3, 3])[0])

    renderer = NumbaRenderer()  # single poses: not worth a trip to the GPU
    near, far = region.grown(model.radius)
    coarse = shrunk(edges, _CELL)
    contrast = ContourProfile.contrast()
    if coarse is not edges:
        contrast = replace(contrast, offsets=np.float32(_OFFSETS) * contrast.offsets)
    window = region.window(coarse.pinhole, model.radius)
    with renderer.contour_score(Scene(model, coarse.pinhole, window, near, far), coarse,
                                contrast) as blurred:
        def roughly(pose: NDArray[np.float64]) -> LocalModel:
            return LocalModel.of(pose, model.axis, blurred.points(pose), coarse, contrast, None)

        poses = np.stack([ascent(each, roughly, _COARSE_STEPS, _COARSE_CONVERGED, inside)[0]
                          for each in proposals])
    window = region.window(edges.pinhole, model.radius).coarser(_FINE)
    with renderer.contour_score(Scene(model, edges.pinhole, window, near, far), edges, profile,
                                0, creases) as sharp:
        def about(pose: NDArray[np.float64]) -> LocalModel:
            return LocalModel.of(pose, model.axis, sharp.points(pose), edges, profile, None,
                                 sharp.creases(pose))

        first = np.argsort(-sharp(poses), kind='stable')[:hopeful]
        found = [ascent(each, about, _FINE_STEPS, _FINE_CONVERGED, inside)
                 for each in poses[first]]
    evidence = np.array([local.evidence for _, local in found])
    order = np.argsort(-evidence, kind='stable')
    return np.stack([pose for pose, _ in found])[order], evidence[order]
