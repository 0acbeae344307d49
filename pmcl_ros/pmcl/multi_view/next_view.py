"""Where to look next: how sure the pose would be with one more view, for candidate cameras.

Poses of cameras count as exact, and the model error is that of one view.

The contour that a candidate would see is drawn at the pose found. Its evidence is expected to be
as curved, for each pixel of it, as that of the views there are; its model error is correlated with
theirs.
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.learned import learned_map_evidence
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.contour_evidence import scene
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence
from pmcl_ros.pmcl.multi_view.joint_posterior import JointPosterior
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.view_terms import ViewContour
from pmcl_ros.runtime.errors import LocalizationError, RenderError

_FLAT = ContourProfile(np.zeros(1, np.float32), np.array([-1, 1], np.float32),
                       np.array([[-1, 1]], np.float32))
_OPPOSITE = 0.05  # length of a mean direction that means nothing
_CLOSEST = 0.05  # m: between an object and a camera that may look at it


@dataclass(frozen=True)
class NextView:
    """What a candidate would bring.

    camera: (4, 4) to the reference frame. sigma: largest standard deviation of the position that
    is expected with its view, now: without [m].
    """

    camera: NDArray[np.float64]
    sigma: float
    now: float


def next_views(evidence: ViewsEvidence, model: ObjectModel, settings: PmclSettings,
               pose: NDArray[np.float64], candidates: NDArray[np.float64],
               pinhole: Pinhole) -> list[NextView]:
    """What each of candidates (n, 4, 4) would bring, best first.

    evidence: of the views there are. pose: (4, 4) found in them. candidates: cameras to the
    reference frame. pinhole: of the camera that would take the picture. A candidate that does not
    see the object brings nothing. Raises LocalizationError where no view sees the region.
    """
    joint = JointEvidence.from_views(evidence, NumbaRenderer(), model, settings)
    first = evidence.views[joint.numbers[0]].camera_to_reference
    into = np.asarray(np.linalg.inv(first), float)
    with contextlib.ExitStack() as stack:
        contours = joint.open(stack)
        posterior = JointPosterior(model, settings, contours, None)
        mode = posterior.refine(into @ pose)
        known = contours.contours(mode.pose, posterior.motions_near(mode.pose))
    error = joint.views[0].error
    before = LocalModel.from_views(mode.pose, model.symmetry, known, error)
    # Curvature a pixel, relative to that of a contour of which nothing is known.
    weak = LocalModel.from_views(mode.pose, model.symmetry, [_flattened(each) for each in known],
                                 None)
    curved = float(np.trace(before.information) / np.trace(weak.information))
    now = _sigma(before, before.scale)
    found = []
    for camera in candidates:
        seen = _contour(model, pinhole, into @ camera, mode.pose)
        if seen is None:
            found.append(NextView(camera, now, now))
            continue
        both = LocalModel.from_views(mode.pose, model.symmetry, [*known, replace(
            seen, curvature=curved)], error)
        found.append(NextView(camera, min(_sigma(both, before.scale), now), now))
    return sorted(found, key=lambda each: each.sigma)


def _sigma(local: LocalModel, scale: float) -> float:
    """Largest standard deviation of the position [m]."""
    covariance = np.linalg.inv(scale * local.information) + local.model_error
    whole = local.basis @ covariance @ local.basis.T
    return float(np.sqrt(np.linalg.eigvalsh(whole[:3, :3])[-1]))


def _flattened(view: ViewContour) -> ViewContour:
    return replace(view, curvature=1.0)


def _contour(model: ObjectModel, pinhole: Pinhole, camera: NDArray[np.float64],
             pose: NDArray[np.float64]) -> ViewContour | None:
    """The contour of a pose (4, 4) before a camera (4, 4); None where it is not seen."""
    before = np.linalg.inv(camera) @ pose
    x, y, z = before[:3, 3].tolist()
    if z < model.radius + _CLOSEST:
        return None
    region = Region((x, y, z), (1e-3, 1e-3, 1e-3))
    depths = depth_labels(*region.grown(model.radius), 2)
    blank = ContourMap(
        Header(), np.zeros((pinhole.height, pinhole.width, 2, 5), np.float32), depths, pinhole,
        np.zeros((pinhole.height, pinhole.width, 2), np.float32), learned_map_evidence())
    try:
        drawn = scene(model, region, pinhole, region.window(pinhole, model.radius))
        with NumbaRenderer().contour_score(drawn, blank, _FLAT) as score:
            points: ContourPoints = score.points(before)
    except (LocalizationError, RenderError):
        return None
    return ViewContour(points, blank, _FLAT, camera=camera) if len(points.lengths) else None


def cap(pose: NDArray[np.float64], cameras: Sequence[NDArray[np.float64]], degrees: float,
        count: int) -> NDArray[np.float64]:
    """(count, 4, 4) cameras that look at an object from a cap of a sphere, evenly spread.

    pose: (4, 4) of the object. cameras: (4, 4) of the views there are: the cap is about their mean
    direction, at their mean distance, and spans `degrees` from side to side. The image's axes are
    turned as little as possible from those of the first camera.
    """
    origin = pose[:3, 3]
    away = np.array([each[:3, 3] - origin for each in cameras])
    distances = np.linalg.norm(away, axis=1)
    middle = (away / distances[:, None]).mean(axis=0)
    if np.linalg.norm(middle) < _OPPOSITE:  # cameras all around: about the first
        middle = away[0] / distances[0]
    middle /= np.linalg.norm(middle)
    # A Fibonacci lattice on the cap (Gonzalez 2010).
    number = np.arange(count) + 0.5
    z = 1 - (1 - np.cos(np.deg2rad(degrees) / 2)) * number / count
    turn = np.pi * (1 + 5 ** 0.5) * number
    flat = np.sqrt(1 - z ** 2)
    local = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    onto = Rotation.align_vectors(middle[None], [[0, 0, 1]])[0]
    made = np.tile(np.eye(4), (count, 1, 1))
    for k, direction in enumerate(onto.apply(local)):
        turned = Rotation.align_vectors([-direction], [cameras[0][:3, 2]])[0].as_matrix()
        made[k, :3, :3] = turned @ cameras[0][:3, :3]
        made[k, :3, 3] = origin + distances.mean() * direction
    return made
