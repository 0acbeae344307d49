"""Where to look next: how sure the pose would be with one more view, for candidate cameras.

The pose of a candidate's camera is as uncertain as that of the first view, and shares with the
views what these share.

The contour that a candidate would see is drawn at the pose found. Its evidence is expected to be
as curved, for each pixel of it, as that of the views there are. Its model error is correlated with
theirs, and is expected to be that of one view: views that agree so far do not tell that a view
from elsewhere will.
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.learned import learned_map_evidence
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.interface import Interface
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import least_turn
from pmcl_ros.pmcl.contour_evidence import scene
from pmcl_ros.pmcl.local_model import LocalModel, weak_information, without_negative
from pmcl_ros.pmcl.multi_view.camera_errors import CameraErrors
from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence
from pmcl_ros.pmcl.multi_view.joint_posterior import JointPosterior, numbers_of
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.view_terms import Contributions, ViewContour, ViewTerms, pairs
from pmcl_ros.runtime.errors import LocalizationError, RenderError

_FLAT = ContourProfile(np.zeros(1, np.float32), np.array([-1, 1], np.float32),
                       np.array([[-1, 1]], np.float32))
_OPPOSITE = 0.05  # length of a mean direction that means nothing
_ALIKE = 1e-6  # independent views beyond one: fewer are views of one place
_CLOSEST = 0.05  # m: between an object and a camera that may look at it
CAP, CANDIDATES = 90.0, 40  # degrees and number of candidates where nobody lists them


@dataclass(frozen=True)
class NextView:
    """What a candidate would bring.

    camera: (4, 4) to the reference frame. sigma: largest standard deviation of the position that
    is expected with its view, now: without; the same where it is not expected to help [m].
    """

    camera: NDArray[np.float64]
    sigma: float
    now: float

    def describe(self) -> str:
        """One line: what is left, and from where."""
        place = ', '.join(f'{value:.3f}' for value in self.camera[:3, 3])
        ahead = ', '.join(f'{value:+.2f}' for value in self.camera[:3, 2])
        return (f'{1e3 * self.sigma:.2f} mm with a view from ({place}) m, looking along '
                f'({ahead})')


def next_views(evidence: ViewsEvidence, model: ObjectModel, settings: PmclSettings,
               pose: NDArray[np.float64], candidates: NDArray[np.float64],
               pinhole: Pinhole) -> list[NextView]:
    """What each of candidates (n, 4, 4) would bring, best first.

    evidence: of the views there are. pose: (4, 4) found in them. candidates: cameras to the
    reference frame. pinhole: of the camera that would take the picture. A candidate that does not
    see the object brings nothing. Raises LocalizationError where no view sees the region.
    """
    joint = JointEvidence.from_views(evidence, NumbaRenderer(), model, settings)
    with contextlib.ExitStack() as stack:
        posterior = JointPosterior.opened(joint, settings, numbers_of(joint), stack)
        mode = posterior.refine(joint.seen(pose))
        if evidence.errors is None:
            posed = [evidence.views[number] for number in joint.numbers]
            errors = CameraErrors.from_views([*posed, posed[0]])
        else:  # of poses that pictures corrected: those of the first are the candidate's, too
            errors = CameraErrors(np.concatenate([joint.errors.root, joint.errors.root[:1]]))
        known = _Known.from_posterior(mode.pose, posterior, errors.enlarged(
            posterior.known_near(mode.pose).understated))
    now = known.sigma()
    seen = [_contour(model, pinhole, joint.seen(camera), mode.pose,
                     None if settings.interface is None else settings.interface.seen_from(camera))
            for camera in candidates]
    sigmas = np.array([np.inf if each is None else known.sigma(each) for each in seen])
    return [NextView(candidates[k], float(min(sigmas[k], now)), now)
            for k in np.argsort(sigmas, kind='stable')]


@dataclass(frozen=True)
class _Known:
    """What the views that there are tell about a pose (4, 4) and nuisances (k + 1,).

    These are of `Nuisances`: n = d + k + 1 unknowns. errors: of the cameras, the candidate's last.
    basis: (6, d) of the pose's tangent space. scale: of the evidence as a log likelihood.
    stretches: of the contours. information: (n, n) with the nuisances' prior. displaced: (n, n)
    covariance of the gradient by the model error of one view, share: factor of that by how views
    agree. displacement: standard deviation of where contours are found [px]. curvature: of the
    evidence, in units of the least.
    """

    joint: JointEvidence
    errors: CameraErrors
    pose: NDArray[np.float64]
    basis: NDArray[np.float64]
    scale: float
    stretches: Sequence[Contributions]
    information: NDArray[np.float64]
    displaced: NDArray[np.float64]
    share: float
    displacement: float
    curvature: float

    @classmethod
    def from_posterior(cls, pose: NDArray[np.float64], posterior: JointPosterior,
                       errors: CameraErrors) -> '_Known':
        """Of a pose at a mode of all views."""
        joint = posterior.contours.joint
        symmetry, error = joint.model.symmetry, joint.views[0].error
        views = posterior.contours.contours(pose, posterior.known_near(pose).nuisances)
        # Curvature a pixel, relative to that of a contour of which nothing is known.
        local, weak = (LocalModel.from_views(pose, symmetry, each, None) for each in (
            views, [replace(each, curvature=1.0) for each in views]))
        curved = float(np.trace(local.information) / np.trace(weak.information))
        # The prior of the nuisances, as evidence of the mode.
        scale = posterior.local_model_at(pose, True).scale
        d = local.basis.shape[1]
        information = np.diag(np.full(d + errors.number + 1, 1 / scale))
        information[:d, :d] = weak_information(local.basis)
        known = cls(joint, errors, pose, local.basis, scale, (), information,
                    np.zeros_like(information), posterior.error_share_near(pose),
                    posterior.contours.displacement, curved)
        terms = [known.terms(each, number) for number, each in enumerate(views)
                 if len(each.points.lengths)]
        stretches = [each.stretches() for each in terms]
        return replace(known, stretches=stretches,
                       information=information + sum(each.information for each in terms),
                       displaced=known.displaced + _displaced(stretches, stretches, error))

    def terms(self, seen: ViewContour, number: int) -> ViewTerms:
        """Of a view with a number among `errors`, in all n unknowns."""
        assert seen.camera is not None
        basis = self.basis
        errors = CameraErrors(self.errors.root[number:][:1])
        off = errors.seen(seen.camera[None], self.pose)[0]
        # How the unknowns (n,) move what the view sees, (d + 1,).
        onto = np.zeros((basis.shape[1] + errors.number + 1, basis.shape[1] + 1))
        onto[:, :-1] = np.concatenate([np.eye(basis.shape[1]), off.T @ basis,
                                       np.zeros((1, basis.shape[1]))])
        onto[-1, -1] = self.displacement
        made = ViewTerms.from_view(seen, self.pose, basis, displaced=True)
        return replace(made.transformed(onto), information=onto @ made.information @ onto.T)

    def sigma(self, seen: ViewContour | None = None) -> float:
        """Largest standard deviation of the position, with the contour in one more view [m]."""
        information, displaced, share = self.information, self.displaced, self.share
        error = self.joint.views[0].error
        if seen is not None and seen.camera is not None:
            terms = self.terms(replace(seen, curvature=self.curvature), len(self.joint.views))
            added = [terms.stretches()]
            both = _displaced(self.stretches, added, error)
            information = information + terms.information
            displaced = displaced + both + both.T + _displaced(added, added, error)
            share = self._share_with(seen.camera)
        inverse = np.linalg.inv(information)
        off = without_negative(inverse @ displaced @ inverse)
        basis = self.basis
        covariance = (inverse / self.scale + share * off)[:basis.shape[1], :basis.shape[1]]
        return position_sigma(basis @ covariance @ basis.T)

    def _share_with(self, camera: NDArray[np.float64]) -> float:
        """Factor of the model error that is expected with a view by a camera (4, 4).

        n independent views compare n - 1 times how far the model error moves them. Those that a
        view adds are expected to find what the model error of one view lets expect, 1.
        """
        independent = self.joint.independent
        done = independent - 1
        added = max(self.joint.independent_with(camera[None, :3, 3]) - independent, 0)
        total = done + added
        return (done * self.share + added) / total if total > _ALIKE else self.share


def _displaced(views: Sequence[Contributions], others: Sequence[Contributions], error: ModelError
               ) -> NDArray[np.float64]:
    """(n, n) covariance by the model error of what views and others add to the gradient.

    A scalar 0 where there are no views, or no others.
    """
    if not (views and others):
        return np.zeros(())
    distance, same_side, alike = pairs(views, others, error)
    one, other = (np.concatenate([terms.curvatures for terms in each]) for each in (views, others))
    return np.asarray(one.T @ ((error.covariance(distance, same_side) * alike) @ other))


def position_sigma(covariance: NDArray[np.float64]) -> float:
    """Largest standard deviation of the position, in any direction, by a covariance (6, 6) [m]."""
    return float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))


def _contour(model: ObjectModel, pinhole: Pinhole, camera: NDArray[np.float64],
             pose: NDArray[np.float64], interface: Interface | None) -> ViewContour | None:
    """The contour of a pose (4, 4) before a camera (4, 4); None where it is not seen.

    interface: of water, in the camera's frame.
    """
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
        drawn = scene(model, region, pinhole, region.window(pinhole, model.radius),
                      interface=interface)
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
    middle, distance = _middle(pose, cameras)
    # A Fibonacci lattice on the cap (Gonzalez 2010).
    number = np.arange(count) + 0.5
    z = 1 - (1 - np.cos(np.deg2rad(degrees) / 2)) * number / count
    turn = np.pi * (1 + 5 ** 0.5) * number
    flat = np.sqrt(1 - z ** 2)
    local = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    onto = least_turn(np.array([0, 0, 1.0]), middle)
    made = np.tile(np.eye(4), (count, 1, 1))
    for k, direction in enumerate(onto.apply(local)):
        made[k, :3, :3] = _looking(cameras[0], -direction)
        made[k, :3, 3] = pose[:3, 3] + distance * direction
    return made


def angles_around(pose: NDArray[np.float64], cameras: Sequence[NDArray[np.float64]],
                  others: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """(n, 2) where others (n, 4, 4) stand around an object, to the right and upwards [deg].

    pose: (4, 4) of the object. It is the angle at the object from the middle of the cameras
    (4, 4) there are, as the first of them would see it from there.
    """
    middle, _ = _middle(pose, cameras)
    right, down, _ = _looking(cameras[0], -middle).T
    away = np.array([each[:3, 3] for each in others]).reshape(-1, 3) - pose[:3, 3]
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    aside = away @ np.stack([right, -down], axis=1)
    angle = np.rad2deg(np.arccos(np.clip(away @ middle, -1, 1)))
    return angle[:, None] * aside / np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-12)


def _middle(pose: NDArray[np.float64], cameras: Sequence[NDArray[np.float64]]
            ) -> tuple[NDArray[np.float64], float]:
    """Mean direction (3,) from an object at a pose (4, 4) to cameras, and mean distance [m]."""
    away = np.array([each[:3, 3] for each in cameras]) - pose[:3, 3]
    distances = np.linalg.norm(away, axis=1)
    middle = (away / distances[:, None]).mean(axis=0)
    if np.linalg.norm(middle) < _OPPOSITE:  # cameras all around: about the first
        middle = away[0] / distances[0]
    return middle / np.linalg.norm(middle), float(distances.mean())


def _looking(camera: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) a camera (4, 4) turned as little as possible, so that it looks along a direction."""
    turn = least_turn(camera[:3, 2], direction).as_matrix()
    return np.asarray(turn @ camera[:3, :3])
