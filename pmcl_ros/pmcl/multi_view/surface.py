"""A textured, opaque surface tells how far away it is, by the depth likelihood volume.

Contours of views that lie close together leave the line of sight the least certain. Where the
volume's best depths agree with each other at the surface of a pose, they are a measurement of its
place along that line; glass, highlights and plain paint do not agree, and say nothing.
"""

import logging
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.settings import MOST_STRIDE
from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evidence.binning import bin_side
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.se3 import retract, rotate_covariance
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.modes import MODE_EXTENT
from pmcl_ros.pmcl.multi_view.region_volume import region_volume
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import size_in_view
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.settings import PmclSettings

_LOG = logging.getLogger(__name__)
_WINDOW, _STRIDE = 11, 2  # px, of the volume: surfaces are smooth
# In labels: how far off a depth may be to be of the surface, how far off such depths are in the
# median where they agree (0.75 by chance), and the standard deviation of their median.
_REACH, _AGREEING, _SIGMA = 1.5, 0.28, 0.1
_LEAST_SHARE, _LEAST_RAYS = 0.65, 100  # of the surface that is seen: that has such depths
_LEAST_IN_VIEW = 0.5  # share of the object that the picture's edge leaves
_CONTRADICTS = 3.0  # standard deviations from where the contours are
_BOX, _BEYOND = 0.01, 0.1  # m: about the origin; how far other depths lie that compete


@dataclass(frozen=True)
class SurfaceDepth:
    """What the surface of a pose says of it.

    direction: (6,) of tangent vectors, of which the component is measured: along the line of
    sight. offset: by how much the object is farther [m]. sigma: standard deviation of that.
    """

    direction: NDArray[np.float64]
    offset: float
    sigma: float

    @classmethod
    def measured(cls, volume: DepthLikelihoodVolume, model: ObjectModel,
                 pose: NDArray[np.float64]) -> 'SurfaceDepth | None':
        """At a pose (4, 4) in the frame of the volume's camera; None where it says nothing."""
        camera, inverse = volume.pinhole, 1 / volume.depths
        distance = float(np.linalg.norm(pose[:3, 3]))
        scene = Scene(model, camera, Window(0, 0, (camera.width, camera.height)),
                      max(distance - 2 * model.radius, 0.1 * distance),
                      distance + 2 * model.radius)
        depth = NumbaRenderer().depths(scene, pose[None])[0]
        shown = (depth > 0) & (depth < volume.depths[0]) & (depth > volume.depths[-1])
        shown &= volume.likelihood.any(axis=2)  # else it is masked, or out of all other views
        label = float(inverse[1] - inverse[0])
        off = (1 / volume.depth_map()[shown] - 1 / depth[shown]) / label
        ours = np.abs(off) < _REACH
        if ours.sum() < max(_LEAST_RAYS, _LEAST_SHARE * len(off)):
            return None
        middle = float(np.median(off[ours]))
        if np.median(np.abs(off[ours] - middle)) > _AGREEING:
            return None
        row, column = (each[ours].mean() for each in np.nonzero(shown))
        z = float(depth[shown][ours].mean())
        point = z * camera.rays(np.array([column, row]))
        sight = point / np.linalg.norm(point)
        metres = label * z ** 2 / float(sight[2])  # of a label
        direction = np.concatenate([sight, np.cross(point - pose[:3, 3], sight)])
        return cls(direction, -middle * metres, _SIGMA * metres)


def with_surface(estimate: PoseEstimate, evidence: ViewsEvidence, model: ObjectModel,
                 settings: PmclSettings) -> PoseEstimate:
    """The estimate in the reference frame, with what the object's surface says of its depth.

    It is as it was where that is nothing, where the object is clear or in water, whose surface
    bends the sweep's rays, where one view alone sees it, or the cameras' poses are uncertain:
    their pictures then do not fit each other that well. Raises VolumeError.
    """
    if (model.clear or settings.interface is not None or not evidence.are_exact
            or estimate.in_view < _LEAST_IN_VIEW):
        return estimate
    about = settings.model_copy(update={'roi_center': tuple(estimate.pose[:3, 3].tolist()),
                                        'roi_size': (_BOX, _BOX, _BOX)})
    size = max(size_in_view(model.diameter, about.roi_center, *each) for each in evidence.cameras)
    made = region_volume(evidence, model, about, {
        'window': _WINDOW, 'stride': min(_STRIDE * bin_side(size), MOST_STRIDE)}, beyond=_BEYOND,
        pose=estimate.pose)
    if made is None:
        return estimate
    volume, _ = made
    assert volume.camera is not None
    camera = volume.camera.camera_to_reference
    found = SurfaceDepth.measured(volume, model, np.linalg.inv(camera) @ estimate.pose)
    if found is None:
        return estimate
    turn = camera[:3, :3]
    direction = np.concatenate([turn @ found.direction[:3], turn @ found.direction[3:]])
    allowed = float(np.sqrt(direction @ estimate.covariance @ direction + found.sigma ** 2))
    if abs(found.offset) > _CONTRADICTS * allowed:
        _LOG.info('the surface is %.1f mm off by the depth likelihood, where %.1f is expected: it '
                  'is not used', 1e3 * found.offset, 1e3 * allowed)
        return estimate
    return corrected(estimate, model, replace(found, direction=direction))


def corrected(estimate: PoseEstimate, model: ObjectModel, surface: SurfaceDepth) -> PoseEstimate:
    """The estimate with a measurement in its frame: a Kalman update of its mode."""
    symmetry, pose, covariance = model.symmetry, estimate.pose, estimate.covariance
    basis = symmetry.tangent_basis(pose)
    direction = basis @ basis.T @ surface.direction
    spread = covariance @ direction
    variance = float(direction @ spread) + surface.sigma ** 2
    gain = basis @ basis.T @ spread / variance
    _LOG.info('the surface is %.1f mm farther than the contours say, with %.1f mm',
              1e3 * surface.offset, 1e3 * surface.sigma)
    step = gain * surface.offset
    turn = Rotation.from_rotvec(step[3:]).as_matrix()  # with it turns an axis of symmetry
    # Particles shrink along the direction as the covariance does (Potter's square root).
    part = 1 / (1 + surface.sigma / np.sqrt(variance))
    ours = symmetry.same_mode(estimate.particles, pose, *MODE_EXTENT)
    particles = estimate.particles.copy()
    near = symmetry.nearest_equivalents(particles[ours], pose)
    off = symmetry.local(near, pose)
    particles[ours] = retract(near, step - part * np.multiply.outer(off @ direction, gain))
    modes = tuple(replace(each, pose=retract(each.pose, step[None])[0])
                  for each in estimate.modes[:1])
    return replace(
        estimate, pose=retract(pose, step[None])[0], particles=particles,
        covariance=rotate_covariance(covariance - variance * np.outer(gain, gain), turn),
        modes=modes + estimate.modes[1:])
